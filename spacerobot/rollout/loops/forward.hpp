// Update the largest values and the steps at which they occurred. A NaN remains.
INLINE void update_peaks(const real* m, real alive, int64_t k, real* best, real* when) {
  for (int i = 0; i < PEAKS; ++i) {
    const real wins = alive && !(m[i] <= best[i]) && (best[i] == best[i]);
    for (int j = i; j < NM; j += PEAKS) best[j] = select(wins, m[j], best[j]);
    when[i] = select(wins, double(k), when[i]);
  }
}

// If job.located: record the step that begins at t in the lanes in which it was `accepted`, after `update_peaks`.
static void record_vicinity(Trajectory& at, const real* m, real t, real accepted, int64_t k) {
  Vicinity& v = at.vicinity;
  const real step = double(k);
  for (int i = 0; i < PEAKS; ++i) {
    const real wins = accepted && at.when[i] == step;
    v.since[i] = select(wins, 0., v.since[i] + accepted);
    for (int n = 0; n < AROUND; ++n) {
      const bool earlier = n < OWN;
      const real here = earlier ? wins : accepted && v.since[i] == real(double(n - OWN));
      for (int j = i; j < NM; j += PEAKS)
        v.m[n * NM + j] = select(here, earlier ? v.last_m[n * NM + j] : m[j], select(wins, NAN, v.m[n * NM + j]));
      const int place = n * PEAKS + i;
      v.t[place] = select(here, earlier ? v.last_t[n] : t, v.t[place]);
      v.step[place] = select(here, earlier ? v.last_step[n] : step, v.step[place]);
    }
  }
  for (int j = 0; j < NM; ++j) {
    v.last_m[j] = select(accepted, v.last_m[NM + j], v.last_m[j]);
    v.last_m[NM + j] = select(accepted, m[j], v.last_m[NM + j]);
  }
  v.last_t[0] = select(accepted, v.last_t[1], v.last_t[0]), v.last_t[1] = select(accepted, t, v.last_t[1]);
  v.last_step[0] = select(accepted, v.last_step[1], v.last_step[0]), v.last_step[1] = select(accepted, step, v.last_step[1]);
}

// Derivatives of peaks between steps. The largest step is up to half a step from the signal's maximum, where the derivative
// differs by that time times its rate. By the envelope theorem the derivative of the maximum is that of the signal at its
// time; a dependence of the time itself has no effect. With the steps at the times a < 0, 0 and b > 0 relative to the
// largest, and rise_n = (m_n - m_0) / t_n, the parabola
//
//   m_0 + rise_a s + bend s (s - a),    bend = (rise_b - rise_a) / (b - a),
//
// has its vertex at s = (a - rise_a / bend) / 2. Lagrange's weights of the three steps there interpolate the derivative.
// The second divided difference over the next but one steps, `wider`, equals `bend` for a smooth signal and is half of it
// at a kink, whose peak is at the step itself.
static void locate_peaks(Trajectory& at) {
  const Vicinity& v = at.vicinity;
  for (int i = 0; i < PEAKS; ++i) {
    real dt[AROUND], rise[AROUND];
    for (int n = 0; n < AROUND; ++n) {
      dt[n] = v.t[n * PEAKS + i] - v.t[OWN * PEAKS + i];
      rise[n] = (v.m[n * NM + i] - v.m[OWN * NM + i]) / dt[n];
    }
    const real a = dt[BEFORE], b = dt[AFTER], bend = (rise[AFTER] - rise[BEFORE]) / (b - a);
    const real wider = (rise[AROUND - 1] - rise[0]) / (dt[AROUND - 1] - dt[0]);
    const real smooth = wider < 0.75 * bend && wider > 1.5 * bend && a < -TOGETHER && b > TOGETHER;
    const real vertex = (a - rise[BEFORE] / bend) / 2.;
    const real before = vertex * (vertex - b) / (a * (a - b)), after = vertex * (vertex - a) / (b * (b - a));
    at.share[BEFORE * PEAKS + i] = select(smooth, before, 0.);
    at.share[AFTER * PEAKS + i] = select(smooth, after, 0.);
    at.share[OWN * PEAKS + i] = select(smooth, 1. - before - after, 1.);
    for (int j = i + PEAKS; j < NM; j += PEAKS) {
      real sum = 0.;
      for (int n = BEFORE; n <= AFTER; ++n) sum = sum + at.share[n * PEAKS + i] * v.m[n * NM + j];
      at.r[INTEGRALS + j] = select(smooth, sum, at.r[INTEGRALS + j]);
    }
  }
}

