/*
 * Light that goes from hair to hair, of one place: transport.cl uses this, and lobes.h and sky.h before it.  A cell holds, of
 * each colour, the mean light from around each of DIRECTIONS.
 */

/* Where strands of one type along t look up how much light they send to the eye at v from directions l.  along: how many of
   their lobes are told apart along the strand; what is left is as the last of these. */
INLINED Sought sought_of(const Lobes *lobes, lanes3 t, lanes3 v, lanes3 l, int along)
{
    Sought sought;
    const lanes sine_v = within(dots(t, v), -1.0f, 1.0f), sine_l = within(dots(t, l), -1.0f, 1.0f);
    const lanes cosine_v = full_root(1.0f - sine_v * sine_v), cosine_l = full_root(1.0f - sine_l * sine_l);
    const lanes across = greater(cosine_v * cosine_l, F(1e-9f));
    const lanes angle = angle_of(within((dots(v, l) - sine_v * sine_l) / across, -1.0f, 1.0f));
    for (int p = 0; p < 4; ++p)
        sought.along[p] = p < along ? along_strand(lobes->along[p], sine_v, cosine_v, sine_l, cosine_l) : sought.along[along - 1];
    sought.cosine = 0.5f * (cosine_v + full_root(cosine_v)) * (lobes->table.y - 1.0f);
    sought.angle = angle * ((lobes->table.z - 1) / M_PI_F);
    return sought;
}

/* Light of one place of a look: r, g, b; as `around_strand`, with the nearest of the table's cosines: what is normalised needs no more. */
INLINED float4 nearly_around(const Sought *sought, int k, __global const float4 *row, int n_angles, int4 dark, float4 pale)
{
    const float4 along = (float4)(LANE(sought->along[0], k), LANE(sought->along[1], k), LANE(sought->along[2], k),
                                  LANE(sought->along[3], k));
    const float y = LANE(sought->angle, k);
    const int j = y < n_angles - 1 ? (int)y : n_angles - 2;
    const float below = y - j;
    __global const float4 *a = row + j * SHADES, *b = a + SHADES;
    const float4 near = (1.0f - below) * along, far = below * along;
    const float4 r = near * (a[dark.x] + pale.x * (a[dark.x + 1] - a[dark.x])) + far * (b[dark.x] + pale.x * (b[dark.x + 1] - b[dark.x]));
    const float4 g = near * (a[dark.y] + pale.y * (a[dark.y + 1] - a[dark.y])) + far * (b[dark.y] + pale.y * (b[dark.y + 1] - b[dark.y]));
    const float4 c = near * (a[dark.z] + pale.z * (a[dark.z + 1] - a[dark.z])) + far * (b[dark.z] + pale.z * (b[dark.z + 1] - b[dark.z]));
    return (float4)((r.x + r.y) + (r.z + r.w), (g.x + g.y) + (g.z + g.w), (c.x + c.y) + (c.z + c.w), 0.0f);
}

/* Share of all light around that hair along t sends to the eye at v; shade: 0 black, SHADES - 1 white.
   albedos: of its type, [ALBEDOS, SHADES]. */
INLINED float albedo_of(__global const float *albedos, float4 t, float4 v, float shade)
{
    const float sine = dot3(t, v), square = 1.0f - sine * sine, cosine = square > 0.0f ? sqrt(square) : 0.0f;
    const float x = 0.5f * (cosine + sqrt(cosine)) * (ALBEDOS - 1), z = shade < SHADES - 1 ? shade : SHADES - 1.0f;
    const int i = x < ALBEDOS - 2 ? (int)x : ALBEDOS - 2, k = z < SHADES - 2 ? (int)z : SHADES - 2;
    const float fx = x - i, fz = z - k;
    __global const float *a = albedos + i * SHADES + k, *b = a + SHADES;
    return (1.0f - fx) * (a[0] + fz * (a[1] - a[0])) + fx * (b[0] + fz * (b[1] - b[0]));
}

