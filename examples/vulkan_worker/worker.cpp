// A worker of `fathom compare` that is not fathom: a compute shader timed by Vulkan's timestamps. The protocol is
// docs/worker-protocol.md.
//
// vulkan_worker [--work FACTOR] [--counted] [--timestamps]
//
// `--work 1.05` makes 5 % more turns, so that two sides differ. `--counted` tells a picosecond for each turn that the shader has
// counted in place of a time, so that figures have no noise.
//
// On a software driver the process does the GPU's work. Its timestamps need not cover all of it: those of lavapipe (Mesa 22.3) around
// a dispatch read about half of the host's time, and they count what other processes take from the core. There the time is the CPU
// time of the process from the submission to the fence. `--timestamps` asks for timestamps all the same.

#include <time.h>
#include <vulkan/vulkan.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "work.spv.h"

using nlohmann::json;

namespace {

constexpr uint32_t GROUP = 64;   // local_size_x in work.comp
constexpr uint32_t GROUPS = 256;
constexpr VkDeviceSize BYTES = 4 + 4 * VkDeviceSize{GROUP} * GROUPS;

struct Options {
    double work = 1.0;
    bool counted = false;
    bool timestamps = false;
};

// A call that failed. A lost device answers nothing more, so the worker ends.
struct Fault : std::runtime_error {
    Fault(const std::string &what, bool fatal) : std::runtime_error(what), fatal(fatal) {}
    bool fatal;
};

void check(VkResult result, const char *call) {
    if (result != VK_SUCCESS) {
        throw Fault(std::string(call) + " failed with VkResult " + std::to_string(result), result == VK_ERROR_DEVICE_LOST);
    }
}

double process_ns() {
    timespec time{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return 1e9 * static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec);
}

const char *type_name(VkPhysicalDeviceType type) {
    switch (type) {
        case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU: return "IntegratedGpu";
        case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU: return "DiscreteGpu";
        case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU: return "VirtualGpu";
        case VK_PHYSICAL_DEVICE_TYPE_CPU: return "Cpu";
        default: return "Other";
    }
}

// The first device with a queue for compute, and all that one dispatch needs. The process's end frees it.
class Gpu {
  public:
    Gpu() {
        choose_device();
        open_device();
        make_buffer();
        make_pipeline();
        make_commands();
    }

    json adapter() const {
        VkPhysicalDeviceDriverProperties driver{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES};
        VkPhysicalDeviceProperties2 properties{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, &driver, {}};
        vkGetPhysicalDeviceProperties2(physical, &properties);
        const auto &of = properties.properties;
        return {
            {"name", of.deviceName}, {"backend", "vulkan"}, {"device_type", type_name(of.deviceType)},
            {"driver", driver.driverName}, {"driver_info", driver.driverInfo}, {"vendor_id", of.vendorID},
            {"device_id", of.deviceID}, {"software", software()}, {"timestamp_period_ns", of.limits.timestampPeriod},
            {"host_threads", std::max(1U, std::thread::hardware_concurrency())},
        };
    }

    // Nanoseconds of one dispatch of so many turns.
    double sample(uint32_t turns, const Options &options) {
        record(turns);
        *done = 0;
        VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
        submit.commandBufferCount = 1;
        submit.pCommandBuffers = &commands;
        check(vkResetFences(device, 1, &fence), "vkResetFences");
        const double begin_ns = process_ns();
        check(vkQueueSubmit(queue, 1, &submit, fence), "vkQueueSubmit");
        check(vkWaitForFences(device, 1, &fence, VK_TRUE, UINT64_MAX), "vkWaitForFences");
        const double process = process_ns() - begin_ns;
        if (options.counted) {
            return 0.001 * *done;
        }
        return software() && !options.timestamps ? process : between_timestamps();
    }

  private:
    bool software() const { return limits.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU; }