static void sample(const Job& job, int64_t first, const Trajectory& at) {
  const int64_t samples = job.intervals + 1, s = at.now.interval;
  real y[NY + 1];
  const real t[1] = {job.time(s)};
  if (job.y) G::outputs(t, at.now.x, at.c, y);
  for (int l = 0; l < LANES && first + l < job.count; ++l) {
    if (lane(at.now.alive, l) == 0) continue;
    const int64_t place = (first + l) * samples + s;
    if (job.x) for (int i = 0; i < NX; ++i) job.x[place * NX + i] = lane(at.now.x[i], l);
    if (job.y) for (int64_t i = 0; i < job.rows; ++i) job.y[place * job.rows + i] = lane(y[job.row[i]], l);
  }
}

// Begin the next sample interval once every lane has reached the end of the present one; false after the last.
INLINE bool ready(const Job& job, Trajectory& at) {
  if (any(at.now.step.busy)) return true;
  if (at.now.interval == job.intervals) return false;
  ++at.now.interval;
  for (int l = 0; l < LANES; ++l) next_segment(job, at, l);
#ifdef WITH_TABLES
  if (TABLES) look_up(at);
#endif
  return true;
}

// Record of a step and of its events, for the adjoint. `busy` is true only in lanes in which the step was accepted.
struct Record {
  Step step;
#ifdef WITH_TABLES
  ROW(real, row, CURSORS);
#endif
  ROW(real, x, NX);
  ROW(real, slope, method.STAGES * NX);
#ifdef WITH_EVENTS
  StepOutcome outcome;
#endif
};

static void record_step(Record& record, Trajectory& at, real* m, real* next) {
  record.step = at.now.step;
#ifdef WITH_TABLES
  copy(record.row, at.now.row, CURSORS);
#endif
  copy(record.x, at.now.x, NX);
  step<false>(NEEDED_STAGES, at, at.now.x, record.slope, m, next);
}

// Positions at regular numbers of steps. Their number grows on demand, since events add steps.
struct Checkpoints {
  Room<Position> positions;
  int64_t room = 0;
  bool store(int64_t place, const Position& now) {
    if (place >= room) {
      const int64_t more = 2 * room + 16;
      Room<Position> larger(more);
      if (!larger.at || OUT_OF_MEMORY) return false;
      for (int64_t i = 0; i < room; ++i) larger.at[i] = positions.at[i];
      positions.swap(larger), room = more;
    }
    positions.at[place] = now;
    return true;
  }
};

// Accept the step to `next`, with the slopes `k`, in the lanes that take it, and return these lanes. A lane whose state is
// NaN or out of bounds keeps its last valid state from then on, while its time continues. Steps of a backward sweep
// (`is_repeated`) are not counted.
template <bool SHARED>
INLINE real settle(const Job& job, Trajectory& at, const real* k, real* next, Record* record, bool is_repeated) {
  Position& now = at.now;
  const real active = now.alive && now.step.busy, sound = is_sound(next, at.begin, job.scale);
  real accepted = now.step.busy, advances = accepted;
#ifdef WITH_EVENTS
  StepOutcome outcome;
  if (EVENTS) {
    assess_step<SHARED>(job, at, k, next, active && sound, outcome);
    accepted = accepted && !outcome.waits, advances = accepted && !outcome.cut;
#ifdef WITH_RATE
    if (RATE >= 0) differentiate_step(at, outcome, next);
#endif
  } else {
    outcome.waits = outcome.cut = outcome.close = 0., outcome.event = -1.;
  }
  if (record) record->outcome = outcome, record->step.busy = active && accepted;
#endif
  const real good = active && accepted && sound;
  now.alive = now.alive && (good || !accepted);
  for (int i = 0; i < NX; ++i) now.x[i] = select(good, next[i], now.x[i]);
#ifdef WITH_EVENTS
  if (EVENTS) apply_events(job, at, outcome, is_repeated);
#endif
  advance(job, at, advances);
#ifdef WITH_TABLES
  if (TABLES) look_up(at);
#endif
  if (!is_repeated) at.done = at.done + good, at.reached = select(good, now.step.t, at.reached);
  return active && accepted;
}

