/*
 * Running sums along the light: how much of the hair lies before each layer of cells.
 *
 * One work-item sums 16 neighbouring columns as one vector, first as integers; only the sums become floats.
 */
LARGE __kernel void columns(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const uint *cells,            // [nz, ny, nx], nx a multiple of 16
    const uint layers,                     // nz
    const uint layer,                      // nx · ny
    const float scale,                     // one over the amount of one crossing
    __global float *sums)                  // [nz + 1, ny, nx] crossings before layer z; the last: behind all
{
    WORK_ITEM(i);
    const size_t at = 16 * i;
    uint16 sum = (uint16)(0u);
    for (size_t z = 0; z < layers; ++z) {
        vstore16(convert_float16(sum) * scale, 0, sums + z * layer + at);
        sum += vload16(0, cells + z * layer + at);
    }
    vstore16(convert_float16(sum) * scale, 0, sums + (size_t)layers * layer + at);
}
