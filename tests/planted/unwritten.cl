/* Reads a buffer that nobody has written to. */
__kernel void unwritten(const ulong begin, const ulong end, __global const uint *unwritten, __global uint *numbers)
{
    const size_t i = get_global_id(0);
    numbers[i] = 2 * unwritten[i];   // caught: Uninitialized value written to global memory
}
