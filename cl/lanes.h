/*
 * Side by side: a work-item takes LANES rays at once, so that a CPU's vectors are full; 1 on a GPU, which has its own.
 * 32 are two vectors of 16: while one waits for a number, the other goes on.
 * A mask has all bits set in a lane of a vector that is on, and is 1 where LANES is 1.  What the inner loops use is
 * inlined by force and does without OpenCL's own functions: PoCL calls each of these, even floor, and every call saves
 * all registers.
 */
#if LANES == 1
typedef float lanes;
typedef int lanes_i;
typedef uint lanes_u;
typedef long lanes_l;
#define AS_I as_int
#define AS_U as_uint
#define AS_F as_float
#elif LANES == 8
typedef float8 lanes;
typedef int8 lanes_i;
typedef uint8 lanes_u;
typedef long8 lanes_l;
#define AS_I as_int8
#define AS_U as_uint8
#define AS_F as_float8
#elif LANES == 32
typedef float lanes __attribute__((ext_vector_type(32)));
typedef int lanes_i __attribute__((ext_vector_type(32)));
typedef uint lanes_u __attribute__((ext_vector_type(32)));
typedef long lanes_l __attribute__((ext_vector_type(32)));
#define AS_I(x) __builtin_astype(x, lanes_i)
#define AS_U(x) __builtin_astype(x, lanes_u)
#define AS_F(x) __builtin_astype(x, lanes)
#else
typedef float16 lanes;
typedef int16 lanes_i;
typedef uint16 lanes_u;
typedef long16 lanes_l;
#define AS_I as_int16
#define AS_U as_uint16
#define AS_F as_float16
#endif
#if LANES > 1
#define APART ALONE                                      // where it has much to do for each of them
#define BY_HAND __attribute__((vec_type_hint(float8)))   // a kernel whose work-items Intel's doesn't lay side by side too
#else
#define APART
#define BY_HAND
#endif
#define F(x) ((lanes)(x))
#define I(x) ((lanes_i)(x))
#define U(x) ((lanes_u)(x))
#if LANES == 1
#define TO(type, x) ((type)(x))   // another type, of the same value
#else
#define TO(type, x) __builtin_convertvector(x, type)
#endif
#if LANES > 1 && defined(__clang__)
#define RARELY(x) __builtin_expect(!!(x), 0)   // a branch, where clang would choose between both without one
#define PREFETCH(p) __builtin_prefetch((const void *)(size_t)(p))
#define PREFETCH_TO_WRITE(p) __builtin_prefetch((const void *)(size_t)(p), 1)
#else
#define RARELY(x) (x)
#define PREFETCH(p)
#define PREFETCH_TO_WRITE(p)
#endif
#if LANES == 1                    // without a pointer: llvmpipe would keep what it leads to in memory, and all around it
#define LANE(v, i) (v)
#define LANE_I(v, i) (v)
#define LANE_U(v, i) (v)
#define LANE_L(v, i) (v)
#else
#define LANE(v, i) (((float *)&(v))[i])
#define LANE_I(v, i) (((int *)&(v))[i])
#define LANE_U(v, i) (((uint *)&(v))[i])
#define LANE_L(v, i) (((long *)&(v))[i])
#endif
#if CHECKED
#define INLINED static inline   // Oclgrind doesn't know what clang leaves where it has inlined what gives a struct
#else
#define INLINED static inline __attribute__((always_inline))
#endif
/* Compiled once: what is large in a kernel, of which PoCL makes three functions (see LARGE too), or is used several times. */
#if LANES > 1
#define ONCE static __attribute__((noinline))
#else
#define ONCE INLINED
#endif
#define ON (LANES == 1 ? 1 : -1)  // in a mask
#define SHIFT 12582912.0f        // 1.5 * 2^23: a float this large has no fraction

/* Two rows of four as one of eight, number by number where Oclgrind may run it. */
INLINED float8 both(float4 a, float4 b)
{
#if LANES == 1
    return (float8)(a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w);
#else
    return (float8)(a, b);
#endif
}

INLINED lanes lesser(lanes a, lanes b)
{
    return a < b ? a : b;
}

INLINED lanes greater(lanes a, lanes b)
{
    return a > b ? a : b;
}

