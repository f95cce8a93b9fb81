// Steps of rollouts of a closed loop by an explicit Runge-Kutta method, in SIMD lanes. Included after `lanes.hpp`, `struct
// Generated` and `struct Method` (a tableau). `tables.hpp` follows if there are TABLES, `events.hpp` if there are EVENTS, then
// `forward.hpp`, and `adjoint.hpp` for gradients. The functions of a scene are:
//
//   setup(p -> x0, c)              initial state and prepared constants, once per rollout
//   dynamics(t, x, c -> xdot, m)   time derivative, and the quantities with peaks
//   normalise(x -> x)              scales cosine-sine pairs and quaternions to unit length
//   outputs(t, x, c -> y)          recorded outputs
//   final(t, x, c -> e)            values at the end
//   objective(r, p -> J)           costs, from r = (integrals, peaks, final values)
//
// With EVENTS, see `events.hpp`:
//
//   guards(t, x, c, xdot -> g, rate)   an event fires where its guard is above zero; rates along xdot
//   values(t, x, c -> g, speed)        guards without rates; for each of GAPS, an upper bound of its closing speed
//   update(t, x, c, e -> x)            state after event e
//
// The state x ends with INTEGRALS integrals. The first PEAKS rows of m are compared for the largest value; each further
// block of PEAKS rows is stored with it, such as its derivative.
//
// JUMP has the indices in c of the times at which the dynamics jump. A rollout is divided into segments at its samples
// and its jumps, and each segment into equal steps, so that no step crosses a jump. The side of a jump on which a step
// lies does not depend on rounding: c has plus infinity for a jump after the step, minus infinity for one before it. Each
// lane has its own segments. A lane that has reached the end of a sample interval waits for the others, its state
// unchanged to the bit.
typedef Generated G;
#ifndef GENERIC
constexpr Method method;
enum {
  NP = G::setup_p, NX = G::dynamics_x, NC = G::dynamics_c, NM = G::dynamics_m, NY = G::outputs_y, NE = G::final_e,
  NJ = G::objective_J, NR = INTEGRALS + NM + NE
};
#ifdef WITH_TABLES
enum { CURSORS = G::rows_row };
#endif
#ifdef WITH_EVENTS
enum { GAPS = G::values_speed };
#endif
// Array in a struct, whose length depends on the scene.
#define ROW(type, name, number) type name[number]
#define THREE_ROWS(type, name, number) type name[3][number]
#define OUT_OF_MEMORY false
// Stage of the method. The code of each stage is separate, so that the tableau's numbers are constants.
template <int S> struct Stage {
  constexpr operator int() const { return S; }
};
constexpr Stage<Method::STAGES> NEEDED_STAGES;  // of the solution
constexpr Stage<Method::TOTAL> ALL_STAGES;      // of the error estimate as well
constexpr Stage<Method::TOTAL> SOLUTION;        // stage after the last
template <int S = 0, int LAST, class Body> INLINE void for_stages(Stage<LAST> last, const Body& body) {
  if constexpr (S < LAST) body(Stage<S>()), for_stages<S + 1>(last, body);
}
template <int LAST, class Body> INLINE void for_stages_back(Stage<LAST>, const Body& body) {
  if constexpr (LAST > 0) body(Stage<LAST - 1>()), for_stages_back(Stage<LAST - 1>(), body);
}
#endif

struct Job {
  int64_t count, intervals, every;  // rollouts, sample intervals, steps in one without a jump
  double h;                         // step where there is no jump, s
  double finer;                     // factor of FINE_STEP
  const double* p;                  // (count, NP)
  const double* noise;              // (count, noises), random numbers
  int64_t noises;
  const double* scale;              // (NX), inverse of the maximum distance of each state from its initial value
  double* x;                        // (count, samples, NX) or null
  double* y;                        // (count, samples, rows) or null
  const int64_t* row;               // (rows), indices of the outputs to record
  int64_t rows;
  double* r;                        // (count, NR)
  double* cost;                     // (count, NJ)
  double* error;                    // (count) or null: largest estimate of a step's error in any state
  double* reached;                  // (count), time of the last good state
  int64_t* done;                    // (count), number of completed steps
  int64_t* status;                  // (count), a Status
  int64_t most;                     // maximum number of recorded events of each rollout
  int64_t* fired;                   // (count), number of events, recorded or not
  int64_t* event;                   // (count, most), indices of the recorded events
  double* when;                     // (count, most), and their times
  double* jump;                     // (count, most, 2, NX) or null: states before and after each
  int64_t* gradient_warning;        // (count, 2): a GradientWarning, and the index of its event
  int64_t backwards;                // whether coincident events fire in the reverse order
  int64_t located;                  // whether derivatives of peaks are those between steps
  const volatile int32_t* stop;     // the loops return early when this is not zero
#ifdef COMMUNICATION
  int64_t cut;                      // sample that is replaced by a communication point within its interval, or -1
  double point;                     // time of that communication point, s
  double time(int64_t sample) const { return sample == cut ? point : double(sample * every) * h; }
#else
  double time(int64_t sample) const { return double(sample * every) * h; }
#endif
};

