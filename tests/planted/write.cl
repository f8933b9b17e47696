/* The last work-item writes one number beyond the end. */
__kernel void write(const ulong begin, const ulong end, __global const uint *unwritten, __global uint *numbers)
{
    numbers[get_global_id(0) + 1] = 1;   // caught: Invalid write of size 4
}