INLINED lanes within(lanes x, float low, float high)
{
    return lesser(greater(x, F(low)), F(high));
}

INLINED lanes positive(lanes x)
{
    return greater(x, -x);
}

/* The nearest whole number, for |x| < 2^22. */
INLINED lanes nearest(lanes x)
{
    return (x + SHIFT) - SHIFT;
}

INLINED lanes_i nearest_i(lanes x)
{
    return AS_I(x + SHIFT) - as_int(SHIFT);
}

/* The whole number below, for |x| < 2^22. */
INLINED lanes whole_below(lanes x)
{
    const lanes r = nearest(x);
    return r > x ? r - 1.0f : r;
}

/* Square root to 5e-6 of itself (Newton's method), the same bits everywhere. */
INLINED lanes root(lanes x)
{
    lanes y = AS_F(U(0x5F375A86u) - (AS_U(x) >> 1));
    y *= 1.5f - 0.5f * x * y * y;
    y *= 1.5f - 0.5f * x * y * y;
    return x * y;
}

/* Rounded correctly, as geometry needs it. */
INLINED lanes exact_root(lanes x)
{
#if LANES == 32
    lanes y;
    y.lo = sqrt(x.lo);
    y.hi = sqrt(x.hi);
    return y;
#else
    return sqrt(x);
#endif
}

/* sqrt(x), 0 where x is below. */
INLINED lanes full_root(lanes x)
{
    return exact_root(greater(x, F(0.0f)));
}

INLINED bool any_lane(lanes_i mask)
{
#if LANES == 1
    return mask;
#else
#if LANES == 32
    const int16 c = mask.lo | mask.hi;
    const int8 b = c.lo | c.hi;
#elif LANES == 16
    const int8 b = mask.lo | mask.hi;
#else
    const int8 b = mask;
#endif
#ifdef __AVX__
    return !__builtin_ia32_ptestz256(as_long4(b), as_long4(b));
#else
    const int4 a = b.lo | b.hi;
    return (a.x | a.y) | (a.z | a.w);
#endif
#endif
}

#if LANES > 1
/* `bits_of` eight lanes. */
INLINED uint bits_of_eight(int8 mask)
{
#ifdef __AVX__
    return __builtin_ia32_movmskps256(as_float8(mask));
#else
    const int8 b = mask & (int8)(1, 2, 4, 8, 16, 32, 64, 128);
    const int4 a = b.lo | b.hi;
    return (a.x | a.y) | (a.z | a.w);
#endif
}
#endif

#if LANES > 1
/* Lanes of a vector: those that another one tells. */
INLINED int8 lanes_at(int8 v, int8 which)
{
#ifdef __AVX2__
    return __builtin_ia32_permvarsi256(v, which);
#else
    int8 there;
    for (int k = 0; k < 8; ++k)
        LANE_I(there, k) = LANE_I(v, LANE_I(which, k) & 7);
    return there;
#endif
}
#endif

/* The lanes of a mask that are on, a bit each. */
INLINED uint bits_of(lanes_i mask)
{
#if LANES == 1
    return mask;
#elif LANES == 8
    return bits_of_eight(mask);
#elif LANES == 16
    return bits_of_eight(mask.lo) | bits_of_eight(mask.hi) << 8;
#else
    return bits_of_eight(mask.lo.lo) | bits_of_eight(mask.lo.hi) << 8 | bits_of_eight(mask.hi.lo) << 16
        | bits_of_eight(mask.hi.hi) << 24;
#endif
}

/* The number of the first lane of `bits_of`, which has some. */
INLINED int first_of(uint bits)
{
#if LANES == 1
    return 0;
#else
    return __builtin_ctz(bits);
#endif
}

INLINED float least_lane(lanes x)
{
#if LANES == 1
    return x;
#else
#if LANES == 32
    const float16 d = x.lo < x.hi ? x.lo : x.hi;
    const float8 b = d.lo < d.hi ? d.lo : d.hi;
#elif LANES == 16
    const float8 b = x.lo < x.hi ? x.lo : x.hi;
#else
    const float8 b = x;
#endif
    const float4 a = b.lo < b.hi ? b.lo : b.hi;
    const float2 c = a.lo < a.hi ? a.lo : a.hi;
    return c.x < c.y ? c.x : c.y;
#endif
}