INLINE bool any(real condition) {
  bool holds = false;
  for (int l = 0; l < LANES; ++l) holds |= lane(condition, l) != 0;
  return holds;
}

INLINE void copy(real* to, const real* from, int number) { std::memcpy(to, from, number * sizeof(real)); }

// Copy one row of parameters to each lane; lanes beyond the last row get copies of it.
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

// Next step of each lane. t, h: start time and length, zero in a lane that waits. index, number: index of the step among
// those of its segment, and their number. from, to: jumps at which the segment begins and ends, -1 for none, HERE for an
// event. begin, end: start and end time of the segment. busy: whether the lane takes the step.
struct Step {
  real t, h, index, number, from, to, begin, end, busy;
};
enum { HERE = -2 };
constexpr double TOGETHER = 1e-9;  // time within which events may change their order, s

#ifdef WITH_EVENTS
// Search of each lane for its next event; see `events.hpp`. Guards are relative to their levels unless stated otherwise.
struct Watch {
  ROW(real, mode, SWITCHES + 1);       // the switches
  ROW(real, level, EVENTS);            // level of each guard
  ROW(real, first, EVENTS);            // guards at the start of the step, relative to zero; not valid while `fresh`
  ROW(real, prior, EVENTS);            // guards at the start of the preceding step, relative to zero
  real prior_h;                        // length of that step; 0 if there is none
  ROW(real, speed, GAPS + 1);          // bounds of the rates of gaps at the start of the step
  real clear;                          // length of the step within which no gap closes
  ROW(real, crossed, EVENTS);          // whether a guard rose above its level in the last step, with an event
  real last;                           // last event, until a step is accepted; or -1
  real fresh;                          // whether a guard above its level fires at the start of the step
  real peak;                           // number of tried lengths that end at a guard's maximum; 1/2 for a clock's instant
  real low, high, tries;               // lengths without and with a guard above its level; number of tried lengths
  ROW(real, before, EVENTS);           // guards at the length `low`,
  ROW(real, after, EVENTS);            // and at the length `high`
  real burst, since;                   // number of successive events close to each other, and time of the first
  ROW(real, on, FINES + 1);            // time at which each of FINE was turned on
  ROW(real, off, FINES + 1);           // estimated time at which it turns off, from its guards
  real graded;                         // whether the step is shortened because one of these times is near
  real begin_slope;                    // sensitivities: derivative of the time at which an event began the segment
};
#endif

// Position of a group of LANES rollouts.
struct Position {
  ROW(real, x, NX);
  real alive;
  Step step;
  int64_t interval;   // number of sample intervals begun
  int passed[LANES];  // number of jumps that each lane has passed
#ifdef WITH_TABLES
  ROW(real, row, CURSORS);  // rows in the windows
  real stale;              // whether these rows may have changed
#endif
#ifdef WITH_EVENTS
  Watch watch;
#endif
};

// Steps around each peak: two before it, its own, two after it, with their numbers, times and values of m.
enum { BEFORE = 1, OWN, AFTER, AROUND = 5 };
struct Vicinity {
  ROW(real, m, AROUND * NM + 1);
  ROW(real, t, AROUND * PEAKS + 1);
  ROW(real, step, AROUND * PEAKS + 1);
  ROW(real, since, PEAKS + 1);    // steps after the peak's
  ROW(real, last_m, 2 * NM + 1);  // the last two steps
  real last_t[2], last_step[2];
};

// Rollouts of a group of lanes up to the present step. jump: times of the jumps. order: jumps of each lane by time.
struct Trajectory {
  Position now;
  ROW(real, c, NC + 1);
  ROW(real, begin, NX);
  ROW(real, r, NR + 1);
  ROW(real, when, PEAKS + 1);
  ROW(real, share, AROUND * PEAKS + 1);  // weights of the steps around a peak in its derivative
  Vicinity vicinity;                     // where derivatives are `located`
  ROW(real, jump, JUMPS + 1);
  ROW(int, order, (JUMPS + 1) * LANES);  // jump k of lane l is at k * LANES + l
  int jumps[LANES];
  real done, reached, whole;
  const double* noise[LANES];  // random numbers of each lane
  int64_t first, status[LANES];  // index of the first lane's rollout; Status of each
#ifdef WITH_EVENTS
  int64_t fired[LANES], gradient_warning[LANES], warned_event[LANES];  // events; why gradients may not hold, at which event
#endif
  ROW(real, error, NX);  // largest estimate of a step's error in each state
  ROW(real, size, NX);   // largest size of each state
};

