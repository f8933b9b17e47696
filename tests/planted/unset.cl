/* One of a work-item's own numbers has never been set. */
__kernel void unset(const ulong begin, const ulong end, __global const uint *unwritten, __global uint *numbers)
{
    const size_t i = get_global_id(0);
    uint own[4];
    own[i % 3] = 1;
    if (own[3] > 2)   // caught: Controlflow depends on uninitialized value
        numbers[i] = 0;
}
