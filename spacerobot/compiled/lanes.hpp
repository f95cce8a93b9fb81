// Vectors of doubles for generated straight-line code, and the fixed-step rollout written over them.
//
// LANES (a macro, 1 or a power of two) is the number of rollouts that are integrated at once. With one lane, `real` is
// `double`. With more, it is a vector of doubles, and every operation acts on each lane separately: the result of a lane
// depends neither on the other lanes nor on its place.
//
// The functions of the standard headers that are used are declared here, since these headers take longer to compile than
// the loops of a small scene.
#define INFINITY __builtin_inf()
#define NAN __builtin_nan("")
extern "C" {
double sin(double), cos(double), tan(double), asin(double), acos(double), atan(double), sinh(double), cosh(double),
    tanh(double), asinh(double), acosh(double), atanh(double), exp(double), log(double), expm1(double), log1p(double),
    erf(double), erfc(double), floor(double), ceil(double), fabs(double), sqrt(double), pow(double, double),
    atan2(double, double), hypot(double, double), fmod(double, double), remainder(double, double),
    fmin(double, double), fmax(double, double), copysign(double, double);
}
#ifdef PIECES  // source with functions only, without the loops
typedef __INT64_TYPE__ int64_t;
#define INT64_MAX __INT64_MAX__
#define INT64_MIN (-__INT64_MAX__ - 1)
#else
#include <cstdint>
#include <cstring>
#include <new>
// Array of `number` elements on the heap, until the end of the scope; null without memory.
template <class T>
struct Room {
  T* at = nullptr;
  Room() = default;
  explicit Room(int64_t number) : at(new (std::nothrow) T[number]) {}
  Room(const Room&) = delete;
  ~Room() { delete[] at; }
  void swap(Room& other) { T* const before = at; at = other.at, other.at = before; }
};
#ifdef NO_RUNTIME  // the C++ runtime is not linked: malloc provides the memory
#include <cstdlib>
const std::nothrow_t std::nothrow{};
#define MEMORY(form) \
  void* operator new form(size_t n, const std::nothrow_t&) noexcept { return std::malloc(n); } \
  void* operator new form(size_t n, std::align_val_t a, const std::nothrow_t&) noexcept { \
    return std::aligned_alloc(size_t(a), (n + size_t(a) - 1) / size_t(a) * size_t(a)); \
  } \
  void operator delete form(void* p) noexcept { std::free(p); } \
  void operator delete form(void* p, size_t) noexcept { std::free(p); } \
  void operator delete form(void* p, std::align_val_t) noexcept { std::free(p); } \
  void operator delete form(void* p, size_t, std::align_val_t) noexcept { std::free(p); }
MEMORY()
MEMORY([])
#endif
#endif

#if defined(__OPTIMIZE__) && !defined(GENERIC)
#define ALWAYS_INLINE __attribute__((always_inline))
#else  // inlining would take most of the compile time, for which -O0 asks to be short; loops of all scenes gain little by it
#define ALWAYS_INLINE
#endif
#define INLINE static inline ALWAYS_INLINE

#if LANES == 1

typedef double real;
typedef int64_t bits;
INLINE bits to_bits(real a) { bits b; __builtin_memcpy(&b, &a, sizeof b); return b; }
INLINE real from_bits(bits b) { real a; __builtin_memcpy(&a, &b, sizeof a); return a; }
INLINE real select(real condition, real a, real b) { return condition != 0 ? a : b; }
INLINE double& lane(real& a, int) { return a; }
INLINE double lane(const real& a, int) { return a; }

#else

typedef double pack __attribute__((vector_size(8 * LANES)));
typedef int64_t bits __attribute__((vector_size(8 * LANES)));

struct real {
  pack v;
  real() = default;
  ALWAYS_INLINE real(pack p) : v(p) {}
  ALWAYS_INLINE real(double s) : v(s - pack{}) {}  // s - 0 is s, whatever its sign
};

INLINE bits to_bits(real a) { return (bits)a.v; }
INLINE real from_bits(bits b) { return real((pack)b); }

#define ARITHMETIC(op) \
  INLINE real operator op(real a, real b) { return real(a.v op b.v); } \
  INLINE real operator op(double a, real b) { return real(a op b.v); } \
  INLINE real operator op(real a, double b) { return real(a.v op b); }
ARITHMETIC(+) ARITHMETIC(-) ARITHMETIC(*) ARITHMETIC(/)
INLINE real operator-(real a) { return real(-a.v); }

// Truth is 1.0 or 0.0, as in CasADi.
INLINE real truth(bits m) { return from_bits(m & to_bits(1.0)); }
#define COMPARISON(op) \
  INLINE real operator op(real a, real b) { return truth(a.v op b.v); }
COMPARISON(<) COMPARISON(<=) COMPARISON(>) COMPARISON(>=) COMPARISON(==) COMPARISON(!=)
INLINE real operator!(real a) { return truth(a.v == pack{}); }
INLINE real operator&&(real a, real b) { return truth((a.v != pack{}) & (b.v != pack{})); }
INLINE real operator||(real a, real b) { return truth((a.v != pack{}) | (b.v != pack{})); }
INLINE real select(real condition, real a, real b) { return real(condition.v != pack{} ? a.v : b.v); }
INLINE double& lane(real& a, int i) { return reinterpret_cast<double*>(&a)[i]; }
INLINE double lane(const real& a, int i) { return a.v[i]; }