// End of a rollout: at its last sample, out of bounds, by an event, or by too many events.
enum Status { COMPLETED, DIVERGED, ENDED, CHATTERING };

// Set the constants of a lane to its side of each jump.
static void set_sides(Trajectory& at, int l) {
  for (int e = 0; e < JUMPS; ++e) lane(at.c[JUMP[e]], l) = lane(at.jump[e], l) <= 0 ? -INFINITY : INFINITY;
  for (int k = 0; k < at.now.passed[l]; ++k) lane(at.c[JUMP[at.order[k * LANES + l]]], l) = -INFINITY;
}

// Sort the jumps of each lane before its end by time; `backwards` reverses the order of those at one instant.
static void sort_jumps(const Job& job, Trajectory& at) {
  for (int e = 0; e < JUMPS; ++e) at.jump[e] = at.c[JUMP[e]];
  for (int l = 0; l < LANES; ++l) {
    at.jumps[l] = at.now.passed[l] = 0;
    for (int e = 0; e < JUMPS; ++e) {
      const double when = lane(at.jump[e], l);
      if (!(when > 0 && when < job.time(job.intervals))) continue;
      int k = at.jumps[l]++;
      for (; k > 0; --k) {
        const double other = lane(at.jump[at.order[(k - 1) * LANES + l]], l);
        if (!(other > when || (job.backwards && other == when))) break;
        at.order[k * LANES + l] = at.order[(k - 1) * LANES + l];
      }
      at.order[k * LANES + l] = e;
    }
    set_sides(at, l);
  }
}

// Longest step of a lane.
INLINE double longest(const Job& job, const Trajectory& at, int l) {
  double h = job.h;
#ifdef WITH_EVENTS
  for (int f = 0; f < FINES; ++f)
    if (lane(at.now.watch.mode[FINE[f]], l) != 0) h = ::fmin(h, FINE_STEP[f] * job.finer);
#endif
  return h;
}

// Grading of steps where one of FINE is turned on or off and the law may be rough, such as a force that begins as t^1.5. At
// the time d from there, within a window W, steps are at most h (d / W)^(2/3). A force t^n then keeps the order of a method
// up to 3 (n + 1). The lengths are h over powers of two, so that they are piecewise constant in the parameters.
static void grade(const Job& job, Trajectory& at, int l) {
#ifdef WITH_EVENTS
  Step& s = at.now.step;
  Watch& w = at.now.watch;
  lane(w.graded, l) = 0.;
  for (int f = 0; f < FINES; ++f) {
    if (lane(w.mode[FINE[f]], l) == 0) continue;
    const double finest = FINE_STEP[f] * job.finer;
    const double h = ::fmin(job.h, finest), window = FINE_GROW[f] * (finest < INFINITY ? finest : job.h);
    const double since = lane(s.t, l) - lane(w.on[f], l), ahead = ::fmax(lane(w.off[f], l) - lane(s.t, l), 0.);
    const double near = ::fmin(since, ahead) / window, least = h / window * (h / window);
    double part = 1.;
    while (part > least && part * part * part > near * near) part /= 2;
    if (lane(s.h, l) > h * part * (1 + 1e-9)) lane(s.h, l) = h * part, lane(w.graded, l) = 1.;
  }
#endif
}

// Minimum number of steps between two jumps within a sample interval, since the motion there has its own time scale.
enum { FEWEST = 8 };

