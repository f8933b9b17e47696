/*
 * Light of pieces added up where LANES go side by side: they wait till there are some, of any pixels, and eight at a time
 * are looked up in places.h with the expressions of `light_between`, or lit by exact_light.h, and added in their order.
 * Or they are stored meanwhile, and their segments marked: so only those get light that are seen.  coverage.cl uses this.
 */
#define LIGHT_AT_ONCE 0              // of all segments light is known;
#define LIGHT_LATER 1                // of none: pieces are stored, and their segments marked;
#define LIGHT_NOW 2                  // of these

#if LANES > 1
/* Pieces that are stored till there is light, GLOWS in a bundle; those of a tile are a chain of bundles. */
typedef struct {
    int when;                        // is light added: see above
    uint room;                       // for bundles
    volatile __global uint *taken;   // [1] of these
    __global uint8 *bundles;         // [room, 3, GLOWS / 8] numbers, wheres, weights
    __global uint *nexts;            // [room] the next bundle of the tile, and 1; 0: none
    __global uint *heads;            // [tiles] the first one likewise, or NOTHING where there was no room
    __global uchar *marks;           // [segments] 1: it has light to add
    __global const uint *slots;      // [segments] whose places and rows of `more` these have
} Store;

/* Pieces whose light is to be added: so many side by side. */
typedef struct {
    uint numbers[GLOWS + SLOTS] ALIGNED;     // and those that settle.h puts behind them
    uint wheres[GLOWS + SLOTS] ALIGNED;      // on the segment, in 1/65535, and << 16 the pixel in its tile
    float weights[GLOWS + SLOTS] ALIGNED;
    uint slots[GLOWS] ALIGNED;       // where their places are
    float light[3][GLOWS] ALIGNED;   // r, g, b that their segments send
    float4 lights[TILE * TILE];      // of pixels, so far
    int n;
    int left, top;                   // the tile's first pixel, in the picture
    uint first, last;                // bundles of the tile, and 1; NOTHING: there was no room for all
    const Store *store;
} Glow;

/* Add the light that no places tell of, to n pieces that have some; which: these, LANES at a time. */
INLINED void glow_exactly(Glow *glow, const int *which, int n, const Sent *known)
{
    for (int first = 0; first < n; first += LANES) {
        Row rows[LANES];
        uint slots[LANES];
        lanes at, weight, x, y;
        lanes_i on;
        for (int k = 0; k < LANES; ++k) {
            const int j = which[first + k < n ? first + k : first];
            slots[k] = glow->slots[j];
            rows[k] = row_of(known, slots[k]);
            LANE(at, k) = (glow->wheres[j] & 0xFFFF) * (1.0f / 65535.0f);
            LANE(weight, k) = glow->weights[j];
            LANE(x, k) = glow->left + (int)(glow->wheres[j] >> 16) % TILE + 0.5f;
            LANE(y, k) = glow->top + (int)(glow->wheres[j] >> 16) / TILE + 0.5f;
            LANE_I(on, k) = first + k < n ? ON : 0;
        }
        lanes3 light = exact_light(known, slots, rows, at, weight, x, y, on);
        for (int k = 0; k < LANES && first + k < n; ++k) {
            float *to = &glow->light[0][which[first + k]];
            to[0] += LANE(light.x, k) > 0.0f ? LANE(light.x, k) : 0.0f;
            to[GLOWS] += LANE(light.y, k) > 0.0f ? LANE(light.y, k) : 0.0f;
            to[2 * GLOWS] += LANE(light.z, k) > 0.0f ? LANE(light.z, k) : 0.0f;
        }
    }
}

typedef float8 float8_at_8 __attribute__((aligned(8)));   // four places
typedef char there_are_two_pieces[FEW_PIECES == 2 ? 1 : -1];
#define PACKED(bits) AS_F((bits) & 0x7FFFFC00u)   // see places.h

/* Light of eight pieces: `light_between` for each light, with the same expressions -> those that some lights fall on of which
   no places are known, a bit each. */
