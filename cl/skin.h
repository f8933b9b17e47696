/* Pictures laid on the skin by uv, whole or in tiles, and other numbers that it has.  strands.cl and maps.cl use this. */

/* The tile of a picture in which a place of the skin lies, of `n` from `first` on, and the corner of it that is uv 0; tile -1
   where there is none. */
typedef struct {
    int at;
    float u, v;
} Found;

/* `middle`: uv of the middle of the triangle, so that all of its places are in one tile. */
INLINED Found tile_at(__global const SkinTile *tiles, int first, int n, float4 middle)
{
    Found found = {first, floor(middle.x), floor(middle.y)};
    if (n == 1 && !tiles[first].place.w)
        return found;
    const bool there = found.u >= 0.0f && found.u < 10.0f && found.v >= 0.0f && found.v < 900.0f;
    const int number = there ? UDIM + (int)found.u + 10 * (int)found.v : 0;
    found.at = -1;
    for (int low = 0, high = n; low < high;) {      // tiles are in the order of their numbers
        const int next = low + (high - low) / 2, here = tiles[first + next].place.w;
        found.at = here == number ? first + next : found.at;
        low = here < number ? next + 1 : low;
        high = here < number ? high : next;
    }
    return found;
}

/* Four texels around a place, and how far it is between them. v runs up, rows run down; a picture repeats, a tile ends. */
typedef struct {
    int at[4];
    float fx, fy;
} Between;

INLINED int side_of(int i, int n, int repeats)
{
    const int within = i < 0 ? 0 : i < n ? i : n - 1;
    return repeats ? (i + n) % n : within;
}

INLINED Between texels_at(SkinTile tile, Found found, float4 uv)
{
    const int width = tile.place.y, height = tile.place.z, repeats = !tile.place.w;
    const float u = uv.x - found.u, v = uv.y - found.v;
    const float inside_u = u < 0.0f ? 0.0f : u < 1.0f ? u : 1.0f, inside_v = v < 0.0f ? 0.0f : v < 1.0f ? v : 1.0f;
    const float x = (repeats ? uv.x - floor(uv.x) : inside_u) * width - 0.5f;
    const float y = (1.0f - (repeats ? uv.y - floor(uv.y) : inside_v)) * height - 0.5f;
    Between b;
    b.fx = x - floor(x);
    b.fy = y - floor(y);
    const int x0 = (int)floor(x), y0 = (int)floor(y);
    const int left = side_of(x0, width, repeats), right = side_of(x0 + 1, width, repeats);
    const int top = tile.place.x + side_of(y0, height, repeats) * width;
    const int bottom = tile.place.x + side_of(y0 + 1, height, repeats) * width;
    b.at[0] = top + left;
    b.at[1] = top + right;
    b.at[2] = bottom + left;
    b.at[3] = bottom + right;
    return b;
}

/* A colour between four texels; white where there is no tile. */
INLINED float4 color_at(__global const SkinTile *tiles, int first, int n, __global const float4 *texels, float4 middle, float4 uv)
{
    const Found found = tile_at(tiles, first, n, middle);
    if (found.at < 0)
        return (float4)(1.0f);
    const Between b = texels_at(tiles[found.at], found, uv);
    return (1.0f - b.fy) * ((1.0f - b.fx) * texels[b.at[0]] + b.fx * texels[b.at[1]])
         + b.fy * ((1.0f - b.fx) * texels[b.at[2]] + b.fx * texels[b.at[3]]);
}

/* A number of a picture there; `none` where there is no tile. */
INLINED float number_at(__global const SkinTile *tiles, int first, int n, __global const float *texels, float4 middle, float4 uv,
                        float none)
{
    const Found found = tile_at(tiles, first, n, middle);
    if (found.at < 0)
        return none;
    const Between b = texels_at(tiles[found.at], found, uv);
    return (1.0f - b.fy) * ((1.0f - b.fx) * texels[b.at[0]] + b.fx * texels[b.at[1]])
         + b.fy * ((1.0f - b.fx) * texels[b.at[2]] + b.fx * texels[b.at[3]]);
}

/* The type that a map of them tells: of the texel there, the first type where there is no tile. */
INLINED uint type_at(__global const SkinTile *tiles, int n, __global const uint *type_map, float4 middle, float4 uv)
{
    const Found found = tile_at(tiles, 0, n, middle);
    if (found.at < 0)
        return 0;
    const SkinTile tile = tiles[found.at];
    const float u = tile.place.w ? uv.x - found.u : uv.x - floor(uv.x);
    const float v = tile.place.w ? uv.y - found.v : uv.y - floor(uv.y);
    const int column = (int)(u * tile.place.y), row = (int)((1.0f - v) * tile.place.z);
    const int last = tile.place.y - 1, lowest = tile.place.z - 1;
    const int x = column < 0 ? 0 : column < last ? column : last, y = row < 0 ? 0 : row < lowest ? row : lowest;
    return type_map[tile.place.x + y * tile.place.y + x];
}