    void choose_device() {
        VkApplicationInfo application{VK_STRUCTURE_TYPE_APPLICATION_INFO};
        application.apiVersion = VK_API_VERSION_1_2;  // driverName
        VkInstanceCreateInfo create{VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO};
        create.pApplicationInfo = &application;
        VkInstance instance{};
        check(vkCreateInstance(&create, nullptr, &instance), "vkCreateInstance");
        uint32_t count = 0;
        check(vkEnumeratePhysicalDevices(instance, &count, nullptr), "vkEnumeratePhysicalDevices");
        std::vector<VkPhysicalDevice> devices(count);
        check(vkEnumeratePhysicalDevices(instance, &count, devices.data()), "vkEnumeratePhysicalDevices");
        for (VkPhysicalDevice each : devices) {
            vkGetPhysicalDeviceQueueFamilyProperties(each, &count, nullptr);
            std::vector<VkQueueFamilyProperties> families(count);
            vkGetPhysicalDeviceQueueFamilyProperties(each, &count, families.data());
            for (family = 0; family < count; ++family) {
                if (families[family].queueFlags & VK_QUEUE_COMPUTE_BIT) {
                    physical = each;
                    valid_bits = families[family].timestampValidBits;
                    vkGetPhysicalDeviceProperties(physical, &limits);
                    return;
                }
            }
        }
        throw Fault("no Vulkan device with a queue for compute", true);
    }

    void open_device() {
        const float priority = 1.0F;
        VkDeviceQueueCreateInfo queues{VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO};
        queues.queueFamilyIndex = family;
        queues.queueCount = 1;
        queues.pQueuePriorities = &priority;
        VkDeviceCreateInfo create{VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO};
        create.queueCreateInfoCount = 1;
        create.pQueueCreateInfos = &queues;
        check(vkCreateDevice(physical, &create, nullptr, &device), "vkCreateDevice");
        vkGetDeviceQueue(device, family, 0, &queue);
    }

    uint32_t host_memory(uint32_t allowed) const {
        constexpr VkMemoryPropertyFlags WANTED = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
        VkPhysicalDeviceMemoryProperties memory{};
        vkGetPhysicalDeviceMemoryProperties(physical, &memory);
        for (uint32_t type = 0; type < memory.memoryTypeCount; ++type) {
            if ((allowed >> type & 1) != 0 && (memory.memoryTypes[type].propertyFlags & WANTED) == WANTED) {
                return type;
            }
        }
        throw Fault("no memory that the host can read", true);
    }

    void make_buffer() {
        VkBufferCreateInfo create{VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO};
        create.size = BYTES;
        create.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
        check(vkCreateBuffer(device, &create, nullptr, &buffer), "vkCreateBuffer");
        VkMemoryRequirements needs{};
        vkGetBufferMemoryRequirements(device, buffer, &needs);
        VkMemoryAllocateInfo allocate{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO};
        allocate.allocationSize = needs.size;
        allocate.memoryTypeIndex = host_memory(needs.memoryTypeBits);
        VkDeviceMemory memory{};
        check(vkAllocateMemory(device, &allocate, nullptr, &memory), "vkAllocateMemory");
        check(vkBindBufferMemory(device, buffer, memory, 0), "vkBindBufferMemory");
        void *mapped = nullptr;
        check(vkMapMemory(device, memory, 0, VK_WHOLE_SIZE, 0, &mapped), "vkMapMemory");
        done = static_cast<volatile uint32_t *>(mapped);
    }

    void make_pipeline() {
        VkDescriptorSetLayoutBinding binding{0, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr};
        VkDescriptorSetLayoutCreateInfo sets{VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO};
        sets.bindingCount = 1;
        sets.pBindings = &binding;
        VkDescriptorSetLayout set_layout{};
        check(vkCreateDescriptorSetLayout(device, &sets, nullptr, &set_layout), "vkCreateDescriptorSetLayout");
        VkPushConstantRange push{VK_SHADER_STAGE_COMPUTE_BIT, 0, 4};
        VkPipelineLayoutCreateInfo layouts{VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO};
        layouts.setLayoutCount = 1;
        layouts.pSetLayouts = &set_layout;
        layouts.pushConstantRangeCount = 1;
        layouts.pPushConstantRanges = &push;
        check(vkCreatePipelineLayout(device, &layouts, nullptr, &layout), "vkCreatePipelineLayout");
        VkShaderModuleCreateInfo modules{VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO};
        modules.codeSize = sizeof work_spv;
        modules.pCode = work_spv;
        VkShaderModule module{};
        check(vkCreateShaderModule(device, &modules, nullptr, &module), "vkCreateShaderModule");
        VkComputePipelineCreateInfo create{VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO};
        create.stage = {VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO};
        create.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
        create.stage.module = module;
        create.stage.pName = "main";
        create.layout = layout;
        check(vkCreateComputePipelines(device, VK_NULL_HANDLE, 1, &create, nullptr, &pipeline), "vkCreateComputePipelines");
        bind_buffer(set_layout);
    }