// Initialise a group of lanes.
static void initialise(const Job& job, int64_t first, const real* p, Trajectory& at) {
  Position& now = at.now;
  std::memset(&now.step, 0, sizeof now.step);
  now.interval = 0, now.step.to = -1., now.alive = 1.;
  G::setup(p, now.x, at.c);
  copy(at.begin, now.x, NX);
#ifdef WITH_RATE
  if (RATE >= 0) at.c[RATE] = 0.;
#endif
  at.first = first, at.done = at.reached = 0.;
  for (int l = 0; l < LANES; ++l)
    at.noise[l] = job.noise + (first + l < job.count ? first + l : job.count - 1) * job.noises;
  for (int l = 0; l < LANES; ++l) at.status[l] = COMPLETED;
#ifdef WITH_EVENTS
  reset_watch(at);
#endif
  sort_jumps(job, at);
#ifdef WITH_TABLES
  now.stale = 1.;
  if (TABLES) look_up(at);
#endif
  for (int i = 0; i < NX; ++i) at.error[i] = 0., at.size[i] = fabs(now.x[i]);
  for (int i = 0; i < NM; ++i) at.r[INTEGRALS + i] = -INFINITY;
  for (int i = 0; i < PEAKS; ++i) at.when[i] = 0.;
  if (job.located) {
    Vicinity& v = at.vicinity;
    for (int j = 0; j < AROUND * NM; ++j) v.m[j] = NAN;
    for (int j = 0; j < 2 * NM; ++j) v.last_m[j] = NAN;
    for (int i = 0; i < AROUND * PEAKS; ++i) v.t[i] = v.step[i] = NAN;
    for (int i = 0; i < PEAKS; ++i) v.since[i] = 0.;
    for (int n = 0; n < 2; ++n) v.last_t[n] = v.last_step[n] = NAN;
  }
}

// Time at which each lane ends.
static real end_of(const Job& job, const Trajectory& at) {
  real t = job.time(job.intervals);
  for (int l = 0; l < LANES; ++l)
    if (at.status[l] == ENDED) lane(t, l) = lane(at.reached, l);
  return t;
}

// Final measures of a group after step k, and the lanes that reached the end.
static void reduce(const Job& job, Trajectory& at, int64_t k) {
  real ignored[NX], m[NM + 1], *best = at.r + INTEGRALS, t[1] = {end_of(job, at)};
  at.whole = at.now.alive;
  for (int l = 0; l < LANES; ++l)
    if (at.status[l] == ENDED) lane(at.whole, l) = 1.;
#ifdef WITH_RATE
  real dt = 0., dh = 0.;
  if (RATE >= 0) step_time_sensitivity(at, dt, dh);
  for (int l = 0; RATE >= 0 && l < LANES; ++l) lane(at.c[RATE], l) = at.status[l] == ENDED ? lane(dt, l) : 0.;
#endif
  if (PEAKS) {
    G::dynamics(t, at.now.x, at.c, ignored, m);
    update_peaks(m, at.whole, k, best, at.when);
    if (job.located) record_vicinity(at, m, t[0], at.whole, k), locate_peaks(at);
  }
  for (int i = 0; i < INTEGRALS; ++i) at.r[i] = at.now.x[NX - INTEGRALS + i];
  G::final(t, at.now.x, at.c, best + NM);
  for (int i = 0; i < NR; ++i) at.r[i] = select(at.whole, at.r[i], NAN);
}

