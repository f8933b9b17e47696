/* Half of a group waits at a barrier for the other half. */
__kernel void divergence(const ulong begin, const ulong end, __global const uint *unwritten, __global uint *numbers)
{
    const size_t i = get_global_id(0);
    if (i % 64 < 32)
        barrier(CLK_GLOBAL_MEM_FENCE);   // caught: Work-group divergence detected (barrier)
    numbers[i] = i;
}
