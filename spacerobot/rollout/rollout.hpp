// Rollouts of a closed loop by an explicit Runge-Kutta method, and their adjoint, over lanes. Follows `lanes.hpp`,
// `struct Generated` and `struct Method` (a tableau):
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
//
// JUMP lists the places in c of the times at which the dynamics jump. A rollout is cut into segments at its samples
// and at its own jumps, and each segment into equal steps, so that no step crosses a jump. On which side of a jump a
// step lies is not left to rounding: c then holds plus infinity for a jump that lies ahead, minus infinity for one that
// lies behind. Each lane has segments of its own; one that has reached the end of a sample interval waits for the
// others and keeps its bits.
typedef Generated G;
typedef Method M;
enum {
  NP = G::setup_p, NX = G::dynamics_x, NC = G::dynamics_c, NM = G::dynamics_m, NY = G::outputs_y, NE = G::final_e,
  NJ = G::objective_J, NR = INTEGRALS + NM + NE
};

struct Job {
  int64_t count, intervals, every;  // rollouts, sample intervals, steps in one without a jump
  double h;                         // step where there is no jump, s
  const double* p;                  // (count, NP)
  const double* scale;              // (NX), one over how far each state may go from where it begins
  double* x;                        // (count, samples, NX) or null
  double* y;                        // (count, samples, rows) or null
  const int64_t* row;               // (rows), which outputs to record
  int64_t rows;
  double* r;                        // (count, NR)
  double* cost;                     // (count, NJ)
  double* error;                    // (count) or null: largest estimate of a step's error in any state
  double* reached;                  // (count), time of the last good state
  int64_t* done;                    // (count), steps done
  const volatile int32_t* stop;     // leave early when this becomes non-zero
  double time(int64_t sample) const { return double(sample * every) * h; }
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

// The step that each lane does next: when it begins, its length, which of how many of its segment it is, at which jumps
// that segment begins and ends (-1: at none), and the segment's ends themselves. A lane that waits has length 0.
struct Step {
  real t, h, index, number, from, to, begin, end, busy;
};

// Where one group of LANES rollouts is.
struct Position {
  real x[NX];
  Step step;
  int64_t interval;   // sample intervals begun
  int passed[LANES];  // jumps behind each lane
};

// What it has come to. `jump` holds the jumps' times, `order` those that each lane meets, in turn.
struct Course {
  Position now;
  real c[NC + 1], begin[NX], r[NR + 1], when[PEAKS + 1], alive, done, reached, jump[JUMPS + 1];
  int order[LANES][JUMPS + 1], jumps[LANES];
  real error[NX], size[NX];  // largest estimate of a step's error, and largest size, of each state
};

// Tell the constants of a lane on which side of each jump it is.
static void set_sides(Course& at, int l) {
  for (int e = 0; e < JUMPS; ++e) lane(at.c[JUMP[e]], l) = lane(at.jump[e], l) <= 0 ? -INFINITY : INFINITY;
  for (int k = 0; k < at.now.passed[l]; ++k) lane(at.c[JUMP[at.order[l][k]]], l) = -INFINITY;
}

// Find the jumps that each lane meets before the end, in turn.
static void sort_jumps(const Job& job, Course& at) {
  for (int e = 0; e < JUMPS; ++e) at.jump[e] = at.c[JUMP[e]];
  for (int l = 0; l < LANES; ++l) {
    at.jumps[l] = at.now.passed[l] = 0;
    for (int e = 0; e < JUMPS; ++e) {
      const double when = lane(at.jump[e], l);
      if (!(when > 0 && when < job.time(job.intervals))) continue;
      int k = at.jumps[l]++;
      for (; k > 0 && lane(at.jump[at.order[l][k - 1]], l) > when; --k) at.order[l][k] = at.order[l][k - 1];
      at.order[l][k] = e;
    }
    set_sides(at, l);
  }
}

// What begins and ends with a jump within a sample interval is a motion of its own, and gets so many steps at least.
enum { FEWEST = 8 };

// Let lane l go on from the end of its segment, or from where it begins, to its next jump or the interval's end.
static void next_segment(const Job& job, Course& at, int l) {
  Step& s = at.now.step;
  if (JUMPS && lane(s.to, l) >= 0) {
    lane(at.c[JUMP[int(lane(s.to, l))]], l) = -INFINITY;
    ++at.now.passed[l];
  }
  const double from = job.time(at.now.interval - 1), until = job.time(at.now.interval), begin = lane(s.end, l);
  double end = until;
  lane(s.from, l) = lane(s.to, l), lane(s.to, l) = -1.;
  if (JUMPS && at.now.passed[l] < at.jumps[l]) {
    const int e = at.order[l][at.now.passed[l]];
    if (lane(at.jump[e], l) <= until) end = lane(at.jump[e], l), lane(s.to, l) = e;
  }
  const bool whole = begin == from && end == until;
  const bool piece = (lane(s.from, l) >= 0 || begin == 0) && lane(s.to, l) >= 0 && end > begin;
  const double fewest = piece ? FEWEST : 1., needed = std::ceil((end - begin) / job.h * (1 - 1e-9));
  const double number = whole ? double(job.every) : std::fmax(fewest, needed);
  lane(s.begin, l) = lane(s.t, l) = begin, lane(s.end, l) = end, lane(s.index, l) = 0., lane(s.number, l) = number;
  lane(s.h, l) = whole ? job.h : (end - begin) / number, lane(s.busy, l) = 1.;
}

// Count the step that was done, and make ready the one that follows within the sample interval.
INLINE void advance(const Job& job, Course& at) {
  Step& s = at.now.step;
  s.index = s.index + s.busy;
  const real over = s.index >= s.number;
  s.t = select(over, s.end, s.begin + s.index * s.h);
  if (!any(over)) return;
  const double until = job.time(at.now.interval);
  for (int l = 0; l < LANES; ++l) {
    if (lane(over, l) == 0) continue;
    if (lane(s.end, l) < until) next_segment(job, at, l);
    else lane(s.busy, l) = lane(s.h, l) = 0.;
  }
}

// Weight of slope j in stage s; the stage after the last is the solution.
constexpr double weight(int s, int j) { return s < M::TOTAL ? M::A[s < M::TOTAL ? s : 0][j] : M::B[j]; }
constexpr int length(int s) { return s < M::TOTAL ? s : M::STAGES; }
enum { SOLUTION = M::TOTAL };

// Where the slopes of the stages go. A plain rollout lets them share places, which then stay in the nearest cache; what
// looks at them later (the adjoint, the error estimate) keeps them all.
template <bool SHARED> constexpr int place_of(int s) { return (SHARED ? M::PLACE[s] : s) * NX; }

// x + h (sum of weights times slopes).
template <int S, bool SHARED>
INLINE void combine(real h, const real* __restrict x, const real* __restrict k, real* __restrict to) {
  constexpr int n = length(S);
  real w[n + 1];
#pragma GCC unroll 16
  for (int j = 0; j < n; ++j) w[j] = h * weight(S, j);
  for (int i = 0; i < NX; ++i) {
    real sum = x[i];
#pragma GCC unroll 16
    for (int j = 0; j < n; ++j)
      if (weight(S, j) != 0) sum = sum + w[j] * k[place_of<SHARED>(j) + i];
    to[i] = sum;
  }
}

#ifdef RATE
// Forward sensitivities of a step whose place and length depend on the parameters: the state holds (x, x', integrals,
// integrals'), a dash being the derivative along the lane's direction, and c[RATE] the derivative of time itself.
template <int S, bool SHARED> INLINE void shear(real dh, const real* __restrict k, real* __restrict to) {
  constexpr int n = (NX - INTEGRALS) / 2, m = INTEGRALS / 2;
  for (int i = 0; i < n + m; ++i) {
    const int from = i < n ? i : i + n, dashed = i < n ? i + n : i + n + m;
    real sum = to[dashed];
#pragma GCC unroll 16
    for (int j = 0; j < length(S); ++j)
      if (weight(S, j) != 0) sum = sum + (dh * weight(S, j)) * k[place_of<SHARED>(j) + from];
    to[dashed] = sum;
  }
}

// Derivatives of a step's beginning and length.
static void moved(const Course& at, real& dt, real& dh) {
  const Step& s = at.now.step;
  for (int l = 0; l < LANES; ++l) {
    const int from = int(lane(s.from, l)), to = int(lane(s.to, l));
    const double begin = from >= 0 && JUMP_SLOPE[from] >= 0 ? lane(at.c[JUMP_SLOPE[from]], l) : 0.;
    const double end = to >= 0 && JUMP_SLOPE[to] >= 0 ? lane(at.c[JUMP_SLOPE[to]], l) : 0.;
    lane(dh, l) = (end - begin) / lane(s.number, l);
    lane(dt, l) = begin + lane(s.index, l) * lane(dh, l);
  }
}
#endif

// Slopes of the stages from S to LAST - 1 of a step from x.
template <int S, int LAST, bool SHARED>
INLINE void stages(Course& at, real dt, real dh, const real* x, real* k, real* m) {
  if constexpr (S < LAST) {
    real stage[NX], ignored[NM + 1];
    const Step& s = at.now.step;
    const real t[1] = {s.t + M::C[S] * s.h};
    if (S > 0) combine<S, SHARED>(s.h, x, k, stage);
#ifdef RATE
    if (S > 0) shear<S, SHARED>(dh, k, stage);
    at.c[RATE] = dt + M::C[S] * dh;
#endif
    G::dynamics(t, S > 0 ? stage : x, at.c, k + place_of<SHARED>(S), S > 0 ? ignored : m);
    stages<S + 1, LAST, SHARED>(at, dt, dh, x, k, m);
  }
}

// One step from x to `next`; `k` has room for the slopes.
template <bool SHARED, int LAST = M::STAGES>
INLINE void step(Course& at, const real* x, real* k, real* m, real* next) {
  real sum[NX], dt = 0., dh = 0.;
#ifdef RATE
  moved(at, dt, dh);
#endif
  stages<0, LAST, SHARED>(at, dt, dh, x, k, m);
  combine<SOLUTION, SHARED>(at.now.step.h, x, k, sum);
#ifdef RATE
  shear<SOLUTION, SHARED>(dh, k, sum);
  at.c[RATE] = 0.;
#endif
  G::normalise(sum, next);
}

// The same, and an estimate of its error.
static void estimated_step(Course& at, const real* x, real* k, real* m, real* next) {
  step<false, M::TOTAL>(at, x, k, m, next);
  const real counts = at.alive && at.now.step.busy;
  for (int i = 0; i < NX - INTEGRALS; ++i) {
    real sum = 0.;
    for (int s = 0; s < M::TOTAL; ++s) sum = sum + M::E[s] * k[place_of<false>(s) + i];
    at.error[i] = select(counts, fmax(at.error[i], fabs(at.now.step.h * sum)), at.error[i]);
    at.size[i] = select(counts, fmax(at.size[i], fabs(next[i])), at.size[i]);
  }
}

// The largest estimate, relative to the largest size of its state where that is above one.
static real largest_error(const Course& at) {
  real worst = 0.;
  for (int i = 0; i < NX - INTEGRALS; ++i) worst = fmax(worst, at.error[i] / fmax(1., at.size[i]));
  return worst;
}

// Truth where every state is a number and not too far from where it began.
INLINE real is_sound(const real* x, const real* begin, const double* scale) {
  real sum[4] = {0., 0., 0., 0.};  // four sums, since one would wait for each of its own additions
  for (int i = 0; i < NX; ++i) {
    const real far = (x[i] - begin[i]) * scale[i];
    sum[i % 4] = sum[i % 4] + far * far;
  }
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

static void sample(const Job& job, int64_t first, const Course& at) {
  const int64_t samples = job.intervals + 1, s = at.now.interval;
  real y[NY + 1];
  const real t[1] = {job.time(s)};
  if (job.y) G::outputs(t, at.now.x, at.c, y);
  for (int l = 0; l < LANES && first + l < job.count; ++l) {
    if (lane(at.alive, l) == 0) continue;
    const int64_t place = (first + l) * samples + s;
    if (job.x) for (int i = 0; i < NX; ++i) job.x[place * NX + i] = lane(at.now.x[i], l);
    if (job.y) for (int64_t i = 0; i < job.rows; ++i) job.y[place * job.rows + i] = lane(y[job.row[i]], l);
  }
}

// Begin the next sample interval where every lane has reached the end of the last one; false after the last.
INLINE bool ready(const Job& job, Course& at) {
  if (any(at.now.step.busy)) return true;
  if (at.now.interval == job.intervals) return false;
  ++at.now.interval;
  for (int l = 0; l < LANES; ++l) next_segment(job, at, l);
  return true;
}

// What the adjoint remembers of a step.
struct Record {
  Step step;
  real x[NX], slope[M::STAGES * NX];
};

// Integrate one group; the number of steps, or -1 when told to stop. A lane whose state leaves the bounds, or is no
// number, keeps its last good state from then on. `tape` (room for `segment` steps) holds the last steps, `checkpoint`
// where the group was before every so many.
static int64_t integrate(const Job& job, int64_t first, const real* p, Course& at, Record* tape, int64_t segment,
                         Position* checkpoint) {
  real slopes[(LANES == 1 ? int(M::TOTAL) : int(M::PLACES)) * NX], m[NM + 1], next[NX];
  Position& now = at.now;
  std::memset(&now.step, 0, sizeof now.step);
  now.interval = 0, now.step.to = -1.;
  G::setup(p, now.x, at.c);
  std::memcpy(at.begin, now.x, sizeof at.begin);
#ifdef RATE
  at.c[RATE] = 0.;
#endif
  sort_jumps(job, at);
  at.alive = 1., at.done = at.reached = 0.;
  for (int i = 0; i < NX; ++i) at.error[i] = 0., at.size[i] = fabs(now.x[i]);
  real* best = at.r + INTEGRALS;
  for (int i = 0; i < NM; ++i) best[i] = -INFINITY;
  for (int i = 0; i < PEAKS; ++i) at.when[i] = 0.;
  int64_t k = 0;
  for (;; ++k) {
    if (*job.stop) return -1;
    if ((job.x || job.y) && !any(now.step.busy)) sample(job, first, at);
    if (!ready(job, at)) break;
    Record* place = tape ? tape + k % segment : nullptr;
    if (place) {
      if (k % segment == 0) checkpoint[k / segment] = now;
      place->step = now.step;
      std::memcpy(place->x, now.x, sizeof now.x);
      step<false>(at, now.x, place->slope, m, next);
    } else if (LANES == 1 && job.error) {
      estimated_step(at, now.x, slopes, m, next);
    } else {
      step<true>(at, now.x, slopes, m, next);
    }
    const real goes = at.alive && now.step.busy;
    if (PEAKS) compete(m, goes, k, best, at.when);
    const real good = goes && is_sound(next, at.begin, job.scale);
    at.alive = at.alive && (good || !now.step.busy);
    if (!any(at.alive)) break;
    for (int i = 0; i < NX; ++i) now.x[i] = select(good, next[i], now.x[i]);
    at.done = at.done + good;
    advance(job, at);
    at.reached = select(at.alive, now.step.t, at.reached);
  }
  const real t[1] = {job.time(job.intervals)};
  if (PEAKS) {
    G::dynamics(t, now.x, at.c, next, m);
    compete(m, at.alive, k, best, at.when);
  }
  for (int i = 0; i < INTEGRALS; ++i) at.r[i] = now.x[NX - INTEGRALS + i];
  G::final(t, now.x, at.c, best + NM);
  for (int i = 0; i < NR; ++i) at.r[i] = select(at.alive, at.r[i], NAN);
  return k;
}

static void store(const Job& job, int64_t first, const Course& at, const real* cost) {
  scatter(at.r, NR, first, job.count, job.r);
  scatter(cost, NJ, first, job.count, job.cost);
  scatter(&at.reached, 1, first, job.count, job.reached);
  const real error = largest_error(at);
  if (job.error) scatter(&error, 1, first, job.count, job.error);
  for (int l = 0; l < LANES && first + l < job.count; ++l) job.done[first + l] = int64_t(lane(at.done, l));
}

extern "C" int64_t rollouts(const Job* given) {
  const Job& job = *given;
  for (int64_t first = 0; first < job.count; first += LANES) {
    real p[NP + 1], cost[NJ + 1];
    Course at;
    gather(job.p, first, job.count, NP, p);
    if (integrate(job, first, p, at, nullptr, 1, nullptr) < 0) return first;
    G::objective(at.r, p, cost);
    store(job, first, at, cost);
  }
  return job.count;
}

#ifdef ADJOINT
// Reverse of every function above; the seeds and results carry the name of what they belong to with a bar, and
// cbar has only the NW constants that the wanted parameters reach:
//
//   dynamics_reverse(t, x, c, vbar -> xbar, cbar, tbar)    peaks_reverse(t, x, c, mbar -> xbar, cbar, tbar)
//   normalise_reverse(x, nbar -> xbar)                     final_reverse(t, x, c, ebar -> xbar, cbar, tbar)
//   objective_reverse(r, p, Jbar -> rbar, pbar)            setup_reverse(p, xbar, cbar -> pbar)
//
// MOVING tells whether the wanted parameters move a jump; tbar is empty otherwise, and always that of final_reverse.
// JUMP_BAR holds the places of the jumps in cbar, -1 for one that stays.
enum { NW = G::dynamics_reverse_cbar, NG = G::setup_reverse_pbar, MOVING = G::dynamics_reverse_tbar };

struct AdjointJob {
  const double* seed;  // (count, NJ), the weight of each cost
  double* gradient;    // (count, NG)
  int64_t segment;     // steps between checkpoints
};

// What flows back.
struct Bars {
  real x[NX], c[NW + 1], t, h;
};

INLINE void accumulate(real* sum, const real* part, int n) {
  for (int i = 0; i < n; ++i) sum[i] = sum[i] + part[i];
}

// Through the stages from S down to the first; `sum` is the bar of the solution before it is normalised, `stage` has
// room for those of the stages' states.
template <int S>
INLINE void stages_reverse(const Record& past, const real* c, const real* sum, real* stage, Bars& bar) {
  if constexpr (S >= 0) {
    real x[NX], seed[NX], part[NW + 1], tbar[2];
    const real h = past.step.h, t[1] = {past.step.t + M::C[S] * h}, *k = past.slope + S * NX;
    real length = 0.;
    for (int i = 0; i < NX; ++i) {
      real total = M::B[S] * sum[i];
#pragma GCC unroll 16
      for (int j = S + 1; j < M::STAGES; ++j)
        if (M::A[j][S] != 0) total = total + M::A[j][S] * stage[j * NX + i];
      if (MOVING) length = length + total * k[i];
      seed[i] = h * total;
    }
    if (S > 0) combine<S, false>(h, past.x, past.slope, x);
    G::dynamics_reverse(t, S > 0 ? x : past.x, c, seed, stage + S * NX, part, tbar);
    accumulate(bar.x, stage + S * NX, NX);
    accumulate(bar.c, part, NW);
    if (MOVING) bar.t = bar.t + tbar[0], bar.h = bar.h + length + M::C[S] * tbar[0];
    stages_reverse<S - 1>(past, c, sum, stage, bar);
  }
}

// bar.x at the end of a step becomes bar.x at its beginning; a lane that waited keeps it.
static void step_reverse(const Record& past, const real* c, Bars& bar) {
  real sum[NX], raw[NX], stage[M::STAGES * NX], kept[NX];
  combine<SOLUTION, false>(past.step.h, past.x, past.slope, raw);
  G::normalise_reverse(raw, bar.x, sum);
  for (int i = 0; i < NX; ++i) {
    kept[i] = bar.x[i];
    bar.x[i] = sum[i] = select(past.step.busy, sum[i], 0.);
  }
  stages_reverse<M::STAGES - 1>(past, c, sum, stage, bar);
  for (int i = 0; i < NX; ++i) bar.x[i] = select(past.step.busy, bar.x[i], kept[i]);
}

// Seeds of the peaks that were met at step k.
static void peaks_reverse(int64_t k, real t, const Course& at, const real* x, const real* rbar, Bars& bar) {
  real seed[PEAKS + 1], xpart[NX], cpart[NW + 1], tpart[2], here = 0.;
  for (int i = 0; i < PEAKS; ++i) {
    const real met = at.when[i] == real(double(k));
    seed[i] = select(met, rbar[INTEGRALS + i], 0.);
    here = here || met;
  }
  if (!any(here)) return;
  const real instant[1] = {t};
  G::peaks_reverse(instant, x, at.c, seed, xpart, cpart, tpart);
  accumulate(bar.x, xpart, NX);
  accumulate(bar.c, cpart, NW);
  if (MOVING) bar.t = bar.t + tpart[0];
}

// From a step's beginning and length to the jumps at the ends of its segment; the sides of a jump that it began at go
// back with it.
static void ends_reverse(const Step& s, Course& at, Bars& bar) {
  for (int l = 0; JUMPS && l < LANES; ++l) {
    const int from = int(lane(s.from, l)), to = int(lane(s.to, l));
    if (lane(s.busy, l) == 0 || (from < 0 && to < 0)) continue;
    const double t = lane(bar.t, l), share = (lane(bar.h, l) + lane(s.index, l) * t) / lane(s.number, l);
    if (MOVING && from >= 0 && JUMP_BAR[from] >= 0) lane(bar.c[JUMP_BAR[from]], l) += t - share;
    if (MOVING && to >= 0 && JUMP_BAR[to] >= 0) lane(bar.c[JUMP_BAR[to]], l) += share;
    if (from >= 0 && lane(s.index, l) == 0) lane(at.c[JUMP[from]], l) = INFINITY;
  }
  bar.t = bar.h = 0.;
}

// Do the steps of a segment of the tape once more.
static void again(const Job& job, Course& at, Record* tape, int64_t number) {
  real m[NM + 1], next[NX];
  for (int l = 0; l < LANES; ++l) set_sides(at, l);
  for (int64_t k = 0; k < number; ++k) {
    if (k > 0) advance(job, at), ready(job, at);  // a checkpoint is taken when a step is ready
    tape[k].step = at.now.step;
    std::memcpy(tape[k].x, at.now.x, sizeof at.now.x);
    step<false>(at, at.now.x, tape[k].slope, m, next);
    for (int i = 0; i < NX; ++i) at.now.x[i] = select(at.now.step.busy, next[i], at.now.x[i]);
  }
}

extern "C" int64_t gradients(const Job* given, const AdjointJob* adjoint) {
  const Job& job = *given;
  const int64_t segment = adjoint->segment, most = job.intervals * job.every + JUMPS * LANES * (FEWEST + 2);
  std::unique_ptr<Record[]> tape(new (std::nothrow) Record[segment]);
  std::unique_ptr<Position[]> checkpoint(new (std::nothrow) Position[most / segment + 1]);
  std::unique_ptr<Course> course(new (std::nothrow) Course);
  std::unique_ptr<Bars> bars(new (std::nothrow) Bars);
  if (!tape || !checkpoint || !course || !bars) return -1;
  Course& at = *course;
  Bars& bar = *bars;
  for (int64_t first = 0; first < job.count; first += LANES) {
    real p[NP + 1], cost[NJ + 1], seed[NJ + 1], rbar[NR + 1], pbar[NG + 1], direct[NG + 1];
    gather(job.p, first, job.count, NP, p);
    gather(adjoint->seed, first, job.count, NJ, seed);
    const int64_t steps = integrate(job, first, p, at, tape.get(), segment, checkpoint.get());
    if (steps < 0) return first;
    G::objective(at.r, p, cost);
    G::objective_reverse(at.r, p, seed, rbar, direct);
    const real t[1] = {job.time(job.intervals)};
    G::final_reverse(t, at.now.x, at.c, rbar + INTEGRALS + PEAKS, bar.x, bar.c, &bar.t);
    for (int i = 0; i < INTEGRALS; ++i) bar.x[NX - INTEGRALS + i] = rbar[i];
    peaks_reverse(steps, t[0], at, at.now.x, rbar, bar);
    bar.t = bar.h = 0.;
    const int64_t last = any(at.alive) ? (steps - 1) / segment : -1;  // what is lost has no tape
    for (int64_t s = last; s >= 0; --s) {
      const int64_t begin = s * segment, number = s < last ? segment : steps - begin;
      if (s < last) {  // the tape holds a later segment
        at.now = checkpoint[s];
        again(job, at, tape.get(), number);
      }
      for (int64_t k = number - 1; k >= 0; --k) {
        if (*job.stop) return first;
        const Record& past = tape[k];
        step_reverse(past, at.c, bar);
        if (PEAKS) peaks_reverse(begin + k, past.step.t, at, past.x, rbar, bar);
        ends_reverse(past.step, at, bar);
      }
    }
    G::setup_reverse(p, bar.x, bar.c, pbar);
    for (int i = 0; i < NG; ++i) pbar[i] = select(at.alive, pbar[i] + direct[i], NAN);
    scatter(pbar, NG, first, job.count, adjoint->gradient);
    store(job, first, at, cost);
  }
  return job.count;
}
#endif