    void bind_buffer(VkDescriptorSetLayout set_layout) {
        VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1};
        VkDescriptorPoolCreateInfo pools{VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO};
        pools.maxSets = 1;
        pools.poolSizeCount = 1;
        pools.pPoolSizes = &size;
        VkDescriptorPool pool{};
        check(vkCreateDescriptorPool(device, &pools, nullptr, &pool), "vkCreateDescriptorPool");
        VkDescriptorSetAllocateInfo allocate{VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO};
        allocate.descriptorPool = pool;
        allocate.descriptorSetCount = 1;
        allocate.pSetLayouts = &set_layout;
        check(vkAllocateDescriptorSets(device, &allocate, &set), "vkAllocateDescriptorSets");
        VkDescriptorBufferInfo whole{buffer, 0, VK_WHOLE_SIZE};
        VkWriteDescriptorSet write{VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET};
        write.dstSet = set;
        write.descriptorCount = 1;
        write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
        write.pBufferInfo = &whole;
        vkUpdateDescriptorSets(device, 1, &write, 0, nullptr);
    }

    void make_commands() {
        VkCommandPoolCreateInfo pools{VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
        pools.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
        pools.queueFamilyIndex = family;
        VkCommandPool pool{};
        check(vkCreateCommandPool(device, &pools, nullptr, &pool), "vkCreateCommandPool");
        VkCommandBufferAllocateInfo allocate{VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO};
        allocate.commandPool = pool;
        allocate.commandBufferCount = 1;
        check(vkAllocateCommandBuffers(device, &allocate, &commands), "vkAllocateCommandBuffers");
        VkFenceCreateInfo fences{VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
        check(vkCreateFence(device, &fences, nullptr, &fence), "vkCreateFence");
        if (valid_bits > 0) {
            VkQueryPoolCreateInfo create{VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO};
            create.queryType = VK_QUERY_TYPE_TIMESTAMP;
            create.queryCount = 2;
            check(vkCreateQueryPool(device, &create, nullptr, &queries), "vkCreateQueryPool");
        }
    }

    void record(uint32_t turns) {
        VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
        check(vkBeginCommandBuffer(commands, &begin), "vkBeginCommandBuffer");
        vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
        vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, layout, 0, 1, &set, 0, nullptr);
        vkCmdPushConstants(commands, layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, 4, &turns);
        if (valid_bits > 0) {
            vkCmdResetQueryPool(commands, queries, 0, 2);
            vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT, queries, 0);
        }
        vkCmdDispatch(commands, GROUPS, 1, 1);
        if (valid_bits > 0) {
            vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries, 1);
        }
        VkMemoryBarrier barrier{VK_STRUCTURE_TYPE_MEMORY_BARRIER, nullptr, VK_ACCESS_SHADER_WRITE_BIT, VK_ACCESS_HOST_READ_BIT};
        vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0,
                             nullptr, 0, nullptr);
        check(vkEndCommandBuffer(commands), "vkEndCommandBuffer");
    }

    // A counter has `valid_bits` bits and begins anew at its end; a tick has timestampPeriod nanoseconds.
    double between_timestamps() const {
        if (valid_bits == 0) {
            throw Fault("this queue has no timestamps", false);
        }
        uint64_t ticks[2] = {};
        check(vkGetQueryPoolResults(device, queries, 0, 2, sizeof ticks, ticks, sizeof ticks[0],
                                    VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
              "vkGetQueryPoolResults");
        const uint64_t mask = valid_bits >= 64 ? ~uint64_t{0} : (uint64_t{1} << valid_bits) - 1;
        const uint64_t between = (ticks[1] - ticks[0]) & mask;
        if (between == 0) {
            throw Fault("both timestamps of the dispatch are the same", false);
        }
        return static_cast<double>(between) * static_cast<double>(limits.limits.timestampPeriod);
    }

    VkPhysicalDevice physical{};
    VkPhysicalDeviceProperties limits{};
    uint32_t family = 0;
    uint32_t valid_bits = 0;
    VkDevice device{};
    VkQueue queue{};
    VkBuffer buffer{};
    volatile uint32_t *done = nullptr;
    VkPipelineLayout layout{};
    VkPipeline pipeline{};
    VkDescriptorSet set{};
    VkCommandBuffer commands{};
    VkFence fence{};
    VkQueryPool queries{};
};

