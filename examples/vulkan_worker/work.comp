#version 450
// So many turns of a chain of multiplications and additions by each invocation.
layout(local_size_x = 64) in;
layout(push_constant) uniform Push { uint turns; };
layout(binding = 0) buffer Done {
    // Turns of all invocations together.
    uint done;
    float sums[];
};

void main() {
    float sum = 0.0;
    for (uint turn = 0; turn < turns; ++turn) {
        sum = sum * 0.999 + float(turn);
    }
    sums[gl_GlobalInvocationID.x] = sum;
    atomicAdd(done, turns);
}
