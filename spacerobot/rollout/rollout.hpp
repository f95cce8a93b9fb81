// Fixed-step rollouts of a closed loop, and their adjoint, over lanes. Follows `lanes.hpp` and `struct Generated`:
//
//   setup(p -> x0, c)              initial state and prepared constants, once per rollout
//   dynamics(t, x, c -> xdot, m)   time derivative, and the quantities whose largest value is asked for
//   normalise(x -> x)              puts cos/sin pairs and quaternions back on their unit sphere
//   outputs(t, x, c -> y)          what is recorded
//   final(t, x, c -> e)            what is asked for at the end
//   objective(r, p -> J)           costs, from r = (integrals, peaks, final values)
//
// The state x ends with INTEGRALS integrals. Of m, the first PEAKS rows compete for the largest value; each further
// block of PEAKS rows goes along with the winner (its derivative, for instance).
typedef Generated G;
enum {
  NP = G::setup_p, NX = G::dynamics_x, NC = G::dynamics_c, NM = G::dynamics_m, NY = G::outputs_y, NE = G::final_e,
  NJ = G::objective_J, NR = INTEGRALS + NM + NE
};

// Where a reference ends, the dynamics jumps. Each step is evaluated this little (in steps) inside its two ends, so
// that a jump on its boundary is seen from the step's own side, and samples show what led up to them.
static const double INWARD = 1e-9;

struct Job {
  int64_t count, steps, every;  // rollouts, steps in each, steps between samples
  double h;                     // step, s
  const double* p;              // (count, NP)
  const double* scale;          // (NX), one over the largest value each state may take
  double* x;                    // (count, samples, NX) or null
  double* y;                    // (count, samples, rows) or null
  const int64_t* row;           // (rows), which outputs to record
  int64_t rows;
  double* r;                    // (count, NR)
  double* cost;                 // (count, NJ)
  int64_t* done;                // (count), steps before divergence
  const volatile int32_t* stop; // leave early when this becomes non-zero
};

INLINE bool any(real condition) {
  bool found = false;
  for (int l = 0; l < LANES; ++l) found |= lane(condition, l) != 0;
  return found;
}

// One row of parameters into each lane; lanes beyond the last row hold copies of it.
static void gather(const double* rows, int64_t first, int64_t count, int width, real* to) {
  for (int l = 0; l < LANES; ++l) {
    const int64_t i = first + l < count ? first + l : count - 1;
    for (int j = 0; j < width; ++j) lane(to[j], l) = rows[i * width + j];
  }
}

static void scatter(const real* from, int width, int64_t first, int64_t count, double* rows) {
  for (int l = 0; l < LANES && first + l < count; ++l)
    for (int j = 0; j < width; ++j) rows[(first + l) * width + j] = lane(from[j], l);
}

// Where the states x2, x3, x4 of the inner stages and the sum before normalisation go. The adjoint needs them all; a
// plain rollout lets the stages share their place, which then stays in the nearest cache.
struct Stages {
  real *x2, *x3, *x4, *sum;
};
INLINE Stages on_tape(real* place) { return {place + NX, place + 2 * NX, place + 3 * NX, place + 4 * NX}; }

// One step of the classical Runge-Kutta method from x1 to `next`.
INLINE void step(int64_t k, double h, const real* c, const real* x1, const Stages& to, real* m, real* next) {
  real slope[NX], ignored[NM + 1];
  real *x2 = to.x2, *x3 = to.x3, *x4 = to.x4, *sum = to.sum;
  const double t = (k + INWARD) * h, middle = (k + 0.5) * h, end = (k + 1 - INWARD) * h;
  const real t1[1] = {t}, t2[1] = {middle}, t4[1] = {end};
  G::dynamics(t1, x1, c, slope, m);
  for (int i = 0; i < NX; ++i) sum[i] = x1[i] + h / 6 * slope[i], x2[i] = x1[i] + h / 2 * slope[i];
  G::dynamics(t2, x2, c, slope, ignored);
  for (int i = 0; i < NX; ++i) sum[i] = sum[i] + h / 3 * slope[i], x3[i] = x1[i] + h / 2 * slope[i];
  G::dynamics(t2, x3, c, slope, ignored);
  for (int i = 0; i < NX; ++i) sum[i] = sum[i] + h / 3 * slope[i], x4[i] = x1[i] + h * slope[i];
  G::dynamics(t4, x4, c, slope, ignored);
  for (int i = 0; i < NX; ++i) sum[i] = sum[i] + h / 6 * slope[i];
  G::normalise(sum, next);
}

