/*
 * Strands between guides: the user's strands that stand on the mesh.  A tree of boxes tells which guides are nearest to a
 * root; their shapes are turned from the skin where they stand to the skin at the root, and blended there.
 */

/* A tree is a heap: node 0 is the whole, node n is made of 8 n + 1 to 8 n + 8, and each of the last row holds up to eight
   members.  A node has the boxes of its eight parts side by side; that of nothing is infinitely far. */

/* Squares of the distances to eight boxes: rounding makes them no larger than the same of a point within, as `dot3` has it. */
inline float8 to_boxes(float4 p, __global const float8 *boxes)
{
    const float8 below_x = boxes[0] - p.x, below_y = boxes[1] - p.y, below_z = boxes[2] - p.z;
    const float8 above_x = p.x - boxes[3], above_y = p.y - boxes[4], above_z = p.z - boxes[5];
    float8 x = below_x > above_x ? below_x : above_x, y = below_y > above_y ? below_y : above_y;
    float8 z = below_z > above_z ? below_z : above_z;
    x = x > 0.0f ? x : 0.0f;
    y = y > 0.0f ? y : 0.0f;
    z = z > 0.0f ? z : 0.0f;
    return (x * x + y * y) + z * z;
}

/* The least of eight, and which one that is. */
inline float least_of(float8 v, uint *which)
{
    const float4 four = v.lo < v.hi ? v.lo : v.hi;
    const float2 two = four.lo < four.hi ? four.lo : four.hi;
    const float least = two.x < two.y ? two.x : two.y;
    const int8 place = v == least ? (int8)(0, 1, 2, 3, 4, 5, 6, 7) : 8;
    const int4 of_four = place.lo < place.hi ? place.lo : place.hi;
    const int2 of_two = of_four.lo < of_four.hi ? of_four.lo : of_four.hi;
    *which = of_two.x < of_two.y ? of_two.x : of_two.y;
    return least;
}

/* A walk through a tree, the nearest parts first. */
typedef struct {
    float8 waiting[TREE_ROWS];   // squares of the distances to parts of the nodes from the whole down to this one; no longer
                                 // to be seen: INFINITY
    uint node;
    int row;                     // of this node
} Walk;

inline void begin_walk(Walk *walk, float4 p, __global const float8 *boxes)
{
    walk->node = walk->row = 0;
    walk->waiting[0] = to_boxes(p, boxes);
}

/* The next member that may be as near as `most`, as 8 times its node in the last row and its place there; NOTHING: none. */
inline uint next_member(Walk *walk, float4 p, __global const float8 *boxes, int last, float most)
{
    while (walk->row >= 0) {
        uint which;
        const float8 here = walk->waiting[walk->row];
        const float near = least_of(here, &which);
        if (near > most || near == INFINITY) {
            --walk->row;
            walk->node = (walk->node - 1) / 8;
            continue;
        }
        walk->waiting[walk->row] = (int8)(which) == (int8)(0, 1, 2, 3, 4, 5, 6, 7) ? INFINITY : here;
        if (walk->row == last)
            return 8 * walk->node + which;
        walk->node = 8 * walk->node + 1 + which;
        ++walk->row;
        walk->waiting[walk->row] = to_boxes(p, boxes + 6 * walk->node);
    }
    return NOTHING;
}

/* Weights of the corners of a triangle whose mean is its place nearest to p (Ericson, "Real-time collision detection",
   2005, 5.1.5). */
