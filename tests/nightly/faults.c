/* A Vulkan layer that makes calls fail, for the table of faults in docs/measuring.md. Variables of the environment say which:
 *
 * FAULT="CALL N RESULT"  The N-th CALL answers RESULT, a VkResult, each N-th where N is negative. A device that answered
 *                        VK_ERROR_DEVICE_LOST stays lost.
 *                        RESULT may be `hang` (vkQueueSubmit submits nothing, and who waits for it times out) or `stall`
 *                        (the process computes for STALL_S before the call).
 * FAULT_FROM=BYTES       Calls count from the first buffer of so many bytes, and that one is the first vkCreateBuffer.
 * TICKS=KIND             Timestamps are `zero`, `backwards`, `same` at both ends or `coarse`; or, as PERIOD,BITS, in ticks of PERIOD ns
 *                        with BITS valid bits, and each frame's middle lies where the counter begins again at zero.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <vulkan/vk_layer.h>
#include <vulkan/vulkan.h>

#define EXPORT __attribute__((visibility("default")))
#define STALL_S 0.3
#define COARSE_NS 65536
#define MAX_TICKS 4096
#define MAX_POOLS 1024

static PFN_vkGetInstanceProcAddr instance_proc;
static PFN_vkGetDeviceProcAddr device_proc;
static VkDevice device;
static int devices, lost = -1, hung = -1, armed, calls;
static VkQueryPool timestamp_pools[MAX_POOLS];
static unsigned pools;

static const char *variable(const char *name) { return getenv(name) ? getenv(name) : ""; }

static void stall(void) {
    clock_t end = clock() + (clock_t)(STALL_S * CLOCKS_PER_SEC);
    while (clock() < end) {}
}

/* A lost device runs nothing any more. */
static VkResult lose(void) {
    ((PFN_vkDeviceWaitIdle)device_proc(device, "vkDeviceWaitIdle"))(device);
    lost = devices;
    return VK_ERROR_DEVICE_LOST;
}

/* What this call answers in place of the driver's answer; VK_SUCCESS where the driver is to be asked. */
static VkResult fault(const char *name) {
    char call[64] = "", result[32] = "";
    int number = 0, is_of_queue = strstr("vkQueueSubmit vkWaitSemaphores vkGetSemaphoreCounterValue", name) != NULL;
    if (is_of_queue && lost == devices) return VK_ERROR_DEVICE_LOST;
    if (hung == devices && !strcmp(name, "vkWaitSemaphores")) return VK_TIMEOUT;
    sscanf(variable("FAULT"), "%63s %d %31s", call, &number, result);
    if (strcmp(call, name) || !(armed || !*variable("FAULT_FROM"))) return VK_SUCCESS;
    if (++calls != number && (number >= 0 || calls % number)) return VK_SUCCESS;
    fprintf(stderr, "fault: %s %s\n", name, result);
    if (!strcmp(result, "stall")) stall();
    if (!strcmp(result, "hang")) hung = devices;
    return atoi(result) == VK_ERROR_DEVICE_LOST ? lose() : atoi(result);
}

/* Calls that may fail: parameters, and the arguments that hand them on. */
#define CALLS(CALL) \
    CALL(AllocateCommandBuffers, (VkDevice d, const VkCommandBufferAllocateInfo *i, VkCommandBuffer *o), (d, i, o)) \
    CALL(BeginCommandBuffer, (VkCommandBuffer c, const VkCommandBufferBeginInfo *i), (c, i)) \
    CALL(EndCommandBuffer, (VkCommandBuffer c), (c)) \
    CALL(AllocateMemory, (VkDevice d, const VkMemoryAllocateInfo *i, const VkAllocationCallbacks *a, VkDeviceMemory *o), (d, i, a, o)) \
    CALL(AllocateDescriptorSets, (VkDevice d, const VkDescriptorSetAllocateInfo *i, VkDescriptorSet *o), (d, i, o)) \
    CALL(MapMemory, (VkDevice d, VkDeviceMemory m, VkDeviceSize f, VkDeviceSize s, VkMemoryMapFlags g, void **o), (d, m, f, s, g, o)) \
    CALL(CreateImage, (VkDevice d, const VkImageCreateInfo *i, const VkAllocationCallbacks *a, VkImage *o), (d, i, a, o)) \
    CALL(CreateImageView, (VkDevice d, const VkImageViewCreateInfo *i, const VkAllocationCallbacks *a, VkImageView *o), (d, i, a, o)) \
    CALL(CreateFramebuffer, (VkDevice d, const VkFramebufferCreateInfo *i, const VkAllocationCallbacks *a, VkFramebuffer *o), (d, i, a, o)) \
    CALL(CreateRenderPass, (VkDevice d, const VkRenderPassCreateInfo *i, const VkAllocationCallbacks *a, VkRenderPass *o), (d, i, a, o)) \
    CALL(CreateShaderModule, (VkDevice d, const VkShaderModuleCreateInfo *i, const VkAllocationCallbacks *a, VkShaderModule *o), (d, i, a, o)) \
    CALL(CreateComputePipelines, (VkDevice d, VkPipelineCache c, uint32_t n, const VkComputePipelineCreateInfo *i, const VkAllocationCallbacks *a, VkPipeline *o), (d, c, n, i, a, o)) \
    CALL(CreateGraphicsPipelines, (VkDevice d, VkPipelineCache c, uint32_t n, const VkGraphicsPipelineCreateInfo *i, const VkAllocationCallbacks *a, VkPipeline *o), (d, c, n, i, a, o)) \
    CALL(CreateSemaphore, (VkDevice d, const VkSemaphoreCreateInfo *i, const VkAllocationCallbacks *a, VkSemaphore *o), (d, i, a, o)) \
    CALL(GetSemaphoreCounterValue, (VkDevice d, VkSemaphore s, uint64_t *o), (d, s, o)) \
    CALL(WaitSemaphores, (VkDevice d, const VkSemaphoreWaitInfo *i, uint64_t t), (d, i, t))