INLINED int most_lane(lanes_i x)
{
#if LANES == 1
    return x;
#else
#if LANES == 32
    const int16 d = x.lo > x.hi ? x.lo : x.hi;
    const int8 b = d.lo > d.hi ? d.lo : d.hi;
#elif LANES == 16
    const int8 b = x.lo > x.hi ? x.lo : x.hi;
#else
    const int8 b = x;
#endif
    const int4 a = b.lo > b.hi ? b.lo : b.hi;
    const int2 c = a.lo > a.hi ? a.lo : a.hi;
    return c.x > c.y ? c.x : c.y;
#endif
}

/* A vector of the world, one in each lane. */
typedef struct {
    lanes x, y, z;
} lanes3;

INLINED lanes dots(lanes3 a, lanes3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

INLINED lanes3 scaled(lanes3 a, lanes by)
{
    a.x *= by;
    a.y *= by;
    a.z *= by;
    return a;
}

INLINED lanes3 plus(lanes3 a, lanes3 b)
{
    a.x += b.x;
    a.y += b.y;
    a.z += b.z;
    return a;
}

INLINED lanes3 minus(lanes3 a, lanes3 b)
{
    a.x -= b.x;
    a.y -= b.y;
    a.z -= b.z;
    return a;
}

INLINED lanes3 chosen(lanes_i mask, lanes3 a, lanes3 b)
{
    a.x = mask ? a.x : b.x;
    a.y = mask ? a.y : b.y;
    a.z = mask ? a.z : b.z;
    return a;
}

INLINED void put_lane(lanes3 *to, uint lane, float4 from)
{
    LANE(to->x, lane) = from.x;
    LANE(to->y, lane) = from.y;
    LANE(to->z, lane) = from.z;
}

INLINED float3 lane_of(const lanes3 *from, uint lane)
{
    return (float3)(LANE(from->x, lane), LANE(from->y, lane), LANE(from->z, lane));
}

INLINED lanes3 crosses(lanes3 a, lanes3 b)
{
    const lanes3 c = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return c;
}

INLINED lanes3 all_lanes(float4 a)
{
    const lanes3 b = {F(a.x), F(a.y), F(a.z)};
    return b;
}

INLINED lanes3 unit(lanes3 a)
{
    const lanes square = greater(dots(a, a), F(1e-30f));
    return scaled(a, root(square) / square);
}

typedef struct {
    lanes x, y, z, w;
} lanes4;

/* A matrix, by its columns, times places (x, y, z, 1). */
INLINED lanes4 by_columns(const float4 *columns, lanes x, lanes y, lanes z)
{
    const float4 a = columns[0], b = columns[1], c = columns[2], d = columns[3];
    const lanes4 q = {a.x * x + b.x * y + c.x * z + d.x, a.y * x + b.y * y + c.y * z + d.y,
                      a.z * x + b.z * y + c.z * z + d.z, a.w * x + b.w * y + c.w * z + d.w};
    return q;
}

/* The logarithm of x > 0 to the base 2. */
INLINED lanes log2_of(lanes x)
{
    const lanes_i bits = AS_I(x) - 0x3F3504F3;           // so that the rest lies around 1
    const lanes m = AS_F((bits & 0x007FFFFF) + 0x3F3504F3);
    const lanes whole = AS_F((bits >> 23) + as_int(SHIFT)) - SHIFT;
    const lanes t = (m - 1.0f) / (m + 1.0f), u = t * t;
    return whole + 2.8853901f * t * (1.0f + u * (1.0f / 3 + u * (0.2f + u * (1.0f / 7 + u * (1.0f / 9)))));
}

/* 2^p for -100 <= p <= 0. */
INLINED lanes exp2_of(lanes p)
{
    const lanes f = 0.69314718f * (p - nearest(p));
    const lanes fraction = 1.0f + f * (1.0f + f * (0.5f + f * (1.0f / 6 + f * (1.0f / 24 + f * (1.0f / 120 + f * (1.0f / 720))))));
    return AS_F(AS_I(fraction) + (nearest_i(p) << 23));
}

/* x^e for 0 < x <= 1 and e > 0. */
INLINED lanes power(lanes x, float e)
{
    return exp2_of(greater(e * log2_of(x), F(-100.0f)));
}
