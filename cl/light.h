/*
 * The lights, what hair and body let through of each, and the strands that they fall on: shade.cl, strand_light.cl and
 * march.cl use this.
 */

/* Lights, and what stands before each. */
typedef struct {
    int n;
    __global const Light *lights;          // [n]
    __global const Shadow *shadows;        // [n] how what follows is looked up
    __global const Grid *grids;            // [n]
    __global const View *light_views;      // [n]
    __global const float *crossings;       // [nz + 1, ny, nx] before each layer of a grid; one grid's after the other
    __global const ulong *shadow_maps;     // [size] nearest body in a view; one view's after the other
} Lighting;

/* What stands before one of them: a copy, so that what a loop looks up again and again is at hand. */
typedef struct {
    Shadow shadow;
    Grid grid;
    View view;
    __global const float *crossings;
    __global const ulong *shadow_map;
    __global const uint *ranges;           // [BLOCKS, BLOCKS] the map's depths: see `depth_ranges` in strand_light.cl; 0: none
} Obstacles;

#define RANGE_BITS 15                             // of a depth that a range leaves out

/* How many texels a side the blocks of a map have of which `ranges` tell. */
inline int block_side(int2 size)
{
    return ((size.x > size.y ? size.x : size.y) + BLOCKS - 1) / BLOCKS;
}

/* Where in the arrays of all lights that of one begins: two halves of 64 bits. */
inline ulong place_of(int2 halves)
{
    return (ulong)as_uint(halves.y) << 32 | as_uint(halves.x);
}

inline Obstacles obstacles_of(const Lighting *lighting, int i)
{
    Obstacles obstacles;
    obstacles.shadow = lighting->shadows[i];
    obstacles.grid = lighting->grids[i];
    obstacles.view = lighting->light_views[i];
    obstacles.crossings = lighting->crossings + place_of(obstacles.shadow.place.xy);
    obstacles.shadow_map = lighting->shadow_maps + place_of(obstacles.shadow.place.zw);
    obstacles.ranges = 0;
    return obstacles;
}

/* Share of a light that the hair before p lets through: the light's running sums, read between four columns and two
   layers; full light outside the grid. self_shadow: what the strand that p lies on adds to the sum that is read
   there: x by its width, at w = 1, y whatever its width. */
inline float through_hair(const Obstacles *obstacles, float2 self_shadow, float4 p)
{
    const Grid *grid = &obstacles->grid;
    const float4 c = ((grid->to_grid[0] * p.x + grid->to_grid[1] * p.y) + grid->to_grid[2] * p.z) + grid->to_grid[3];
    if (!(c.w > 0.0f))
        return 1.0f;
    const float x = c.x / c.w - 0.5f, y = c.y / c.w - 0.5f, z = clamp(c.z, 0.0f, (float)grid->size.z);
    if (!(x > -1.0f && y > -1.0f && x < grid->size.x && y < grid->size.y))
        return 1.0f;
    const int x0 = (int)floor(x), y0 = (int)floor(y), z0 = min((int)z, grid->size.z - 1);
    const float fx = x - x0, fy = y - y0, fz = z - z0;
    /* Columns outside the grid hold nothing: their weight is 0, and another's place is read. */
    const int nx = grid->size.x, ny = grid->size.y;
    const float left = x0 >= 0 ? 1.0f - fx : 0.0f, right = x0 + 1 < nx ? fx : 0.0f;
    const float front = y0 >= 0 ? 1.0f - fy : 0.0f, back = y0 + 1 < ny ? fy : 0.0f;
    const int xa = max(x0, 0), xb = min(x0 + 1, nx - 1), ya = max(y0, 0), yb = min(y0 + 1, ny - 1);
    __global const float *near = obstacles->crossings + (size_t)z0 * nx * ny, *far = near + nx * ny;
    const float4 weights = (float4)(left * front, right * front, left * back, right * back);
    const float4 before = (float4)(near[ya * nx + xa], near[ya * nx + xb], near[yb * nx + xa], near[yb * nx + xb]);
    const float4 behind = (float4)(far[ya * nx + xa], far[ya * nx + xb], far[yb * nx + xa], far[yb * nx + xb]);
    const float4 there = weights * (before + fz * (behind - before));
    const float crossings = (there.x + there.y) + (there.z + there.w);
    return exp2(-1.44269504f * obstacles->shadow.hair.x * max(crossings - self_shadow.x / c.w - self_shadow.y, 0.0f));
}

#define HAIR_STEEPEST 5.0f                        // of `past_body`, for hair: by the body's normal at its root
#define HAIR_BIAS(radius) (1.0f + 2 * (radius))

#define STRIDE (LANES == 1 ? LOOK_AT_ONCE : 1)               // texels without a loop: llvmpipe ends long ones;
#define TOGETHER (LANES == 1 ? LOOK_AT_ONCE : 2)             // and places on discs, of which more are slower on PoCL

/* How many of the (2r + 1)² texels around texel (x0, y0) see what lies nearer to the light than a plane: at `nearest` there,
   dx and dy deeper a texel. */