inline float4 nearest_in(float4 p, float4 a, float4 b, float4 c)
{
    const float4 ab = b - a, ac = c - a;
    const float d1 = dot3(ab, p - a), d2 = dot3(ac, p - a), d3 = dot3(ab, p - b), d4 = dot3(ac, p - b);
    const float d5 = dot3(ab, p - c), d6 = dot3(ac, p - c);
    if (d1 <= 0.0f && d2 <= 0.0f)
        return (float4)(1.0f, 0.0f, 0.0f, 0.0f);
    if (d3 >= 0.0f && d4 <= d3)
        return (float4)(0.0f, 1.0f, 0.0f, 0.0f);
    if (d6 >= 0.0f && d5 <= d6)
        return (float4)(0.0f, 0.0f, 1.0f, 0.0f);
    const float of_c = d1 * d4 - d3 * d2, of_b = d5 * d2 - d1 * d6, of_a = d3 * d6 - d5 * d4;
    if (of_c <= 0.0f && d1 >= 0.0f && d3 <= 0.0f) {
        const float t = d1 - d3 > 0.0f ? d1 / (d1 - d3) : 0.0f;
        return (float4)(1.0f - t, t, 0.0f, 0.0f);
    }
    if (of_b <= 0.0f && d2 >= 0.0f && d6 <= 0.0f) {
        const float t = d2 - d6 > 0.0f ? d2 / (d2 - d6) : 0.0f;
        return (float4)(1.0f - t, 0.0f, t, 0.0f);
    }
    if (of_a <= 0.0f && d4 >= d3 && d5 >= d6) {
        const float along = (d4 - d3) + (d5 - d6), t = along > 0.0f ? (d4 - d3) / along : 0.0f;
        return (float4)(0.0f, 1.0f - t, t, 0.0f);
    }
    const float sum = of_a + of_b + of_c, u = of_b / sum, v = of_c / sum;
    return (float4)(1.0f - u - v, u, v, 0.0f);
}

/* The place of the mesh that is nearest to a guide's root, of equal ones that of the lowest face, and the normal there. */
__kernel void stand(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *roots,          // [guides] x, y, z [world]
    __global const float8 *boxes,          // [nodes, 6] lowest x, y, z, highest x, y, z of parts, of trees of the faces
    __global const uint *members,          // numbers of faces
    __global const uint4 *trees,           // [rounds] first node, first of its last row, that row, first member
    const uint lap,                        // of those; the first forgets what was found before
    __global const float4 *positions,      // [V] of the mesh
    __global const float4 *vertex_normals, // [V]
    __global const uint4 *faces,           // [F] three vertices
    __global float4 *feet,                 // [guides] square of the distance so far; number of the face, weights of its
                                           // second and third corner
    const int has_normals,                 // 1: the guides have their own
    __global float4 *normals)              // [guides] unit, of the mesh at the root
{
    WORK_ITEM(i);
    const float4 p = (float4)(roots[i].xyz, 0.0f);
    const uint4 tree = trees[lap];
    float4 foot = lap ? feet[i] : (float4)(INFINITY, as_float(0), 0.0f, 0.0f);
    Walk walk;
    begin_walk(&walk, p, boxes + 6 * tree.x);
    for (uint m; (m = next_member(&walk, p, boxes + 6 * tree.x, tree.z, foot.x)) != NOTHING; ) {
        const uint face = members[tree.w + m - 8 * tree.y];
        const uint4 t = faces[face];
        const float4 w = nearest_in(p, positions[t.x], positions[t.y], positions[t.z]);
        const float4 d = ((w.x * positions[t.x] + w.y * positions[t.y]) + w.z * positions[t.z]) - p;
        const float square = dot3(d, d);
        if (square < foot.x || (square == foot.x && face < as_uint(foot.y)))
            foot = (float4)(square, as_float(face), w.y, w.z);
    }
    feet[i] = foot;
    if (has_normals)
        return;
    const uint4 t = faces[as_uint(foot.y)];
    const float4 side = cross3(positions[t.y] - positions[t.x], positions[t.z] - positions[t.x]);
    const float4 mean = ((1.0f - foot.z - foot.w) * vertex_normals[t.x] + foot.z * vertex_normals[t.y])
        + foot.w * vertex_normals[t.z];
    normals[i] = unit_or((float4)(mean.xyz, 0.0f), unit_or(side, (float4)(0.0f, 1.0f, 0.0f, 0.0f)));
}

/* Which guides are nearest to each strand's root, of those that strands of its type follow.  One whose skin looks another
   way is as much further as a ball between two such places tells: by the square of 1 / cosine of half the angle. */