// Truth where every state is a number within its bounds.
INLINE real is_sound(const real* x, const double* scale) {
  real sum[4] = {0., 0., 0., 0.};  // four sums, since one would wait for each of its own additions
  for (int i = 0; i + 4 <= NX; i += 4)
    for (int j = 0; j < 4; ++j) sum[j] = sum[j] + (x[i + j] * scale[i + j]) * (x[i + j] * scale[i + j]);
  for (int i = NX - NX % 4; i < NX; ++i) sum[0] = sum[0] + (x[i] * scale[i]) * (x[i] * scale[i]);
  return (sum[0] + sum[1]) + (sum[2] + sum[3]) < 1.;  // false for a NaN as well
}

// Largest values so far, and the step at which each was met. What was no number once stays none.
INLINE void compete(const real* m, real alive, int64_t k, real* best, real* when) {
  for (int i = 0; i < PEAKS; ++i) {
    const real wins = alive && !(m[i] <= best[i]) && (best[i] == best[i]);
    for (int j = i; j < NM; j += PEAKS) best[j] = select(wins, m[j], best[j]);
    when[i] = select(wins, double(k), when[i]);
  }
}

// What one group of LANES rollouts has come to.
struct Course {
  real x[NX], c[NC + 1], r[NR + 1], when[PEAKS + 1], alive, done;
};

static void sample(const Job& job, int64_t first, int64_t k, const Course& at) {
  const int64_t samples = job.steps / job.every + 1, s = k / job.every;
  real y[NY + 1];
  const real t[1] = {(k - INWARD) * job.h};
  if (job.y) G::outputs(t, at.x, at.c, y);
  for (int l = 0; l < LANES && first + l < job.count; ++l) {
    if (lane(at.alive, l) == 0) continue;
    const int64_t place = (first + l) * samples + s;
    if (job.x) for (int i = 0; i < NX; ++i) job.x[place * NX + i] = lane(at.x[i], l);
    if (job.y) for (int64_t i = 0; i < job.rows; ++i) job.y[place * job.rows + i] = lane(y[job.row[i]], l);
  }
}

// Integrate one group. A lane whose state leaves the bounds, or is no number, keeps its last good state from then
// on. `tape` (room for `segment` steps) holds the stages of the last segment, `checkpoint` the state before each.
// Returns false when told to stop.
static bool integrate(const Job& job, int64_t first, const real* p, Course& at, real* tape, int64_t segment,
                      real* checkpoint) {
  real shared[NX], sum[NX], m[NM + 1], next[NX];
  G::setup(p, at.x, at.c);
  at.alive = 1., at.done = 0.;
  const int64_t last = tape ? (job.steps - 1) / segment * segment : job.steps;  // where the last segment begins
  real* best = at.r + INTEGRALS;
  for (int i = 0; i < NM; ++i) best[i] = -INFINITY;
  for (int i = 0; i < PEAKS; ++i) at.when[i] = 0.;
  for (int64_t k = 0; k < job.steps; ++k) {
    if (k % job.every == 0) {
      if (*job.stop) return false;
      if (job.x || job.y) sample(job, first, k, at);
    }
    if (tape && k % segment == 0) std::memcpy(checkpoint + k / segment * NX, at.x, sizeof at.x);
    real* place = k >= last ? tape + (k - last) * (5 * NX) : nullptr;
    if (place) std::memcpy(place, at.x, sizeof at.x);
    step(k, job.h, at.c, at.x, place ? on_tape(place) : Stages{shared, shared, shared, sum}, m, next);
    if (PEAKS) compete(m, at.alive, k, best, at.when);
    at.alive = at.alive && is_sound(next, job.scale);
    if (!any(at.alive)) break;
    for (int i = 0; i < NX; ++i) at.x[i] = select(at.alive, next[i], at.x[i]);
    at.done = at.done + at.alive;
  }
  if (job.x || job.y) sample(job, first, job.steps, at);
  const real t[1] = {(job.steps - INWARD) * job.h};
  if (PEAKS) {
    G::dynamics(t, at.x, at.c, next, m);
    compete(m, at.alive, job.steps, best, at.when);
  }
  for (int i = 0; i < INTEGRALS; ++i) at.r[i] = at.x[NX - INTEGRALS + i];
  G::final(t, at.x, at.c, best + NM);
  for (int i = 0; i < NR; ++i) at.r[i] = select(at.alive, at.r[i], NAN);
  return true;
}

