/* A plain read of what others change atomically, as put in samples.h does where nothing is checked. */
__kernel void peek(const ulong begin, const ulong end, __global const uint *unwritten, __global uint *numbers)
{
    if (numbers[0] < 7)   // caught: Read-write data race
        atomic_max(&numbers[0], (uint)get_global_id(0));
}