__kernel void nearest(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *points,         // [points] of strands
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_normal,  // [strands] of the body at the root, unit
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const float8 *boxes,          // [nodes, 6] lowest x, y, z, highest x, y, z of parts, of trees of the guides
    __global const uint *members,          // numbers of guides
    __global const float4 *roots,          // [guides] x, y, z [world], -
    __global const float4 *normals,        // [guides] unit
    __global const uint4 *trees,           // [rounds, n_trees] first node, first of its last row, that row, first member;
                                           // or NOTHING, of nothing
    __global const uint *tree_of,          // [types] which of n_trees strands of a type look in
    const uint n_trees,
    const uint lap,                        // the first forgets what was found before
    const uint most,                       // how many are looked for
    __global uint *found)                  // [strands, 2 NEAREST] squares of distances, floats, the least first; numbers of
                                           // these guides, NOTHING where there is none
{
    WORK_ITEM(i);
    __global uint *mine = found + 2 * NEAREST * i;
    float square[NEAREST];
    uint guide[NEAREST];
    for (uint k = 0; k < NEAREST; ++k) {
        square[k] = lap ? as_float(mine[k]) : INFINITY;
        guide[k] = lap ? mine[NEAREST + k] : NOTHING;
    }
    const uint2 span = spans[i];
    const uint4 tree = trees[lap * n_trees + tree_of[(uint)strand_uv[i].z]];
    const float4 p = span.y ? (float4)(points[span.x].xyz, 0.0f) : (float4)(0.0f), up = strand_normal[i];
    if (!span.y || tree.x == NOTHING)
        return;
    Walk walk;
    begin_walk(&walk, p, boxes + 6 * tree.x);
    for (uint m; (m = next_member(&walk, p, boxes + 6 * tree.x, tree.z, square[most - 1])) != NOTHING; ) {
        const uint number = members[tree.w + m - 8 * tree.y];
        const float4 d = roots[number] - p;
        const float turned = 1.0f + dot3(normals[number], up), further = 2.0f / (turned > LEAST_TURN ? turned : LEAST_TURN);
        const float away = dot3(d, d) * (further > 1.0f ? further : 1.0f);
        uint k = most;
        for (; k && (away < square[k - 1] || (away == square[k - 1] && number < guide[k - 1])); --k)
            if (k < most) {
                square[k] = square[k - 1];
                guide[k] = guide[k - 1];
            }
        if (k < most) {
            square[k] = away;
            guide[k] = number;
        }
    }
    for (uint k = 0; k < NEAREST; ++k) {
        mine[k] = as_uint(square[k]);
        mine[NEAREST + k] = guide[k];
    }
}

/* The least turn that takes one unit vector to another, as three columns times a factor; half a turn mirrors. */
inline void turn(float4 from, float4 to, float factor, float4 *columns)
{
    const float4 w = cross3(from, to);
    const float c = dot3(from, to), turned = 1.0f + c, k = 1.0f / (turned > LEAST_TURN ? turned : LEAST_TURN);
    columns[0] = factor * (float4)(c + k * w.x * w.x, w.z + k * w.x * w.y, k * w.x * w.z - w.y, 0.0f);
    columns[1] = factor * (float4)(k * w.x * w.y - w.z, c + k * w.y * w.y, w.x + k * w.y * w.z, 0.0f);
    columns[2] = factor * (float4)(w.y + k * w.x * w.z, k * w.y * w.z - w.x, c + k * w.z * w.z, 0.0f);
}

inline float4 turned_by(const float4 *columns, float4 v)
{
    return (v.x * columns[0] + v.y * columns[1]) + v.z * columns[2];
}

/* Whether two guides point elsewhere at the root: any of their chords from the root by more than an angle. */
inline bool parted(const float4 *one, __global const float4 *of_one, const float4 *other, __global const float4 *of_other,
                   float cosine)
{
    bool is_parted = false;
    for (uint k = 0; k < CHORDS; ++k) {
        const float4 a = of_one[k], b = of_other[k];
        const bool both = dot3(a, a) > 0.0f && dot3(b, b) > 0.0f;   // else one has no length
        is_parted = is_parted || (both && dot3(turned_by(one, a), turned_by(other, b)) < cosine);
    }
    return is_parted;
}

/* A random vector within [-1, 1)^3 in the frame of the skin at a root, as growth has it: along an edge of the triangle, what
   is across, upright. */