// Begin the next segment of lane l, up to its next jump or the end of the interval. A lane that an event ended waits.
static void next_segment(const Job& job, Trajectory& at, int l) {
  Step& s = at.now.step;
  if (EVENTS && lane(at.now.alive, l) == 0) {
    lane(s.busy, l) = lane(s.h, l) = 0.;
    return;
  }
  if (JUMPS && lane(s.to, l) >= 0) {
    lane(at.c[JUMP[int(lane(s.to, l))]], l) = -INFINITY;
    ++at.now.passed[l];
#ifdef WITH_TABLES
    lane(at.now.stale, l) = 1.;
#endif
#ifdef WITH_EVENTS
    lane(at.now.watch.fresh, l) = 1.;
#endif
  }
  const double h = longest(job, at, l);
  const double from = job.time(at.now.interval - 1), until = job.time(at.now.interval), begin = lane(s.end, l);
  double end = until;
  lane(s.from, l) = lane(s.to, l), lane(s.to, l) = -1.;
  if (JUMPS && at.now.passed[l] < at.jumps[l]) {
    const int e = at.order[at.now.passed[l] * LANES + l];
    if (lane(at.jump[e], l) <= until) end = lane(at.jump[e], l), lane(s.to, l) = e;
  }
  const bool whole = begin == from && end == until && h == job.h;
  const bool piece = (lane(s.from, l) >= 0 || begin == 0) && lane(s.to, l) >= 0 && end > begin;
  const double fewest = piece ? FEWEST / job.finer : 1., needed = ::ceil((end - begin) / h * (1 - 1e-9));
  const double number = whole ? double(job.every) : ::fmax(fewest, needed);
  lane(s.begin, l) = lane(s.t, l) = begin, lane(s.end, l) = end, lane(s.index, l) = 0., lane(s.number, l) = number;
  lane(s.h, l) = whole ? job.h : (end - begin) / number, lane(s.busy, l) = 1.;
  grade(job, at, l);
}

// Count the step in the lanes in which it was `accepted`, and prepare the next one of the sample interval.
INLINE void advance(const Job& job, Trajectory& at, real accepted) {
  Step& s = at.now.step;
  s.index = s.index + accepted;
  const real over = s.index >= s.number, t = select(over, s.end, s.begin + s.index * s.h);
  s.t = EVENTS ? select(accepted, t, s.t) : t;
  for (int l = 0; FINES && l < LANES; ++l)
    if (lane(accepted, l) != 0 && lane(over, l) == 0) grade(job, at, l);
  if (!any(over)) return;
  const double until = job.time(at.now.interval);
  for (int l = 0; l < LANES; ++l) {
    if (lane(over, l) == 0) continue;
    if (lane(s.end, l) < until) next_segment(job, at, l);
    else lane(s.busy, l) = lane(s.h, l) = 0.;
  }
}

// Weight of slope j in stage s; the stage after the last is the solution.
INLINE double weight(int s, int j) { return s < method.TOTAL ? method.A[s < method.TOTAL ? s : 0][j] : method.B[j]; }
INLINE int length(int s) { return s < method.TOTAL ? s : method.STAGES; }

// Storage of the stages' slopes. In a plain rollout they share places, which stay in the first-level cache; the adjoint and
// the error estimate need all of them.
template <bool SHARED> INLINE int place_of(int s) { return (SHARED ? method.PLACE[s] : s) * NX; }

// x + h (sum of weights times slopes).
template <bool SHARED, class S>
INLINE void combine(S s, real h, const real* __restrict x, const real* __restrict k, real* __restrict to) {
  const int n = length(s);
  real w[method.TOTAL + 1];
#pragma GCC unroll 16
  for (int j = 0; j < n; ++j) w[j] = h * weight(s, j);
  for (int i = 0; i < NX; ++i) {
    real sum = x[i];
#pragma GCC unroll 16
    for (int j = 0; j < n; ++j)
      if (weight(s, j) != 0) sum = sum + w[j] * k[place_of<SHARED>(j) + i];
    to[i] = sum;
  }
}

#ifdef WITH_RATE
// Forward sensitivities of a step whose start and length depend on the parameters. The state is (x, x', integrals,
// integrals') with ' the derivative along the lane's direction, and c[RATE] is the derivative of time. The stages' slopes k
// carry the derivative at fixed h; from X = x + h sum w_j k_j the length adds dh sum w_j k_j to X'.
template <bool SHARED, class S> INLINE void add_length_derivative(S s, real dh, const real* __restrict k, real* __restrict to) {
  const int n = (NX - INTEGRALS) / 2, m = INTEGRALS / 2;
  for (int i = 0; i < n + m; ++i) {
    const int from = i < n ? i : i + n, dashed = i < n ? i + n : i + n + m;
    real sum = to[dashed];
#pragma GCC unroll 16
    for (int j = 0; j < length(s); ++j)
      if (weight(s, j) != 0) sum = sum + (dh * weight(s, j)) * k[place_of<SHARED>(j) + from];
    to[dashed] = sum;
  }
}