json refusal(const std::string &reason, bool fatal, bool absent) {
    return {{"message", "fault"}, {"reason", reason}, {"fatal", fatal}, {"absent", absent}};
}

class Worker {
  public:
    explicit Worker(const Options &options) : options(options) {}

    json answer(const json &request) {
        const std::string message = request.at("message");
        if (message == "hello") {
            return {{"message", "hello"}, {"protocol", 1}, {"fathom_version", "vulkan_worker 1.0"},
                    {"adapter", gpu.adapter()}, {"parts", {"time"}}};
        }
        if (message == "prepare") {
            return prepare(request);
        }
        if (message == "sample") {
            return sample(request);
        }
        return {{"message", "unsupported"}, {"request", message}};
    }

  private:
    json prepare(const json &request) {
        if (request.at("pipeline") != "work") {
            return refusal("there is no pipeline but `work`", false, true);
        }
        const double turns = std::round(request.at("params").value("turns", 1000.0) * options.work);
        if (!(turns >= 1.0 && turns <= 1e5)) {
            return refusal("turns must lie in 1…100000", false, false);
        }
        const auto prepared = static_cast<uint32_t>(turns);
        gpu.sample(prepared, {options.work, true, false});  // Drivers compile shaders at their first dispatch.
        configurations[request.at("id")] = prepared;
        return {{"message", "prepared"}, {"stages", {{{"name", "turns"}, {"kind", "compute"}}}}};
    }

    json sample(const json &request) {
        const auto found = configurations.find(request.at("config"));
        if (found == configurations.end() || request.at("stage") != "turns") {
            return refusal("not prepared", false, false);
        }
        json ns = json::array();
        for (uint32_t frame = 0; frame < request.at("frames"); ++frame) {
            ns.push_back(gpu.sample(found->second, options));
        }
        return {{"message", "sample"}, {"ns", ns}};
    }

    Options options;
    Gpu gpu;
    std::map<std::string, uint32_t> configurations;
};

Options parsed(int count, char **words) {
    Options options;
    for (int at = 1; at < count; ++at) {
        const std::string word = words[at];
        if (word == "--work" && at + 1 < count) {
            options.work = std::stod(words[++at]);
        } else if (word == "--counted") {
            options.counted = true;
        } else if (word == "--timestamps") {
            options.timestamps = true;
        } else {
            throw std::invalid_argument("unknown argument " + word);
        }
    }
    return options;
}

}  // namespace

int main(int count, char **words) try {
    Worker worker(parsed(count, words));
    for (std::string line; std::getline(std::cin, line);) {
        json reply;
        try {
            const json request = json::parse(line);
            if (request.at("message") == "quit") {
                return 0;
            }
            reply = worker.answer(request);
        } catch (const Fault &fault) {
            reply = refusal(fault.what(), fault.fatal, false);
        } catch (const json::exception &error) {
            reply = refusal(error.what(), false, false);
        }
        std::cout << reply.dump() << std::endl;
    }
    return 0;
} catch (const std::exception &error) {
    std::cerr << "vulkan_worker: " << error.what() << '\n';
    return 1;
}