#define FUNCTION(name, parameters, arguments) \
    static VKAPI_ATTR VkResult VKAPI_CALL my_##name parameters { \
        VkResult answer = fault("vk" #name); \
        return answer ? answer : ((PFN_vk##name)device_proc(device, "vk" #name)) arguments; \
    }
CALLS(FUNCTION)

static VKAPI_ATTR VkResult VKAPI_CALL my_CreateBuffer(VkDevice d, const VkBufferCreateInfo *i, const VkAllocationCallbacks *a, VkBuffer *o) {
    armed |= i->size == strtoull(variable("FAULT_FROM"), NULL, 10);
    VkResult answer = fault("vkCreateBuffer");
    return answer ? answer : ((PFN_vkCreateBuffer)device_proc(d, "vkCreateBuffer"))(d, i, a, o);
}

static VKAPI_ATTR VkResult VKAPI_CALL my_QueueSubmit(VkQueue q, uint32_t n, const VkSubmitInfo *i, VkFence f) {
    VkResult answer = fault("vkQueueSubmit");
    if (answer || hung == devices) return answer;
    return ((PFN_vkQueueSubmit)device_proc(device, "vkQueueSubmit"))(q, n, i, f);
}

static VKAPI_ATTR VkResult VKAPI_CALL my_CreateQueryPool(VkDevice d, const VkQueryPoolCreateInfo *i, const VkAllocationCallbacks *a, VkQueryPool *o) {
    VkResult answer = fault("vkCreateQueryPool");
    if (!answer) answer = ((PFN_vkCreateQueryPool)device_proc(d, "vkCreateQueryPool"))(d, i, a, o);
    if (!answer && i->queryType == VK_QUERY_TYPE_TIMESTAMP) timestamp_pools[pools++ % MAX_POOLS] = *o;
    return answer;
}

static void spoil(uint64_t *ticks, uint32_t count) {
    const char *kind = variable("TICKS");
    int64_t middle = (int64_t)ticks[count / 2];
    int period = 1, bits = 64;
    sscanf(kind, "%d,%d", &period, &bits);
    for (uint32_t i = 0; i < count; i++) {
        if (!strcmp(kind, "zero")) ticks[i] = 0;
        else if (!strcmp(kind, "same")) ticks[i] = ticks[i & ~1u];
        else if (!strcmp(kind, "coarse")) ticks[i] -= ticks[i] % COARSE_NS;
        else if (!strcmp(kind, "backwards")) ticks[i] = 2 * (uint64_t)middle - ticks[i];
        else ticks[i] = (uint64_t)(((int64_t)ticks[i] - middle) / period) & (UINT64_MAX >> (64 - bits));
    }
}

/* fathom resolves timestamps when the passes that wrote them have ended, so the host can read them already. */
static VKAPI_ATTR void VKAPI_CALL my_CmdCopyQueryPoolResults(VkCommandBuffer c, VkQueryPool p, uint32_t first, uint32_t count, VkBuffer to, VkDeviceSize at, VkDeviceSize stride, VkQueryResultFlags flags) {
    static uint64_t ticks[MAX_TICKS];
    unsigned pool = 0;
    while (pool < MAX_POOLS && timestamp_pools[pool] != p) pool++;
    VkQueryResultFlags now = VK_QUERY_RESULT_64_BIT;
    if (!*variable("TICKS") || pool == MAX_POOLS
        || ((PFN_vkGetQueryPoolResults)device_proc(device, "vkGetQueryPoolResults"))(device, p, first, count, sizeof ticks, ticks, sizeof *ticks, now)) {
        ((PFN_vkCmdCopyQueryPoolResults)device_proc(device, "vkCmdCopyQueryPoolResults"))(c, p, first, count, to, at, stride, flags);
        return;
    }
    spoil(ticks, count);
    ((PFN_vkCmdUpdateBuffer)device_proc(device, "vkCmdUpdateBuffer"))(c, to, at, count * sizeof *ticks, ticks);
}

static PFN_vkGetPhysicalDeviceProperties next_properties;
static PFN_vkGetPhysicalDeviceProperties2 next_properties2;
static PFN_vkGetPhysicalDeviceQueueFamilyProperties next_families;
static PFN_vkCreateDevice next_device;

/* Timestamps of a software driver are not used, so the device is none. */
static void change(VkPhysicalDeviceProperties *properties) {
    if (!*variable("TICKS")) return;
    properties->deviceType = VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU;
    strcpy(properties->deviceName, "made");
    sscanf(variable("TICKS"), "%f", &properties->limits.timestampPeriod);
}

static VKAPI_ATTR void VKAPI_CALL my_GetPhysicalDeviceProperties2(VkPhysicalDevice d, VkPhysicalDeviceProperties2 *o) {
    next_properties2(d, o);
    change(&o->properties);
}

static VKAPI_ATTR void VKAPI_CALL my_GetPhysicalDeviceProperties(VkPhysicalDevice d, VkPhysicalDeviceProperties *o) {
    next_properties(d, o);
    change(o);
}

static VKAPI_ATTR void VKAPI_CALL my_GetPhysicalDeviceQueueFamilyProperties(VkPhysicalDevice d, uint32_t *n, VkQueueFamilyProperties *o) {
    next_families(d, n, o);
    for (uint32_t i = 0; o && i < *n; i++) sscanf(variable("TICKS"), "%*d,%u", &o[i].timestampValidBits);
}

/* What lies below an instance is asked for now: later the loader would answer with this layer. */
static VKAPI_ATTR VkResult VKAPI_CALL my_CreateInstance(const VkInstanceCreateInfo *i, const VkAllocationCallbacks *a, VkInstance *o) {
    VkLayerInstanceCreateInfo *link = (void *)i->pNext;
    while (link->sType != VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO || link->function != VK_LAYER_LINK_INFO) link = (void *)link->pNext;
    instance_proc = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    VkResult answer = ((PFN_vkCreateInstance)instance_proc(NULL, "vkCreateInstance"))(i, a, o);
    if (answer) return answer;
    next_properties = (PFN_vkGetPhysicalDeviceProperties)instance_proc(*o, "vkGetPhysicalDeviceProperties");
    next_properties2 = (PFN_vkGetPhysicalDeviceProperties2)instance_proc(*o, "vkGetPhysicalDeviceProperties2");
    next_families = (PFN_vkGetPhysicalDeviceQueueFamilyProperties)instance_proc(*o, "vkGetPhysicalDeviceQueueFamilyProperties");
    next_device = (PFN_vkCreateDevice)instance_proc(*o, "vkCreateDevice");
    return answer;
}

static VKAPI_ATTR VkResult VKAPI_CALL my_CreateDevice(VkPhysicalDevice p, const VkDeviceCreateInfo *i, const VkAllocationCallbacks *a, VkDevice *o) {
    VkLayerDeviceCreateInfo *link = (void *)i->pNext;
    while (link->sType != VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO || link->function != VK_LAYER_LINK_INFO) link = (void *)link->pNext;
    device_proc = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    VkResult answer = next_device(p, i, a, o);
    device = *o;
    devices++;
    return answer;
}

#define NAME(name, ...) { "vk" #name, (PFN_vkVoidFunction)my_##name },
static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_address(VkDevice d, const char *name);
static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL instance_address(VkInstance i, const char *name);

static PFN_vkVoidFunction own(const char *name) {
    static const struct { const char *name; PFN_vkVoidFunction function; } functions[] = {
        CALLS(NAME) NAME(CreateBuffer) NAME(QueueSubmit) NAME(CreateQueryPool) NAME(CmdCopyQueryPoolResults) NAME(CreateInstance)
        NAME(CreateDevice) NAME(GetPhysicalDeviceProperties) NAME(GetPhysicalDeviceProperties2) NAME(GetPhysicalDeviceQueueFamilyProperties)
        { "vkGetDeviceProcAddr", (PFN_vkVoidFunction)device_address }, { "vkGetInstanceProcAddr", (PFN_vkVoidFunction)instance_address },
    };
    for (size_t i = 0; i < sizeof functions / sizeof *functions; i++)
        if (!strcmp(functions[i].name, name)) return functions[i].function;
    return NULL;
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_address(VkDevice d, const char *name) {
    PFN_vkVoidFunction function = own(name);
    return function ? function : device_proc(d, name);
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL instance_address(VkInstance i, const char *name) {
    PFN_vkVoidFunction function = own(name);
    return function ? function : instance_proc(i, name);
}

EXPORT VKAPI_ATTR VkResult VKAPI_CALL vkNegotiateLoaderLayerInterfaceVersion(VkNegotiateLayerInterface *layer) {
    layer->loaderLayerInterfaceVersion = 2;
    layer->pfnGetInstanceProcAddr = instance_address;
    layer->pfnGetDeviceProcAddr = device_address;
    layer->pfnGetPhysicalDeviceProcAddr = NULL;
    return VK_SUCCESS;
}
