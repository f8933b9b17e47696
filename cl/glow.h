/*
 * Light of pieces added up where LANES go side by side: they wait till there are some, of any pixels, and eight at a time
 * are looked up in places.h with the expressions of `light_between`, and added in their order.  coverage.cl uses this.
 */
#if LANES > 1
#define GLOWS 64                     // a multiple of LANES

/* Pieces whose light is to be added: so many side by side. */
typedef struct {
    uint numbers[GLOWS] ALIGNED, wheres[GLOWS] ALIGNED;
    float weights[GLOWS] ALIGNED;
    float4 *to[GLOWS];               // the light of their pixels
    int n;
} Glow;

/* Add the light of eight pieces: `light_between`, with the same expressions. */
INLINED void glow_eight(const Glow *glow, int first, __global const ulong *places, __global const ulong *more)
{
    __global const ulong *froms[LANES];
    float ts[LANES] ALIGNED;
    uint on_edge = 0;
    lanes light[8], rows[LANES];
    const lanes at = TO(lanes, *(const lanes_u *)(glow->wheres + first) & 0xFFFF) * (1.0f / 65535.0f);
    const lanes along = at * FEW_PIECES;
    const lanes_i whole = WHOLE(along), piece = whole < FEW_PIECES - 1 ? whole : I(FEW_PIECES - 1);
    *(lanes *)ts = along - REAL(piece);
    for (int k = 0; k < LANES; ++k) {
        __global const ulong *few = places + FEW_PLACES * (size_t)glow->numbers[first + k], *from = few + 2 * LANE_I(piece, k);
        const ulong start = few[0];
        if (start & MORE) {
            const float far = LANE(at, k) * MANY_PIECES;
            const int over = (int)far, there = over < MANY_PIECES - 1 ? over : MANY_PIECES - 1;
            from = more + (MANY_PLACES + 1) * (start & ROW) + 2 * there;
            ts[k] = far - there;
            on_edge |= start & ON_EDGE ? 1u << k : 0;
        }
        froms[k] = from;
    }
    const lanes t = *(const lanes *)ts, parts[3] = {(1.0f - t) * (1.0f - 2.0f * t), 4.0f * t * (1.0f - t), t * (2.0f * t - 1.0f)};
    lanes r[3], g[3], b[3];
    for (int k = 0; k < 3; ++k) {
        const ulong8 here = (ulong8)(froms[0][k], froms[1][k], froms[2][k], froms[3][k], froms[4][k], froms[5][k], froms[6][k],
                                     froms[7][k]);
        r[k] = parts[k] * AS_F(TO(lanes_u, here >> 32) & 0x7FFFFC00u);
        g[k] = parts[k] * AS_F(TO(lanes_u, here >> 11) & 0x7FFFFC00u);
        b[k] = parts[k] * AS_F(TO(lanes_u, here) << 10 & 0x7FFFFC00u);
    }
    light[0] = r[0] + r[1] + r[2];
    light[1] = g[0] + g[1] + g[2];
    light[2] = b[0] + b[1] + b[2];
    for (; on_edge; on_edge &= on_edge - 1) {
        const int k = first_of(on_edge);
        const float4 here = light_between(places + FEW_PLACES * (size_t)glow->numbers[first + k], more, LANE(at, k));
        LANE(light[0], k) = here.x;
        LANE(light[1], k) = here.y;
        LANE(light[2], k) = here.z;
    }
    for (int k = 0; k < 3; ++k) {
        const lanes above = light[k] > 0.0f ? light[k] : F(0.0f);
        light[k] = *(const lanes *)(glow->weights + first) * (above < MOST ? above : F(MOST));
    }
    for (int k = 3; k < 8; ++k)
        light[k] = F(0.0f);
    transposed(light, rows);
    for (int k = 0; k < LANES; ++k)
        *glow->to[first + k] += rows[k].lo;
}

/* Add what waits. */
INLINED void glow_all(Glow *glow, __global const ulong *places, __global const ulong *more)
{
    const int n = glow->n;
    for (int k = n; k & LANES - 1; ++k) {      // nothing of the last piece again
        glow->numbers[k] = glow->numbers[n - 1];
        glow->wheres[k] = 0;
        glow->weights[k] = 0.0f;
        glow->to[k] = glow->to[n - 1];
    }
    for (int k = 0; k < n; k += LANES)
        glow_eight(glow, k, places, more);
    glow->n = 0;
}

INLINED void add_glow(Glow *glow, __global const ulong *places, __global const ulong *more, float4 *to, float weight, uint number,
                   uint where)
{
    const int n = glow->n++;
    PREFETCH(places + FEW_PLACES * (size_t)number);
    PREFETCH(places + FEW_PLACES * (size_t)number + 4);
    glow->numbers[n] = number;
    glow->wheres[n] = where;
    glow->weights[n] = weight;
    glow->to[n] = to;
    if (n == GLOWS - 1)
        glow_all(glow, places, more);
}
#else
typedef struct {
    int n;                           // none wait
} Glow;

INLINED void glow_all(Glow *glow, __global const ulong *places, __global const ulong *more)
{
}
#endif