extern "C" int64_t rollouts(const Job* given) {
  const Job& job = *given;
  for (int64_t first = 0; first < job.count; first += LANES) {
    real p[NP + 1], cost[NJ + 1];
    Course at;
    gather(job.p, first, job.count, NP, p);
    if (!integrate(job, first, p, at, nullptr, 1, nullptr)) return first;
    G::objective(at.r, p, cost);
    scatter(at.r, NR, first, job.count, job.r);
    scatter(cost, NJ, first, job.count, job.cost);
    for (int l = 0; l < LANES && first + l < job.count; ++l) job.done[first + l] = int64_t(lane(at.done, l));
  }
  return job.count;
}

#ifdef ADJOINT
// Reverse of every function above; the seeds and results carry the name of what they belong to with a bar, and
// cbar has only the NW constants that the wanted parameters reach:
//
//   dynamics_reverse(t, x, c, vbar -> xbar, cbar)    peaks_reverse(t, x, c, mbar -> xbar, cbar)
//   normalise_reverse(x, nbar -> xbar)               final_reverse(t, x, c, ebar -> xbar, cbar)
//   objective_reverse(r, p, Jbar -> rbar, pbar)      setup_reverse(p, xbar, cbar -> pbar)
enum { NW = G::dynamics_reverse_cbar, NG = G::setup_reverse_pbar };

struct AdjointJob {
  const double* seed;  // (count, NJ), the weight of each cost
  double* gradient;    // (count, NG)
  int64_t segment;     // steps between checkpoints
};

INLINE void accumulate(real* sum, const real* part, int n) {
  for (int i = 0; i < n; ++i) sum[i] = sum[i] + part[i];
}

// xbar at the end of a step becomes xbar at its beginning.
static void step_reverse(int64_t k, double h, const real* c, const real* stage, real* xbar, real* cbar) {
  const double time[4] = {(k + INWARD) * h, (k + 0.5) * h, (k + 0.5) * h, (k + 1 - INWARD) * h};
  const double weight[4] = {h / 6, h / 3, h / 3, h / 6}, reach[4] = {h / 2, h / 2, h, 0};
  real sum[NX], slope[NX], stage_bar[NX], part[NW + 1];
  G::normalise_reverse(stage + 4 * NX, xbar, sum);
  for (int i = 0; i < NX; ++i) xbar[i] = sum[i], stage_bar[i] = 0.;
  for (int s = 3; s >= 0; --s) {
    const real t[1] = {time[s]};
    for (int i = 0; i < NX; ++i) slope[i] = weight[s] * sum[i] + reach[s] * stage_bar[i];
    G::dynamics_reverse(t, stage + s * NX, c, slope, stage_bar, part);
    accumulate(xbar, stage_bar, NX);
    accumulate(cbar, part, NW);
  }
}

