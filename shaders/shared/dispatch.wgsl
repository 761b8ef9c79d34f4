// Dispatches of any number of invocations, spread over two dimensions. Host twin: `linear_workgroups` in src/gpu/kit/pass.rs.
#define_import_path fathom::dispatch

// Invocations of a workgroup.
const GROUP: u32 = 64u;

// Number of an invocation.
fn place(id: vec3<u32>, groups: vec3<u32>) -> u32 {
    return id.x + id.y * groups.x * GROUP;
}