INLINED uint look_up(Glow *glow, int first, const Sent *known)
{
    __global const ulong *starts[LANES];
    float8 four[LANES];                    // the first four of each one's places, or the last four
    lanes halves[8];
    lanes_i some = I(0);
    lanes3 light = {F(0.0f), F(0.0f), F(0.0f)};
    const lanes at = TO(lanes, *(const lanes_u *)(glow->wheres + first) & 0xFFFF) * (1.0f / 65535.0f);
    const lanes weight = *(const lanes *)(glow->weights + first), along = at * FEW_PIECES;
    const lanes_i later = along >= 1.0f, piece = -later;   // whether in the second piece of two
    const lanes t = along - REAL(piece), u = (1.0f - t) * (1.0f - 2.0f * t), v = 4.0f * t * (1.0f - t), w = t * (2.0f * t - 1.0f);
    const lanes_i pixel = TO(lanes_i, *(const lanes_u *)(glow->wheres + first) >> 16);
    const lanes x = TO(lanes, glow->left + pixel % TILE) + 0.5f, y = TO(lanes, glow->top + pixel / TILE) + 0.5f;
    #pragma unroll
    for (int k = 0; k < LANES; ++k)
        starts[k] = places_of(known, glow->slots[first + k]) + LANE_I(piece, k);
    for (int i = 0; i < known->sources; ++i) {
        #pragma unroll
        for (int k = 0; k < LANES; ++k) {
            four[k] = *(__global const float8_at_8 *)starts[k];
            starts[k] += FEW_PLACES;
        }
        transposed(four, halves);
        /* The three that its piece lies between: halves of 64 bits, low ones first. */
        const lanes_u a = AS_U(later ? halves[2] : halves[0]), a_high = AS_U(later ? halves[3] : halves[1]);
        const lanes_u b = AS_U(later ? halves[4] : halves[2]), b_high = AS_U(later ? halves[5] : halves[3]);
        const lanes_u c = AS_U(later ? halves[6] : halves[4]), c_high = AS_U(later ? halves[7] : halves[5]);
        const lanes_i exact = AS_I(a_high) < 0;   // MORE, of all places
        const lanes3 its = {
            u * PACKED(a_high) + v * PACKED(b_high) + w * PACKED(c_high),
            u * PACKED(a_high << 21 | a >> 11) + v * PACKED(b_high << 21 | b >> 11) + w * PACKED(c_high << 21 | c >> 11),
            u * PACKED(a << 10) + v * PACKED(b << 10) + w * PACKED(c << 10)};
        lanes share = F(1.0f);
        if (known->deep.longest && i < known->lighting.n)
            share = share_deep(known, i, glow->slots + first, at, weight, x, y,
                               (exact == 0) & ((its.x > 0.0f) | (its.y > 0.0f) | (its.z > 0.0f)));
        some |= exact;
        light.x += ((exact == 0) & (its.x > 0.0f)) ? share * its.x : F(0.0f);
        light.y += ((exact == 0) & (its.y > 0.0f)) ? share * its.y : F(0.0f);
        light.z += ((exact == 0) & (its.z > 0.0f)) ? share * its.z : F(0.0f);
    }
    *(lanes *)(glow->light[0] + first) = light.x;
    *(lanes *)(glow->light[1] + first) = light.y;
    *(lanes *)(glow->light[2] + first) = light.z;
    return bits_of(some);
}

/* Add the light of eight pieces to their pixels'. */
INLINED void add_eight(Glow *glow, int first)
{
    const lanes weight = *(const lanes *)(glow->weights + first), none = F(0.0f);
    lanes sent[8] = {none, none, none, none, none, none, none, none}, rows[LANES];
    #pragma unroll
    for (int c = 0; c < 3; ++c) {
        const lanes light = *(const lanes *)(glow->light[c] + first);
        sent[c] = weight * (light < MOST ? light : F(MOST));
    }
    transposed(sent, rows);
    /* Pieces of a pixel follow each other: its sum stays in a register. */
    uint at_pixel = glow->wheres[first] >> 16;
    float4 sum = glow->lights[at_pixel];
    #pragma unroll
    for (int k = 0; k < LANES; ++k) {
        const uint its = glow->wheres[first + k] >> 16;
        if (RARELY(its != at_pixel)) {
            glow->lights[at_pixel] = sum;
            at_pixel = its;
            sum = glow->lights[at_pixel];
        }
        sum += rows[k].lo;
    }
    glow->lights[at_pixel] = sum;
}

/* Store what waits, GLOWS pieces. */
INLINED void store_glow(Glow *glow)
{
    const Store *store = glow->store;
    const uint bundle = atomic_inc(store->taken);
    if (bundle >= store->room) {
        glow->first = NOTHING;
        return;
    }
    __global uint8 *to = store->bundles + bundle * (3 * GLOWS / 8);
    for (int k = 0; k < GLOWS / 8; ++k) {
        to[k] = ((const uint8 *)glow->numbers)[k];
        to[GLOWS / 8 + k] = ((const uint8 *)glow->wheres)[k];
        to[2 * GLOWS / 8 + k] = ((const uint8 *)glow->weights)[k];
    }
    for (int k = 0; k < GLOWS; ++k)
        store->marks[glow->numbers[k]] = 1;    // whoever comes first
    store->nexts[bundle] = 0;
    if (glow->last)
        store->nexts[glow->last - 1] = bundle + 1;
    else
        glow->first = bundle + 1;
    glow->last = bundle + 1;
}