// Seeds of the peaks that were met at step k.
static void peaks_reverse(int64_t k, int64_t steps, double h, const Course& at, const real* x, const real* rbar,
                          real* xbar, real* cbar) {
  real seed[PEAKS + 1], xpart[NX], cpart[NW + 1], here = 0.;
  for (int i = 0; i < PEAKS; ++i) {
    const real met = at.when[i] == real(double(k));
    seed[i] = select(met, rbar[INTEGRALS + i], 0.);
    here = here || met;
  }
  if (!any(here)) return;
  const real t[1] = {(k < steps ? k + INWARD : k - INWARD) * h};
  G::peaks_reverse(t, x, at.c, seed, xpart, cpart);
  accumulate(xbar, xpart, NX);
  accumulate(cbar, cpart, NW);
}

extern "C" int64_t gradients(const Job* given, const AdjointJob* adjoint) {
  const Job& job = *given;
  const int64_t segment = adjoint->segment, segments = (job.steps + segment - 1) / segment;
  std::unique_ptr<real[]> tape(new (std::nothrow) real[segment * 5 * NX]);
  std::unique_ptr<real[]> checkpoint(new (std::nothrow) real[segments * NX]);
  std::unique_ptr<Course> course(new (std::nothrow) Course);
  if (!tape || !checkpoint || !course) return -1;
  Course& at = *course;
  for (int64_t first = 0; first < job.count; first += LANES) {
    real p[NP + 1], cost[NJ + 1], seed[NJ + 1], rbar[NR + 1], pbar[NG + 1], direct[NG + 1];
    real xbar[NX], cbar[NW + 1], end[NX], m[NM + 1];
    gather(job.p, first, job.count, NP, p);
    gather(adjoint->seed, first, job.count, NJ, seed);
    if (!integrate(job, first, p, at, tape.get(), segment, checkpoint.get())) return first;
    G::objective(at.r, p, cost);
    G::objective_reverse(at.r, p, seed, rbar, direct);
    const real t[1] = {(job.steps - INWARD) * job.h};
    G::final_reverse(t, at.x, at.c, rbar + INTEGRALS + PEAKS, xbar, cbar);
    for (int i = 0; i < INTEGRALS; ++i) xbar[NX - INTEGRALS + i] = rbar[i];
    peaks_reverse(job.steps, job.steps, job.h, at, at.x, rbar, xbar, cbar);
    for (int64_t s = any(at.alive) ? segments - 1 : -1; s >= 0; --s) {  // what is lost has no tape
      const int64_t begin = s * segment, stop = begin + segment < job.steps ? begin + segment : job.steps;
      if (s < segments - 1) {  // the tape holds a later segment: integrate this one again
        std::memcpy(tape.get(), checkpoint.get() + s * NX, sizeof end);
        for (int64_t k = begin; k < stop; ++k) {
          real* place = tape.get() + (k - begin) * 5 * NX;
          step(k, job.h, at.c, place, on_tape(place), m, k + 1 < stop ? place + 5 * NX : end);
        }
      }
      for (int64_t k = stop - 1; k >= begin; --k) {
        if (k % job.every == 0 && *job.stop) return first;
        const real* stage = tape.get() + (k - begin) * 5 * NX;
        step_reverse(k, job.h, at.c, stage, xbar, cbar);
        if (PEAKS) peaks_reverse(k, job.steps, job.h, at, stage, rbar, xbar, cbar);
      }
    }
    G::setup_reverse(p, xbar, cbar, pbar);
    for (int i = 0; i < NG; ++i) pbar[i] = select(at.alive, pbar[i] + direct[i], NAN);
    scatter(at.r, NR, first, job.count, job.r);
    scatter(cost, NJ, first, job.count, job.cost);
    scatter(pbar, NG, first, job.count, adjoint->gradient);
    for (int l = 0; l < LANES && first + l < job.count; ++l) job.done[first + l] = int64_t(lane(at.done, l));
  }
  return job.count;
}
#endif
