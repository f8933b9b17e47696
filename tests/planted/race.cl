/* All work-items write to one place. */
__kernel void race(const ulong begin, const ulong end, __global const uint *unwritten, __global uint *numbers)
{
    numbers[0] = get_global_id(0);   // caught: Write-write data race
}