// Derivatives of a step's start time and length: with the ends t0 and t1 of its segment, h = (t1 - t0) / N, t = t0 + i h.
static void step_time_sensitivity(const Trajectory& at, real& dt, real& dh) {
  const Step& s = at.now.step;
  for (int l = 0; l < LANES; ++l) {
    const int from = int(lane(s.from, l)), to = int(lane(s.to, l));
    double begin = from >= 0 && JUMP_SLOPE[from] >= 0 ? lane(at.c[JUMP_SLOPE[from]], l) : 0.;
#ifdef WITH_EVENTS
    if (from == HERE) begin = lane(at.now.watch.begin_slope, l);
#endif
    const double end = to >= 0 && JUMP_SLOPE[to] >= 0 ? lane(at.c[JUMP_SLOPE[to]], l) : 0.;
    lane(dh, l) = (end - begin) / lane(s.number, l);
    lane(dt, l) = begin + lane(s.index, l) * lane(dh, l);
#ifdef WITH_EVENTS
    if (EVENTS && lane(at.now.watch.graded, l) != 0) lane(dh, l) = 0.;
#endif
  }
}
#endif

// Slopes of a step's stages up to the last one, from x.
template <bool SHARED, class Last>
INLINE void stages(Last last, Trajectory& at, real dt, real dh, const real* x, real* k, real* m) {
  for_stages(last, [&](auto s) {
    real stage[NX], ignored[NM + 1];
    const Step& now = at.now.step;
    const real t[1] = {now.t + method.C[s] * now.h};
    if (s > 0) combine<SHARED>(s, now.h, x, k, stage);
#ifdef WITH_RATE
    if (s > 0 && RATE >= 0) add_length_derivative<SHARED>(s, dh, k, stage);
    if (RATE >= 0) at.c[RATE] = dt + method.C[s] * dh;
#endif
    G::dynamics(t, s > 0 ? stage : x, at.c, k + place_of<SHARED>(s), s > 0 ? ignored : m);
  });
}

// One step from x to `next`; `k` has room for the slopes. dt and dh are the derivatives of its start time and length. If the
// length is zero in every lane (coincident events), all slopes equal the first.
template <bool SHARED, class Last>
INLINE void step(Last last, Trajectory& at, const real* x, real* k, real* m, real* next, real dt, real dh) {
  real sum[NX];
#if defined(WITH_EVENTS) && (defined(GENERIC) || !defined(WITH_RATE))
  if (EVENTS && RATE < 0 && !any(at.now.step.h > 0.)) {
    G::dynamics(&at.now.step.t, x, at.c, k + place_of<SHARED>(0), m);
    for (int s = 1; s < (SHARED ? int(method.PLACES) : int(last)); ++s)
      if (s * NX != place_of<SHARED>(0)) copy(k + s * NX, k + place_of<SHARED>(0), NX);
    G::normalise(x, next);
    return;
  }
#endif
  stages<SHARED>(last, at, dt, dh, x, k, m);
  combine<SHARED>(SOLUTION, at.now.step.h, x, k, sum);
#ifdef WITH_RATE
  if (RATE >= 0) add_length_derivative<SHARED>(SOLUTION, dh, k, sum), at.c[RATE] = 0.;
#endif
  G::normalise(sum, next);
}

template <bool SHARED, class Last>
INLINE void step(Last last, Trajectory& at, const real* x, real* k, real* m, real* next) {
  real dt = 0., dh = 0.;
#ifdef WITH_RATE
  if (RATE >= 0) step_time_sensitivity(at, dt, dh);
#endif
  step<SHARED>(last, at, x, k, m, next, dt, dh);
}

// Record the estimated error of a step of length h to `next` in the lanes in which it was `accepted`.
static void record_error(Trajectory& at, real h, const real* k, const real* next, real accepted) {
  for (int i = 0; i < NX - INTEGRALS; ++i) {
    real sum = 0.;
    for (int s = 0; s < method.TOTAL; ++s) sum = sum + method.E[s] * k[place_of<false>(s) + i];
    at.error[i] = select(accepted, fmax(at.error[i], fabs(h * sum)), at.error[i]);
    at.size[i] = select(accepted, fmax(at.size[i], fabs(next[i])), at.size[i]);
  }
}

// Largest error estimate, relative to the largest magnitude of its state if that is above one.
static real largest_error(const Trajectory& at) {
  real worst = 0.;
  for (int i = 0; i < NX - INTEGRALS; ++i) worst = fmax(worst, at.error[i] / fmax(1., at.size[i]));
  return worst;
}

// Whether every state is finite and within the bounds around its initial value.
INLINE real is_sound(const real* x, const real* begin, const double* scale) {
  real sum[4] = {0., 0., 0., 0.};  // four sums, since one would wait for each of its own additions
  for (int i = 0; i < NX; ++i) {
    const real far = (x[i] - begin[i]) * scale[i];
    sum[i % 4] = sum[i % 4] + far * far;
  }
  return (sum[0] + sum[1]) + (sum[2] + sum[3]) < 1.;  // false for a NaN as well
}