inline int dark_texels(const Obstacles *obstacles, int x0, int y0, float nearest, float dx, float dy)
{
    const int width = obstacles->view.size.x, height = obstacles->view.size.y, radius = obstacles->shadow.body.y;
    const long plane_at = (long)(nearest * DEPTH_ONE), x_step = (long)(dx * DEPTH_ONE), y_step = (long)(dy * DEPTH_ONE);
    const int left = -radius > -x0 ? -radius : -x0, right = radius < width - 1 - x0 ? radius : width - 1 - x0;
    const int top = -radius > -y0 ? -radius : -y0, bottom = radius < height - 1 - y0 ? radius : height - 1 - y0;
    int dark = 0;
    if (radius == 1 && left == -1 && right == 1 && top == -1 && bottom == 1) {
        /* The usual case without loops, for a compiler that can't know it. */
        __global const ulong *middle = obstacles->shadow_map + (long)y0 * width + x0;
        const long least = DEPTH_ONE - plane_at;
        #pragma unroll
        for (int j = -1; j <= 1; ++j)
            #pragma unroll
            for (int k = -1; k <= 1; ++k) {
                const long seen = middle[j * width + k] >> 32;
                dark += (seen <= DEPTH_ONE) & (seen < least - k * x_step - j * y_step);
            }
        return dark;
    }
    for (int j = top; j <= bottom; ++j) {
        __global const ulong *row = obstacles->shadow_map + (long)(y0 + j) * width + x0;
        for (int k = left; k <= right; k += STRIDE)
            #pragma unroll
            for (int m = 0; m < STRIDE; ++m) {
                const int at = k + m <= right ? k + m : right;
                const long seen = row[at] >> 32;          /* above DEPTH_ONE where nothing is: p may lie far behind the map */
                dark += (k + m <= right) & (seen <= DEPTH_ONE) & (seen + plane_at + at * x_step + j * y_step < DEPTH_ONE);
            }
    }
    return dark;
}

/* What a light that is a disc sees of the body's map around (x, y, e): where that is before a plane, at `plane` in (0, 0), dx
   and dy deeper a texel, how much nearer to the light than e; 0 elsewhere. side: 1, what is before it is nearer to the light,
   or -1, further. */
inline float nearer_by(const Obstacles *obstacles, float x, float y, float e, float plane, float dx, float dy,
                        float side)
{
    const int width = obstacles->view.size.x, height = obstacles->view.size.y;
    const bool in = x >= 0.0f && y >= 0.0f && x < width && y < height;
    const int column = in ? (int)x : 0, row = in ? (int)y : 0;
    const ulong seen = in ? obstacles->shadow_map[(long)row * width + column] >> 32 : NOTHING;
    const float there = (float)((long)DEPTH_ONE - (long)seen) * (1.0f / DEPTH_ONE);
    return seen <= DEPTH_ONE && side * there > side * (plane + dx * (column + 0.5f) + dy * (row + 0.5f)) ? there - e : 0.0f;
}

/* Share of a disc that the body hides from (x, y, e) of a light's view (Fernando 2005, "Percentage-closer soft shadows"):
   first how far away what hides it is, on average over the disc, looked for closer together near the place; then how much
   of the map is nearer in a circle as wide as the disc looks through there.  plane, dx, dy, side: see `nearer_by`.  Below 0
   where that circle is no wider than the filter of a light without a size: it is asked instead. */
inline float hidden_share(const Obstacles *obstacles, float x, float y, float e, float plane, float dx, float dy, float side)
{
    const float disc = obstacles->shadow.disc.x, half_map = 0.5f * obstacles->view.size.x;
    const float reach = disc * (1.0f - e) < half_map ? disc * (1.0f - e) : half_map;
    float area = 0.0f, sum = 0.0f;
    int dark = 0;
    for (int i = 0; i < SEARCH_POINTS; i += TOGETHER)
        #pragma unroll
        for (int k = 0; k < TOGETHER; ++k) {
            const float2 point = SEARCH[i + k];
            const float square = point.x * point.x + point.y * point.y, far = reach * square;
            const float by = nearer_by(obstacles, x + far * point.x, y + far * point.y, e, plane, dx, dy, side);
            const bool hides = by > 0.0f && disc * disc * by * by >= far * far * square;
            const float its = square * square / (by * by);   /* the area on the disc that it hides */
            area += hides ? its : 0.0f;
            sum += hides ? its * by : 0.0f;
            dark += by > 0.0f;
        }
    const float radius = area > 0.0f ? disc * sum / area : 0.0f;
    if (radius < 0.5f + obstacles->shadow.body.y)
        return side < 0.0f ? 0.0f : -1.0f;
    if (dark == SEARCH_POINTS)             // all around, and further than the circle reaches
        return 1.0f;
    dark = 0;
    for (int i = 0; i < DISC_POINTS; i += TOGETHER)
        #pragma unroll
        for (int k = 0; k < TOGETHER; ++k) {
            const float2 point = DISC[i + k];
            const float by = nearer_by(obstacles, x + radius * point.x, y + radius * point.y, e, plane, dx, dy, side);
            dark += by > 0.0f && 4.0f * disc * disc * by * by >= radius * radius * (point.x * point.x + point.y * point.y);
        }
    return dark * (1.0f / DISC_POINTS);
}