inline float4 random_on_skin(float4 up, __global const float4 *positions, uint4 t, uint strand, uint seed, uint use)
{
    float4 first = positions[t.y] - positions[t.x], second = positions[t.z] - positions[t.y];
    first -= dot3(first, up) * up;
    second -= dot3(second, up) * up;
    const float4 least = (up.x < 0.0f ? -up.x : up.x) < 0.6f ? (float4)(1.0f, 0.0f, 0.0f, 0.0f) : (float4)(0.0f, 1.0f, 0.0f, 0.0f);
    const float4 edge = unit_or(dot3(first, first) > 0.01f * dot3(second, second) ? first : second,
                                unit_or(cross3(up, least), least));
    const float3 r = convert_float3(random3(strand, seed, use) >> 8) * 0x1p-23f - 1.0f;
    return (r.x * edge + r.y * cross3(up, edge)) + r.z * up;
}

/* Where a guide is at a share of its length, from its root; `at` is a point before it, and goes on. */
inline float4 along(__global const float4 *offsets, uint2 span, float share, uint *at)
{
    uint low = *at, high = span.y - 2;
    while (low < high) {
        const uint middle = (low + high + 1) / 2;
        if (offsets[span.x + middle].w <= share)
            low = middle;
        else
            high = middle - 1;
    }
    *at = low;
    const float4 a = offsets[span.x + low], b = offsets[span.x + low + 1];
    const float whole = b.w - a.w, t = whole > 0.0f ? (share - a.w) / whole : 0.0f;
    return a + (t < 1.0f ? t : 1.0f) * (b - a);
}

/* Give strands the blended shapes of the guides that `nearest` has found: weights by distance (Franke and Little's form of
   Shepard's method, 1980), 0 for the first that is not blended, so that shapes don't jump where another one is nearest.
   Guides that are parted from the nearest one do not count. */
__kernel void blend(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,      // [V] of the surface
    __global const uint4 *triangles,       // [T]
    __global const uint4 *stand_on,        // [strands] triangle; weights of its corners, floats
    __global uint2 *spans,                 // [strands] first point, points; 0 of those that do not stand there
    __global const float4 *strand_normal,  // [strands] of the body at the root, unit
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const HairType *types,        // [types]
    const int has_traits,                  // 0: there are none
    __global const Traits *traits,         // [strands] what maps on the skin make of them
    const uint seed,
    const uint first_strand,               // number of the first of these strands among all
    const uint most,                       // how many `nearest` has looked for: one more than are blended
    const float parting,                   // cosine of the angle beyond which guides are parted
    const float reach,                     // square of how often its room a guide may be away, beyond which no strand
                                           // stands; below 0: it may be anywhere
    __global const float4 *roots,          // [guides] x, y, z, square of its room: the distance of the seventh from it
    __global const uint *found,            // [strands, 2 NEAREST] see `nearest`
    __global const float4 *offsets,        // [points of guides] from the root [world], share of the length
    __global const uint2 *guide_spans,     // [guides] first point, points
    __global const float4 *normals,        // [guides] unit
    __global const float4 *chords,         // [guides, CHORDS] unit directions from the root, 0 where there is none
    const uint first_point,                // of each strand that is done here,
    const uint stop,                       // and one past the last
    __global float4 *points)               // [points] of strands; x, y, z
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    __global const uint *mine = found + 2 * NEAREST * i;
    if (span.y < 2 || mine[NEAREST] == NOTHING)
        return;
    if (reach >= 0.0f && as_float(mine[0]) > reach * roots[mine[NEAREST]].w) {
        spans[i].y = 0;
        return;
    }
    const float4 up = strand_normal[i];
    __global const HairType *type = &types[(uint)strand_uv[i].z];
    float4 ahead = up;
    if (type->shape.w > 0.0f)
        ahead = unit_or(up + type->shape.w * random_on_skin(up, positions, triangles[stand_on[i].x], first_strand + i, seed, 3), up);
    const bool others = mine[NEAREST + most - 1] != NOTHING;
    const float nearest = sqrt(as_float(mine[0])), edge = others ? sqrt(as_float(mine[most - 1])) : 0.0f;
    float4 turns[NEAREST][3];
    uint2 guide[NEAREST];
    uint at[NEAREST];
    float sum = 0.0f;
    uint n = 0;
    for (uint k = 0; k + 1 < most && mine[NEAREST + k] != NOTHING; ++k) {
        const uint number = mine[NEAREST + k];
        turn(normals[number], ahead, 1.0f, turns[n]);
        if (k && parted(turns[0], chords + CHORDS * mine[NEAREST], turns[n], chords + CHORDS * number, parting))
            continue;
        const float away = sqrt(as_float(mine[k])), by_distance = away > 0.0f ? nearest / away : 1.0f;
        const float fade = others && edge > nearest ? (edge - away) / (edge - nearest) : 1.0f, root = by_distance * fade;
        sum += root * root;
        for (uint c = 0; c < 3; ++c)
            turns[n][c] *= root * root;
        guide[n] = guide_spans[number];
        at[n++] = 0;
    }
    const float4 vary = (float4)(convert_float3(random3(first_strand + i, seed, 1) >> 8) * 0x1p-23f - 1.0f, 0.0f);
    float length = (1.0f + type->curl.w * vary.y) / (1.0f + type->curl.w);
    if (has_traits)
        length *= traits[i].scale.x < 1.0f ? traits[i].scale.x : 1.0f;
    const float4 root = points[span.x];
    const uint last = stop < span.y ? stop : span.y;
    for (uint k = first_point > 1 ? first_point : 1; k < last; ++k) {
        const float share = length * ((float)k / (float)(span.y - 1));
        float4 offset = 0.0f;
        for (uint g = 0; g < n; ++g)
            offset += turned_by(turns[g], along(offsets, guide[g], share, &at[g]));
        points[span.x + k].xyz = (root + offset / sum).xyz;
    }
}