// Integrate one group; returns the number of steps, or a negative reason. `tape` (room for `segment` steps) holds the last
// steps, `checkpoints` the positions before every `segment` steps.
enum { STOPPED = -1, NO_MEMORY = -2 };
static int64_t integrate(const Job& job, int64_t first, const real* p, Trajectory& at, Record* tape, int64_t segment,
                         Checkpoints* checkpoints) {
  real slopes[(LANES == 1 ? int(method.TOTAL) : int(method.PLACES)) * NX], m[NM + 1], next[NX];
  Position& now = at.now;
  initialise(job, first, p, at);
  int64_t k = 0;
  for (; any(now.alive); ++k) {
    if (*job.stop) return STOPPED;
    if ((job.x || job.y) && !any(now.step.busy)) sample(job, first, at);
    if (!ready(job, at)) break;
    Record* record = tape ? tape + k % segment : nullptr;
    const bool estimates = LANES == 1 && job.error && !record;
#ifdef WITH_EVENTS
    if (EVENTS) prepare_step(job, at);
#endif
    const real h = now.step.h, t = now.step.t;
    real accepted;
    if (record) {
      if (k % segment == 0 && !checkpoints->store(k / segment, now)) return NO_MEMORY;
      record_step(*record, at, m, next);
      accepted = settle<false>(job, at, record->slope, next, record, false);
    } else if (estimates) {
      step<false>(ALL_STAGES, at, now.x, slopes, m, next);
      accepted = settle<false>(job, at, slopes, next, nullptr, false);
    } else {
      step<true>(NEEDED_STAGES, at, now.x, slopes, m, next);
      accepted = settle<true>(job, at, slopes, next, nullptr, false);
    }
    if (PEAKS) update_peaks(m, accepted, k, at.r + INTEGRALS, at.when);
    if (PEAKS && job.located) record_vicinity(at, m, t, accepted, k);
    if (estimates) record_error(at, h, slopes, next, accepted);
  }
  reduce(job, at, k);
  return k;
}

static void store(const Job& job, int64_t first, const Trajectory& at, const real* cost) {
  scatter(at.r, NR, first, job.count, job.r);
  scatter(cost, NJ, first, job.count, job.cost);
  scatter(&at.reached, 1, first, job.count, job.reached);
  const real error = largest_error(at);
  if (job.error) scatter(&error, 1, first, job.count, job.error);
  for (int l = 0; l < LANES && first + l < job.count; ++l) {
    const bool lost = lane(at.now.alive, l) == 0 && at.status[l] == COMPLETED;
    job.done[first + l] = int64_t(lane(at.done, l));
    job.status[first + l] = lost ? int64_t(DIVERGED) : at.status[l];
#ifdef WITH_EVENTS
    job.fired[first + l] = at.fired[l];
    job.gradient_warning[2 * (first + l)] = at.gradient_warning[l], job.gradient_warning[2 * (first + l) + 1] = at.warned_event[l];
#endif
  }
}

extern "C" int64_t rollouts(const Job* given) {
  const Job& job = *given;
  Room<Trajectory> trajectory(1);
  Room<real> parameters(NP + 1);
  if (!trajectory.at || !parameters.at || OUT_OF_MEMORY) return NO_MEMORY;
  Trajectory& at = *trajectory.at;
  real* const p = parameters.at;
  for (int64_t first = 0; first < job.count; first += LANES) {
    real cost[NJ + 1];
    gather(job.p, first, job.count, NP, p);
    if (integrate(job, first, p, at, nullptr, 1, nullptr) < 0) return first;
    G::objective(at.r, p, cost);
    store(job, first, at, cost);
  }
  return job.count;
}