INLINE real fabs(real a) { return from_bits(to_bits(a) & INT64_MAX); }
INLINE real copysign(real a, real b) { return from_bits((to_bits(a) & INT64_MAX) | (to_bits(b) & INT64_MIN)); }
INLINE real sqrt(real a) { real r; for (int i = 0; i < LANES; ++i) r.v[i] = __builtin_sqrt(a.v[i]); return r; }
INLINE real fmin(real a, real b) { return select((a < b) || (b != b), a, b); }
INLINE real fmax(real a, real b) { return select((a > b) || (b != b), a, b); }

// Function of the vector maths library, or the scalar function for each lane if that library has none.
#ifdef __aarch64__
#define VECTOR_CALL __attribute__((aarch64_vector_pcs))
#else
#define VECTOR_CALL
#endif
#define VECTOR1(f, symbol) extern "C" VECTOR_CALL pack symbol(pack); INLINE real f(real a) { return real(symbol(a.v)); }
#define VECTOR2(f, symbol) \
  extern "C" VECTOR_CALL pack symbol(pack, pack); \
  INLINE real f(real a, real b) { return real(symbol(a.v, b.v)); }
#define PLAIN1(f) \
  static __attribute__((noinline)) real f(real a) { \
    for (int i = 0; i < LANES; ++i) a.v[i] = ::f(a.v[i]); \
    return a; \
  }
#define PLAIN2(f) \
  static __attribute__((noinline)) real f(real a, real b) { \
    for (int i = 0; i < LANES; ++i) a.v[i] = ::f(a.v[i], b.v[i]); \
    return a; \
  }

#endif

// Functions that CasADi's generated code calls by names of its own.
INLINE real casadi_sq(real a) { return a * a; }
INLINE real casadi_fabs(real a) { return fabs(a); }
INLINE real casadi_fmin(real a, real b) { return fmin(a, b); }
INLINE real casadi_fmax(real a, real b) { return fmax(a, b); }
INLINE real casadi_sign(real a) { return select(a < 0., -1., select(a > 0., 1., a)); }
INLINE real casadi_if_else_zero(real condition, real a) { return select(condition, a, 0.); }
#define casadi_hypot hypot
#define casadi_log1p log1p
#define casadi_expm1 expm1
const double casadi_inf = INFINITY, casadi_nan = NAN;

// Inverse error function: Winitzki's estimate, then Halley's iteration to rounding.
static inline double erfinv(double y) {
  if (!(__builtin_fabs(y) < 1)) return y == 1 ? INFINITY : y == -1 ? -INFINITY : NAN;
  const double l = __builtin_log1p(-y * y), b = 4.330746750799873 + l / 2;
  double x = __builtin_copysign(__builtin_sqrt(__builtin_sqrt(b * b - l / 0.147) - b), y);
  for (int i = 0; i < 4; ++i) {
    const double tail = (y < 0 ? -1 : 1) * ((1 - __builtin_fabs(y)) - __builtin_erfc(__builtin_fabs(x)));
    const double e = __builtin_fabs(y) < 0.5 ? __builtin_erf(x) - y : tail;
    const double u = e * 0.886226925452758 * __builtin_exp(x * x);  // (erf(x) - y) / erf'(x)
    x -= u / (1 + x * u);
  }
  return x;
}

// Sine and cosine without a call or a branch, so that the compiler keeps values in registers and shares work between both
// of one angle. The angle is reduced by multiples of pi/2 in three fused parts (exact below 2^45 rad; an angle
// beyond has lost its phase to rounding and gives NaN), followed by the minimax polynomials of FreeBSD's msun.
#if defined(__FMA__) || defined(__aarch64__)
struct Turn { real sin, cos; };
INLINE Turn turn(real x) {
  const real shifted = x * 0.6366197723675814 + 6755399441055744.0;  // its lowest bits are the number of quarter turns
  const bits quarters = to_bits(shifted);
  const real n = shifted - 6755399441055744.0;
  real r = x - n * 1.5707963267948966;
  r = r - n * 6.123233995736766e-17;
  r = r + n * 1.4973849048591833e-33;
  r = from_bits(to_bits(r) | ((to_bits(35184372088832.0) - to_bits(casadi_fabs(x))) >> 63));
  const real z = r * r;
  real s = 1.58969099521155010221e-10;
  s = s * z - 2.50507602534068634195e-08;
  s = s * z + 2.75573137070700676789e-06;
  s = s * z - 1.98412698298579493134e-04;
  s = s * z + 8.33333333332248946124e-03;
  s = s * z - 1.66666666666666324348e-01;
  s = s * (z * r) + r;
  real c = -1.13596475577881948265e-11;
  c = c * z + 2.08757232129817482790e-09;
  c = c * z - 2.75573143513906633035e-07;
  c = c * z + 2.48015872894767294178e-05;
  c = c * z - 1.38888888888741095749e-03;
  c = c * z + 4.16666666666666019037e-02;
  const real half = 0.5 * z, one = 1.0 - half;
  c = one + (c * (z * z) + ((1.0 - one) - half));
  const bits odd = -(quarters & 1), keep = ~odd, a = to_bits(s), b = to_bits(c);
  const bits sine = (a & keep) | (b & odd), cosine = (b & keep) | (a & odd);
  return {from_bits(sine ^ ((quarters & 2) << 62)), from_bits(cosine ^ (((quarters + 1) & 2) << 62))};
}
INLINE real casadi_sin(real x) { return turn(x).sin; }
INLINE real casadi_cos(real x) { return turn(x).cos; }
#else
#define casadi_sin sin
#define casadi_cos cos
#endif