/* How many of the texels around a place hide a light, of as many as its filter has. */
ONCE float texels_hidden(const Obstacles *obstacles, float x, float y, float e, float dx, float dy, float bias, bool away)
{
    const int x0 = (int)floor(x), y0 = (int)floor(y), side = 2 * obstacles->shadow.body.y + 1;
    if (obstacles->shadow.disc.x > 0.0f) {
        const float before = away ? -1.0f : 1.0f;
        const float share = hidden_share(obstacles, x, y, e, e + before * bias - dx * x - dy * y, dx, dy, before);
        if (!(share < 0.0f))
            return share * side * side;
    }
    return dark_texels(obstacles, x0, y0, e + bias + dx * (x0 + 0.5f - x) + dy * (y0 + 0.5f - y), dx, dy);
}

/* Share of a light that the body lets through to p: the report's equation 8, over (2r + 1)² texels around. What is seen
   there is held against the plane through p across n, the normal of what is drawn there or of the body at a strand's
   root, so that a slope does not shade itself; no steeper than `steepest` texels deep a texel, and level where n is 0.
   bias: in texels. */
inline float past_body(const Obstacles *obstacles, float4 p, float4 n, float steepest, float bias)
{
    const View *view = &obstacles->view;
    const int radius = obstacles->shadow.body.y;
    const float4 c = to_screen(view, p);
    if (!(c.w > 0.0f))
        return 1.0f;
    const float x = c.x / c.w, y = c.y / c.w, e = c.z / c.w;
    /* Projection takes the plane (n, -n·p) to a plane of (x, y, e): a x + b y + c e + d = 0. */
    const float4 plane = (float4)(n.xyz, -dot3(n, p));
    const float along_e = dot(plane, view->to_world[2]), texel = view->eye.w > 0.0f ? e / view->scale.x : 1.0f / view->size.x;
    const float limit = steepest * texel, flat = fabs(along_e) > 0.0f ? -1.0f / along_e : 0.0f;
    const float dx = clamp(dot(plane, view->to_world[0]) * flat, -limit, limit);
    const float dy = clamp(dot(plane, view->to_world[1]) * flat, -limit, limit);
    /* What lies nearer to the light than the plane by more than the bias. */
    return 1.0f - texels_hidden(obstacles, x, y, e, dx, dy, bias * texel, false) / ((2 * radius + 1) * (2 * radius + 1));
}

/* mix() without calling it, as PoCL would. */
inline float4 between(float4 a, float4 b, float at)
{
    return a + at * (b - a);
}

/* Share of the way from a to b at which p stands. */
inline float place_between(float4 a, float4 b, float4 p)
{
    float4 d = b - a, e = p - a;
    d.w = e.w = 0.0f;
    const float square = dot3(d, d);
    const float at = square > 0.0f ? dot3(d, e) / square : 0.0f;
    return at < 0.0f ? 0.0f : at < 1.0f ? at : 1.0f;
}

/* Where the point lies that came as number `came`: strands may have been put in order. */
inline uint lies_at(__global const uint *stored, uint run, uint came)
{
    return stored[came / run] + came % run;
}

/* Strands: see strands.cl. */
typedef struct {
    __global const float4 *points;
    __global const uint2 *spans;           // [strands] first point, points
    __global const uint *strand_of;        // [points / run]
    uint run;                              // points
    __global const float4 *strand_normal;  // [strands] of the body at the root, 0: not known
    __global const float4 *strand_uv;      // [strands] u, v, type
    __global const HairType *types;
    __global const float4 *colors;         // one, [strands] or [points]
    int color_per;                         // 0: one for all, 1: each strand, 2: each point
} Hair;

inline uint strand_at(const Hair *hair, uint id)
{
    return hair->strand_of[id / hair->run];
}

/* A segment's ends and the points of its strand before and behind these, or the ends themselves; a strand's last point
   begins one without length. */
typedef struct {
    float4 before, a, b, after;
} Segment;

inline Segment segment_at(const Hair *hair, uint id, uint2 span)
{
    Segment s;
    s.a = hair->points[id];
    s.b = id + 1 < span.x + span.y ? hair->points[id + 1] : s.a;
    s.before = id > span.x ? hair->points[id - 1] : s.a;
    s.after = id + 2 < span.x + span.y ? hair->points[id + 2] : s.b;
    return s;
}

/* Unit tangent at a segment's end: that of the chord between the end's neighbours, or of the segment where that has no
   length. */
inline float4 tangent_of(float4 chord, float4 along)
{
    chord.w = along.w = 0.0f;
    return unit_or(dot3(chord, chord) > 1e-30f ? chord : along, (float4)(0.0f, 1.0f, 0.0f, 0.0f));
}
