// Dispatches of any number of invocations: the host's `linear_workgroups` spreads them over x and y, as each axis has a limit.
#define_import_path fathom::dispatch

// Invocations of a workgroup.
const GROUP: u32 = 64u;

// Number of an invocation in such a dispatch.
fn invocation_index(id: vec3<u32>, groups: vec3<u32>) -> u32 {
    return id.x + id.y * groups.x * GROUP;
}
