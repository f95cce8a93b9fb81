// Vectors of doubles for generated straight-line code, and the fixed-step rollout written over them.
//
// LANES (a macro, 1 or a power of two) is the number of rollouts that one call carries. With one lane, `real` is
// `double`. With more, it is a vector of doubles on which every operation acts lane by lane, so that the very same
// source integrates LANES parameter sets at once. No operation looks across lanes: what a lane holds never depends
// on its neighbours, nor on its place.
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <new>

#define INLINE static inline __attribute__((always_inline))

#if LANES == 1

typedef double real;
INLINE real select(real condition, real a, real b) { return condition != 0 ? a : b; }
INLINE double& lane(real& a, int) { return a; }
INLINE double lane(const real& a, int) { return a; }

#else

typedef double pack __attribute__((vector_size(8 * LANES)));
typedef int64_t bits __attribute__((vector_size(8 * LANES)));

struct real {
  pack v;
  real() = default;
  __attribute__((always_inline)) real(pack p) : v(p) {}
  __attribute__((always_inline)) real(double s) : v(s - pack{}) {}  // s - 0 is s, whatever its sign
};

#define ARITHMETIC(op) \
  INLINE real operator op(real a, real b) { return real(a.v op b.v); } \
  INLINE real operator op(double a, real b) { return real(a op b.v); } \
  INLINE real operator op(real a, double b) { return real(a.v op b); }
ARITHMETIC(+) ARITHMETIC(-) ARITHMETIC(*) ARITHMETIC(/)
INLINE real operator-(real a) { return real(-a.v); }

// Truth is 1.0 or 0.0, as in CasADi.
INLINE real truth(bits m) { return real((pack)(m & (bits)real(1.0).v)); }
#define COMPARISON(op) \
  INLINE real operator op(real a, real b) { return truth(a.v op b.v); }
COMPARISON(<) COMPARISON(<=) COMPARISON(>) COMPARISON(>=) COMPARISON(==) COMPARISON(!=)
INLINE real operator!(real a) { return truth(a.v == pack{}); }
INLINE real operator&&(real a, real b) { return truth((a.v != pack{}) & (b.v != pack{})); }
INLINE real operator||(real a, real b) { return truth((a.v != pack{}) | (b.v != pack{})); }
INLINE real select(real condition, real a, real b) { return real(condition.v != pack{} ? a.v : b.v); }
INLINE double& lane(real& a, int i) { return reinterpret_cast<double*>(&a)[i]; }
INLINE double lane(const real& a, int i) { return a.v[i]; }

INLINE real fabs(real a) { return real((pack)((bits)a.v & INT64_MAX)); }
INLINE real copysign(real a, real b) { return real((pack)(((bits)a.v & INT64_MAX) | ((bits)b.v & INT64_MIN))); }
INLINE real sqrt(real a) { real r; for (int i = 0; i < LANES; ++i) r.v[i] = __builtin_sqrt(a.v[i]); return r; }
INLINE real fmin(real a, real b) { return select((a < b) || (b != b), a, b); }
INLINE real fmax(real a, real b) { return select((a > b) || (b != b), a, b); }

// A function of the vector maths library, or the scalar one lane after lane where that library lacks it.
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

// What CasADi's generated code calls by names of its own.
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
  if (!(std::fabs(y) < 1)) return y == 1 ? INFINITY : y == -1 ? -INFINITY : NAN;
  const double l = std::log1p(-y * y), b = 4.330746750799873 + l / 2;
  double x = std::copysign(std::sqrt(std::sqrt(b * b - l / 0.147) - b), y);
  for (int i = 0; i < 4; ++i) {
    const double e = (y < 0 ? -1 : 1) * ((y < 0 ? 1 + y : 1 - y) - std::erfc(std::fabs(x)));
    const double u = e * 0.886226925452758 * std::exp(x * x);  // (erf(x) - y) / erf'(x)
    x -= u / (1 + x * u);
  }
  return x;
}