/* Shades of a colour, see `shade_of`. */
INLINED float4 shades_of(float4 color, float fall)
{
    const lanes r = shade_of(F(color.x), fall), g = shade_of(F(color.y), fall), b = shade_of(F(color.z), fall);
    return (float4)(LANE(r, 0), LANE(g, 0), LANE(b, 0), 0.0f);
}

/* Eight cells around a place, and the weight of each. */
typedef struct {
    size_t cells[8];
    float weights[8];
} Around;

INLINED Around around_place(const Sky *sky, float4 p)
{
    Around around;
    const int n = sky->size.x;
    const Between between = cells_around(sky, p);
    const float fx = between.x, fy = between.y, fz = between.z;
    for (int k = 0; k < 8; ++k) {
        around.cells[k] = between.first + ((size_t)(k >> 2) * n + (k >> 1 & 1)) * n + (k & 1);
        around.weights[k] = ((k & 1) ? fx : 1.0f - fx) * ((k & 2) ? fy : 1.0f - fy) * ((k & 4) ? fz : 1.0f - fz);
    }
    return around;
}

/* What hair along t sends to the eye at v of the light of cells: a mean of it, weighted by how much hair scatters from each
   direction, times its albedo: no light is made, however few the directions are. */
ONCE float4 scattered_at(const Sky *sky, __global const float *light, __global const float *directions,
                         const Lobes *lobes, __global const float4 *table, __global const float *albedos, float4 p, float4 t,
                         float4 v, float4 shades)
{
    const Around around = around_place(sky, p);
    const lanes3 along = all_lanes(t), eye = all_lanes(v);
    float4 sum = 0.0f, total = 0.0f;
    const float sine = dot3(t, v), square = 1.0f - sine * sine, cosine = square > 0.0f ? sqrt(square) : 0.0f;
    const int nearest = (int)(0.5f * (cosine + sqrt(cosine)) * (lobes->table.y - 1) + 0.5f);
    __global const float4 *row = table + lobes->table.x + (size_t)nearest * lobes->table.z * SHADES;
    const float4 cut = shades < SHADES - 1.5f ? shades : SHADES - 1.5f;
    const int4 dark = convert_int4(cut);
    const float4 pale = shades - convert_float4(dark);
    for (int first = 0; first < DIRECTIONS; first += LANES) {
        const lanes3 l = {*(__global const lanes *)(directions + first), *(__global const lanes *)(directions + DIRECTIONS + first),
                          *(__global const lanes *)(directions + 2 * DIRECTIONS + first)};
        lanes3 in = {F(0.0f), F(0.0f), F(0.0f)};
        for (int k = 0; k < 8; ++k) {
            __global const float *there = light + around.cells[k] * (CHANNELS * DIRECTIONS) + first;
            in.x += around.weights[k] * *(__global const lanes *)there;
            in.y += around.weights[k] * *(__global const lanes *)(there + DIRECTIONS);
            in.z += around.weights[k] * *(__global const lanes *)(there + 2 * DIRECTIONS);
        }
        Sought sought = sought_of(lobes, along, eye, l, 3);
        for (int k = 0; k < LANES; ++k) {
            const float4 sent = nearly_around(&sought, k, row, lobes->table.z, dark, pale);
            sum += sent * (float4)(LANE(in.x, k), LANE(in.y, k), LANE(in.z, k), 0.0f);
            total += sent;
        }
    }
    const float4 albedo = (float4)(albedo_of(albedos, t, v, shades.x), albedo_of(albedos, t, v, shades.y),
                                   albedo_of(albedos, t, v, shades.z), 0.0f);
    return (float4)(total.x > 1e-20f ? albedo.x * sum.x / total.x : 0.0f, total.y > 1e-20f ? albedo.y * sum.y / total.y : 0.0f,
                    total.z > 1e-20f ? albedo.z * sum.z / total.z : 0.0f, 0.0f);
}