/* Curl and wave of a type around strands that have their shape, as growth has them. */
__kernel void wind(
    const ulong begin, const ulong end,    // work-items, see common.h
    __global const float4 *positions,      // [V] of the surface
    __global const uint4 *triangles,       // [T]
    __global const uint4 *stand_on,        // [strands] triangle; weights of its corners, floats
    __global const uint2 *spans,           // [strands] first point, points
    __global const float4 *strand_normal,  // [strands] of the body at the root, unit
    __global const float4 *strand_uv,      // [strands] u, v, type
    __global const HairType *types,        // [types]
    const int has_traits,                  // 0: there are none
    __global const Traits *traits,         // [strands] what maps on the skin make of them
    const uint seed,
    const uint first_strand,               // number of the first of these strands among all
    __global float4 *points)               // [points] of strands; x, y, z
{
    WORK_ITEM(i);
    const uint2 span = spans[i];
    const HairType type = types[(uint)strand_uv[i].z];
    const float scale = type.frizz.z > 0.0f ? 0.0f : has_traits ? traits[i].scale.w : 1.0f;   // tufts curl as one
    const float curl = type.curl.x * scale, wave = type.wave.x * scale;
    if (span.y < 2 || !(curl > 0.0f || wave > 0.0f))
        return;
    const float4 up = strand_normal[i];
    const float4 turn = random_on_skin(up, positions, triangles[stand_on[i].x], first_strand + i, seed, 2);
    float4 before = points[span.x], axis = points[span.x + 1];
    float4 direction = unit_or((float4)((axis - before).xyz, 0.0f), up);
    float4 side = unit_or(cross3(direction, turn), unit_or(cross3(direction, up), up));
    float2 round_curl = (float2)(1.0f, 0.0f), round_wave = (float2)(1.0f, 0.0f);   // cosine, sine of the angle so far
    for (uint k = 1; k < span.y; ++k) {
        const float4 after = points[span.x + (k + 1 < span.y ? k + 1 : k)];
        direction = unit_or((float4)((after - before).xyz, 0.0f), direction);
        side = unit_or(side - dot3(side, direction) * direction, side);
        round_curl = (float2)(round_curl.x * type.curl.y - round_curl.y * type.curl.z,
                              round_curl.x * type.curl.z + round_curl.y * type.curl.y);
        round_wave = (float2)(round_wave.x * type.wave.y - round_wave.y * type.wave.z,
                              round_wave.x * type.wave.z + round_wave.y * type.wave.y);
        const float4 off = (curl * (round_curl.x - 1.0f) + wave * round_wave.y) * side
            + curl * round_curl.y * cross3(direction, side);
        points[span.x + k].xyz = (axis + off).xyz;
        before = axis;
        axis = after;
    }
}
