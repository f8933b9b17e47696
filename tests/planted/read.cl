/* The last work-item reads one number beyond the end. */
__kernel void read(const ulong begin, const ulong end, __global const uint *unwritten, __global uint *numbers)
{
    const size_t i = get_global_id(0);
    const uint next = numbers[i + 1];   // caught: Invalid read of size 4
    barrier(CLK_GLOBAL_MEM_FENCE);
    numbers[i] = next;
}
