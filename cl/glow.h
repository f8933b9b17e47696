/*
 * Light of pieces added up where LANES go side by side: they wait till there are some, of any pixels, and eight at a time
 * are looked up in places.h with the expressions of `light_between`, or lit by exact_light.h, and added in their order.
 * coverage.cl uses this.
 */
#if LANES > 1
#define GLOWS 64                     // a multiple of LANES

/* Pieces whose light is to be added: so many side by side. */
typedef struct {
    uint numbers[GLOWS] ALIGNED;
    float weights[GLOWS] ALIGNED;
    float ats[GLOWS] ALIGNED;        // where on their segments
    float4 *to[GLOWS];               // the light of their pixels
    float exact[3][GLOWS] ALIGNED;   // r, g, b of lights of which no places are known
    int n;
} Glow;

/* Light of those of n pieces that some lights fall on of which no places are known, eight at a time -> `exact`. */
INLINED void glow_exactly(Glow *glow, int n, const Sent *known)
{
    int which[GLOWS + LANES], left = 0;
    for (int k = 0; k < n; ++k) {
        which[left] = k;
        left += more_of(known, glow->numbers[k]) != 0;
    }
    for (int first = 0; first < left; first += LANES) {
        Row rows[LANES];
        uint numbers[LANES];
        lanes at, weight;
        lanes_i on;
        for (int k = 0; k < LANES; ++k) {
            const int j = which[first + k < left ? first + k : first];
            numbers[k] = glow->numbers[j];
            rows[k] = row_of(known, numbers[k]);
            LANE(at, k) = glow->ats[j];
            LANE(weight, k) = glow->weights[j];
            LANE_I(on, k) = first + k < left ? ON : 0;
        }
        lanes3 light = exact_light(known, numbers, rows, at, weight, on);
        for (int k = 0; k < LANES && first + k < left; ++k) {
            glow->exact[0][which[first + k]] = LANE(light.x, k);
            glow->exact[1][which[first + k]] = LANE(light.y, k);
            glow->exact[2][which[first + k]] = LANE(light.z, k);
        }
    }
}

/* Add the light of eight pieces: `light_between` for each light, with the same expressions. */
INLINED void glow_eight(const Glow *glow, int first, const Sent *known)
{
    __global const ulong *froms[LANES];
    lanes_i some = I(0);
    lanes light[8], rows[LANES];
    const lanes at = *(const lanes *)(glow->ats + first);
    const lanes along = at * FEW_PIECES;
    const lanes_i whole = WHOLE(along), piece = whole < FEW_PIECES - 1 ? whole : I(FEW_PIECES - 1);
    const lanes t = along - REAL(piece), parts[3] = {(1.0f - t) * (1.0f - 2.0f * t), 4.0f * t * (1.0f - t), t * (2.0f * t - 1.0f)};
    for (int k = 0; k < LANES; ++k)
        froms[k] = places_of(known, glow->numbers[first + k]);
    for (int i = 0; i < 8; ++i)
        light[i] = F(0.0f);
    for (int i = 0; i < known->sources; ++i) {
        lanes_i exact = I(0);
        lanes r[3], g[3], b[3];
        __global const ulong *starts[LANES];
        for (int k = 0; k < LANES; ++k) {
            LANE_I(exact, k) = froms[k][0] & MORE ? ON : 0;
            starts[k] = froms[k] + 2 * LANE_I(piece, k);
            froms[k] += FEW_PLACES;
        }
        some |= exact;
        for (int k = 0; k < 3; ++k) {
            const ulong8 here = (ulong8)(starts[0][k], starts[1][k], starts[2][k], starts[3][k], starts[4][k], starts[5][k],
                                         starts[6][k], starts[7][k]);
            r[k] = parts[k] * AS_F(TO(lanes_u, here >> 32) & 0x7FFFFC00u);
            g[k] = parts[k] * AS_F(TO(lanes_u, here >> 11) & 0x7FFFFC00u);
            b[k] = parts[k] * AS_F(TO(lanes_u, here) << 10 & 0x7FFFFC00u);
        }
        const lanes of_one[3] = {r[0] + r[1] + r[2], g[0] + g[1] + g[2], b[0] + b[1] + b[2]};
        lanes share = F(1.0f);
        if (known->deep.longest && i < known->lighting.n)
            share = share_deep(known, i, glow->numbers + first, at, *(const lanes *)(glow->weights + first),
                               (exact == 0) & ((of_one[0] > 0.0f) | (of_one[1] > 0.0f) | (of_one[2] > 0.0f)));
        for (int k = 0; k < 3; ++k)
            light[k] += ((exact == 0) & (of_one[k] > 0.0f)) ? share * of_one[k] : F(0.0f);
    }
    for (int k = 0; k < 3; ++k) {
        const lanes here = *(const lanes *)(glow->exact[k] + first);
        light[k] += (some & (here > 0.0f)) ? here : F(0.0f);
        light[k] = *(const lanes *)(glow->weights + first) * (light[k] < MOST ? light[k] : F(MOST));
    }
    transposed(light, rows);
    for (int k = 0; k < LANES; ++k)
        *glow->to[first + k] += rows[k].lo;
}

/* Add what waits. */
INLINED void glow_all(Glow *glow, const Sent *known)
{
    const int n = glow->n;
    for (int k = n; k & LANES - 1; ++k) {      // nothing of the last piece again
        glow->numbers[k] = glow->numbers[n - 1];
        glow->ats[k] = 0.0f;
        glow->weights[k] = 0.0f;
        glow->to[k] = glow->to[n - 1];
    }
    glow_exactly(glow, n, known);
    for (int k = 0; k < n; k += LANES)
        glow_eight(glow, k, known);
    glow->n = 0;
}

INLINED void add_glow(Glow *glow, const Sent *known, float4 *to, float weight, uint number, float at)
{
    const int n = glow->n++;
    PREFETCH(places_of(known, number));
    PREFETCH(places_of(known, number) + 4);
    if (known->deep.longest)
        PREFETCH(known->deep.axes + number);
    glow->numbers[n] = number;
    glow->weights[n] = weight;
    glow->ats[n] = at;
    glow->to[n] = to;
    if (n == GLOWS - 1)
        glow_all(glow, known);
}
#else
typedef struct {
    int n;                           // none wait
} Glow;

INLINED void glow_all(Glow *glow, const Sent *known)
{
}
#endif