/* Add n pieces whose slots are known, and nothing of so many others that LANES divides their number. */
ONCE void glow_known(Glow *glow, int n, const Sent *known)
{
    int which[GLOWS], left = 0;
    for (int k = 0; k < n; k += LANES)
        for (uint bits = look_up(glow, k, known); bits; bits &= bits - 1)
            which[left++] = k + __builtin_ctz(bits);
    while (left && which[left - 1] >= n)
        --left;
    if (left)
        glow_exactly(glow, which, left, known);
    for (int k = 0; k < n; k += LANES)
        add_eight(glow, k);
}

/* Add what waits, or store it. */
INLINED void glow_all(Glow *glow, const Sent *known)
{
    const int n = glow->n;
    const bool later = glow->store->when == LIGHT_LATER;
    if (!n)
        return;
    for (int k = n; k & (later ? GLOWS : LANES) - 1; ++k) {      // nothing of the last piece again
        glow->numbers[k] = glow->numbers[n - 1];
        glow->wheres[k] = glow->wheres[n - 1];
        glow->weights[k] = 0.0f;
    }
    glow->n = 0;
    if (later) {
        if (glow->first != NOTHING)
            store_glow(glow);
        return;
    }
    if (glow->store->when == LIGHT_NOW)
        for (int k = 0; k < (n + LANES - 1 & -LANES); ++k)
            glow->slots[k] = glow->store->slots[glow->numbers[k]];
    else
        for (int k = 0; k < n; k += LANES)
            *(lanes_u *)(glow->slots + k) = *(const lanes_u *)(glow->numbers + k);
    glow_known(glow, n, known);
}

/* The light of n pieces more is to be added, SLOTS at most, that have been put behind those that wait. */
INLINED void add_glow(Glow *glow, const Sent *known, int n)
{
    const int first = glow->n, until = first + n;
    for (int k = first; k < until && glow->store->when == LIGHT_AT_ONCE; ++k) {
        PREFETCH(places_of(known, glow->numbers[k]) + 4);   // their first ones are when it is drawn
        if (known->deep.longest)
            PREFETCH(known->deep.axes + glow->numbers[k]);
    }
    glow->n = until;
    if (until < GLOWS)
        return;
    glow->n = GLOWS;
    glow_all(glow, known);
    glow->n = until - GLOWS;
    for (int k = 0; k < SLOTS; k += 8) {
        *(uint8 *)(glow->numbers + k) = *(const uint8 *)(glow->numbers + GLOWS + k);
        *(uint8 *)(glow->wheres + k) = *(const uint8 *)(glow->wheres + GLOWS + k);
        *(float8 *)(glow->weights + k) = *(const float8 *)(glow->weights + GLOWS + k);
    }
}

/* Begin with a tile, from pixel left, top on. */
INLINED void begin_glow(Glow *glow, const Store *store, int left, int top)
{
    glow->left = left;
    glow->top = top;
    glow->n = 0;
    glow->first = glow->last = 0;
    glow->store = store;
    for (int p = 0; p < TILE * TILE; ++p)
        glow->lights[p] = 0.0f;
}

/* Add the light of a tile's pieces that were stored: next: its first bundle's number, and 1.  What the next bundle needs is
   on its way while one is added. */
INLINED void glow_stored(Glow *glow, const Sent *known, uint next)
{
    const Store *store = glow->store;
    uint slots[2][GLOWS] ALIGNED, bundle = 0;
    for (int turn = 0; bundle || next; turn = 1 - turn) {
        const __global uint8 *from = store->bundles + (bundle ? bundle - 1 : 0) * (3 * GLOWS / 8);
        if (next) {
            const __global uint *numbers = (const __global uint *)(store->bundles + (next - 1) * (3 * GLOWS / 8));
            for (int k = 0; k < GLOWS; ++k) {
                slots[turn][k] = store->slots[numbers[k]];
                PREFETCH(places_of(known, slots[turn][k]));
                PREFETCH(places_of(known, slots[turn][k]) + 4);
                if (known->deep.longest)
                    PREFETCH(known->deep.axes + slots[turn][k]);
            }
            for (int k = 0; k < 3 * GLOWS; k += 16)
                PREFETCH(numbers + k);
        }
        if (bundle) {
            for (int k = 0; k < GLOWS / 8; ++k) {
                ((uint8 *)glow->numbers)[k] = from[k];
                ((uint8 *)glow->wheres)[k] = from[GLOWS / 8 + k];
                ((uint8 *)glow->weights)[k] = from[2 * GLOWS / 8 + k];
                ((uint8 *)glow->slots)[k] = ((const uint8 *)slots[1 - turn])[k];
            }
            glow_known(glow, GLOWS, known);
        }
        bundle = next;
        next = next ? store->nexts[next - 1] : 0;
    }
}
#else
typedef struct {
    int n;                           // none wait
} Glow;
#endif
