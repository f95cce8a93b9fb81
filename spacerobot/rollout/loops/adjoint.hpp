// Adjoint of a rollout. The adjoint of a quantity, its name with a bar, is the derivative of the weighted costs with
// respect to it. Each function of a kernel has a reverse, from the adjoints of its results (seeds) to those of its
// arguments. cbar has only the NW constants that depend on the parameters of the gradient:
//
//   dynamics_reverse(t, x, c, vbar -> xbar, cbar, tbar)    peaks_reverse(t, x, c, mbar -> xbar, cbar, tbar)
//   normalise_reverse(x, nbar -> xbar)                     final_reverse(t, x, c, ebar -> xbar, cbar, tbar)
//   objective_reverse(r, p, Jbar -> rbar, pbar)            setup_reverse(p, xbar, cbar -> pbar)
//
//   guards_reverse(t, x, c, gbar -> xbar, cbar, tbar)      update_reverse(t, x, c, e, after_bar -> xbar, cbar, tbar)
//
// The last two exist if there are EVENTS. MOVING is whether these parameters may move the ends of segments, that is
// jumps or events; otherwise tbar is empty. tbar of final_reverse is empty without events. JUMP_BAR has the index in
// cbar of each jump, -1 for a constant one. cbar of setup_reverse has further entries for the rows of tables, which no
// other function reads; C_BAR has the index in it of each constant, or -1.
#ifndef GENERIC
enum { NW = G::dynamics_reverse_cbar, NB = G::setup_reverse_cbar, NG = G::setup_reverse_pbar, MOVING = G::dynamics_reverse_tbar };
#endif

// Record of coincident events and jumps, or of an event with others close to it. Python checks with it whether their
// order matters (coincident_events.py). first, last: times of the first and last one. missed: whether a close event did
// not fire. number, occurrence: their number, and the last MAX_OCCURRENCES of them in reverse order, an event by its index,
// jump J as -1 - J. root: whether each is a root of its own guard. mode: switches and sides of jumps before. met: for each
// peak whether its step is among them or after all. before, bar: state before them, and adjoint of the state after them.
enum { MAX_OCCURRENCES = 16 };
enum Met { ELSEWHERE, BETWEEN, AFTERWARDS };
struct Instant {
  double first, last, missed, number, occurrence[MAX_OCCURRENCES], root[MAX_OCCURRENCES];
  ROW(double, mode, SWITCHES + JUMPS + 1);
  ROW(double, met, PEAKS + 1);
  ROW(double, before, NX);
  ROW(double, bar, NX);

  // Copy all members to consecutive numbers.
  void write(double* to) const {
    const double single[] = {first, last, missed, number};
    const double* const part[] = {single, occurrence, root, mode, met, before, bar};
    const int size[] = {4, MAX_OCCURRENCES, MAX_OCCURRENCES, SWITCHES + JUMPS + 1, PEAKS + 1, NX, NX};
    for (int k = 0; k < 7; ++k)
      for (int i = 0; i < size[k]; ++i) *to++ = part[k][i];
  }
};

struct AdjointJob {
  const double* seed;  // (count, NJ), the weight of each cost
  double* gradient;    // (count, NG)
  int64_t segment;     // steps between checkpoints
  int64_t most;        // maximum number of recorded instants of a rollout
  int64_t* instants;   // (count), number of instants
  double* instant;     // (count, most, width), as Instant::write stores them
  int64_t width;
};

// Adjoints during the backward sweep: of the state, of the constants, of the start time t and length h of a step, and
// of the start time of a segment that begins at an event.
struct Adjoints {
  ROW(real, x, NX);
  ROW(real, c, NB + 1);
  real t, h, begin;
};

#ifdef WITH_TABLES
// Restore the windows of tables to the rows of a step, if one is given, after the adjoints of the windows were added to
// those of the rows that they held.
static void restore_windows(Trajectory& at, const real* row, Adjoints& bar) {
  for (int l = 0; l < LANES; ++l) {
    bool other = !row;
    for (int k = 0; row && k < CURSORS; ++k) other |= lane(row[k], l) != lane(at.now.row[k], l);
    if (!other) continue;
    for (int i = 0; i < TABLES; ++i)
      for (int j = 0; j < TABLE_WIDTH[i] && TABLE_NOISE[i] < 0; ++j) {
        const int shown = int(lane(at.now.row[TABLE_CURSOR[i]], l)) * TABLE_WIDTH[i] + j;
        const int from = C_BAR[TABLE_WINDOW[i] + j], to = C_BAR[TABLE_FIRST[i] + shown];
        if (to >= 0) lane(bar.c[to], l) += lane(bar.c[from], l);
        if (from >= 0) lane(bar.c[from], l) = 0.;
      }
    for (int k = 0; row && k < CURSORS; ++k) lane(at.now.row[k], l) = lane(row[k], l);
    if (row) fill(at, l);
  }
}
#endif

INLINE void accumulate(real* sum, const real* part, int n) {
  for (int i = 0; i < n; ++i) sum[i] = sum[i] + part[i];
}

// Reverse of the stages of a Runge-Kutta step (Hager, Numerische Mathematik 87, 2000),
//
//   X_s = x + h sum_{j<s} A_sj k_j,    k_s = f(t + C_s h, X_s),    x1 = x + h sum_s B_s k_s,
//
// from the last stage to the first. With x1bar = `sum` and the adjoints Xbar_s of the stages' states in `stage`
//
//   kbar_s = h m_s,    m_s = B_s x1bar + sum_{j>s} A_js Xbar_j,    Xbar_s = f_x' kbar_s,
//   xbar = x1bar + sum_s Xbar_s,    cbar += f_c' kbar_s,
//   tbar += f_t' kbar_s,    hbar += m_s' k_s + C_s f_t' kbar_s,
//
// where k_s enters x1 and later stages with the factor h, hence m_s' k_s, and t + C_s h in f.
INLINE void stages_reverse(const Record& past, const real* c, const real* sum, real* stage, Adjoints& bar) {
  for_stages_back(NEEDED_STAGES, [&](auto s) {
    real x[NX], seed[NX], part[NW + 1], tbar[2];
    const real h = past.step.h, t[1] = {past.step.t + method.C[s] * h}, *k = past.slope + s * NX;
    real length = 0.;
    for (int i = 0; i < NX; ++i) {
      real total = method.B[s] * sum[i];
#pragma GCC unroll 16
      for (int j = s + 1; j < method.STAGES; ++j)
        if (method.A[j][s] != 0) total = total + method.A[j][s] * stage[j * NX + i];
      if (MOVING) length = length + total * k[i];
      seed[i] = h * total;
    }
    if (s > 0) combine<false>(s, h, past.x, past.slope, x);
    G::dynamics_reverse(t, s > 0 ? x : past.x, c, seed, stage + s * NX, part, tbar);
    accumulate(bar.x, stage + s * NX, NX);
    accumulate(bar.c, part, NW);
    if (MOVING) bar.t = bar.t + tbar[0], bar.h = bar.h + length + method.C[s] * tbar[0];
  });
}

// Reverse of a step: bar.x at its end becomes bar.x at its beginning; unchanged in a lane that waited.
static void step_reverse(const Record& past, const real* c, Adjoints& bar) {
  real sum[NX], raw[NX], stage[method.STAGES * NX], end_bar[NX];
  combine<false>(SOLUTION, past.step.h, past.x, past.slope, raw);
  G::normalise_reverse(raw, bar.x, sum);
  for (int i = 0; i < NX; ++i) {
    end_bar[i] = bar.x[i];
    bar.x[i] = sum[i] = select(past.step.busy, sum[i], 0.);
  }
  stages_reverse(past, c, sum, stage, bar);
  for (int i = 0; i < NX; ++i) bar.x[i] = select(past.step.busy, bar.x[i], end_bar[i]);
}

// Add the adjoints of peaks that have their value at step k, or at a step next to it if peaks lie between steps.
static void peaks_reverse(const Job& job, int64_t k, real t, const Trajectory& at, const real* x, const real* rbar,
                          Adjoints& bar) {
  real seed[PEAKS + 1], xpart[NX], cpart[NW + 1], tpart[2], here = 0.;
  for (int i = 0; i < PEAKS; ++i) {
    real met = at.when[i] == real(double(k));
    seed[i] = select(met, rbar[INTEGRALS + i], 0.);
    for (int n = BEFORE; job.located && n <= AFTER; ++n) {
      const int place = n * PEAKS + i;
      const real counts = at.vicinity.step[place] == real(double(k)) && !(at.share[place] == real(0.));
      seed[i] = select(counts, at.share[place] * rbar[INTEGRALS + i], seed[i]), met = met || counts;
    }
    here = here || met;
  }
  if (!any(here)) return;
  const real instant[1] = {t};
  G::peaks_reverse(instant, x, at.c, seed, xpart, cpart, tpart);
  accumulate(bar.x, xpart, NX);
  accumulate(bar.c, cpart, NW);
  if (MOVING) bar.t = bar.t + tpart[0];
}

// Add to the adjoint of the time at which a segment of lane l begins or ends: that of a jump or of an event; a sample's
// time is constant.
static void end_reverse(int place, int l, double value, Adjoints& bar) {
  if (MOVING && place >= 0 && JUMP_BAR[place] >= 0) lane(bar.c[JUMP_BAR[place]], l) += value;
  if (place == HERE) lane(bar.begin, l) += value;
}

// From the adjoints of a step's start time and length to those of the ends t0 and t1 of its segment. Step i of N has
// h = (t1 - t0) / N and t = t0 + i h, hence t1bar += (hbar + i tbar) / N and t0bar += tbar - (hbar + i tbar) / N. If the
// step begins at a jump, the dynamics before it have the jump's earlier side.
static void ends_reverse(const Step& s, Trajectory& at, Adjoints& bar) {
  for (int l = 0; (JUMPS || EVENTS) && l < LANES; ++l) {
    const int from = int(lane(s.from, l)), to = int(lane(s.to, l));
    if (lane(s.busy, l) == 0 || (from == -1 && to == -1)) continue;
    const double t = lane(bar.t, l), share = (lane(bar.h, l) + lane(s.index, l) * t) / lane(s.number, l);
    end_reverse(from, l, t - share, bar);
    end_reverse(to, l, share, bar);
    if (from >= 0 && lane(s.index, l) == 0) lane(at.c[JUMP[from]], l) = INFINITY;
  }
  bar.t = bar.h = 0.;
}

#ifdef WITH_EVENTS
INLINE void set_switches(Trajectory& at, const real* mode) {
  for (int i = 0; i < SWITCHES; ++i) at.c[SWITCH[i]] = mode[i];
}

// Reverse of a step that was cut short, or at whose end an event fired.
//
// Let Phi(x, t, tau, c) be the state after a step of the length tau. If the step ends at the root of a guard, tau follows
// from G(x, t, tau, c) = g(t + tau, Phi(x, t, tau, c), c) = 0, and by the implicit function theorem
//
//   dtau = -(G_x dx + G_t dt + G_c dc) / G_tau,    G_tau = g_t + g_x Phi_tau.
//
// With the adjoint taubar of the length, x, t and c therefore gain mu G_x', mu G_t and mu G_c' with
// mu = -taubar / G_tau. This is the saltation of the event: at the root state and time move together. `root` has the
// adjoints of g, sent back through the step by step_reverse. taubar is that of the step's length (bar.h) and of the
// event's time t + tau (`end`): the update's own dependence on time, and the start of the next segment. The latter
// depends on t directly as well, so that bar.t gains `end`. An event that fires without a step has no root of its own.
static void event_reverse(const Record& past, Trajectory& at, Adjoints& bar) {
  const StepOutcome& outcome = past.outcome;
  const Step& s = past.step;
  const real fires = outcome.event >= 0. && (s.busy || outcome.waits), located = fires && outcome.cut;
  const real t[1] = {select(outcome.waits, s.t, fmin(s.t + s.h, s.end))}, e[1] = {outcome.event};
  real before[NX], raw[NX], xpart[NX], cpart[NW + 1], tpart[2], seed[EVENTS], update_time = 0.;
  if (any(fires)) {
    combine<false>(SOLUTION, s.h, past.x, past.slope, raw);
    G::normalise(raw, before);
    for (int i = 0; i < NX; ++i) before[i] = select(outcome.waits, past.x[i], before[i]);
    G::update_reverse(t, before, at.c, e, bar.x, xpart, cpart, tpart);
    for (int i = 0; i < NX; ++i) bar.x[i] = select(fires, xpart[i], bar.x[i]);
    for (int i = 0; i < NW; ++i) bar.c[i] = bar.c[i] + select(fires, cpart[i], 0.);
    update_time = select(fires, tpart[0], 0.);
  }
  const real end = update_time + bar.begin;
  for (int l = 0; l < LANES; ++l)
    if (lane(outcome.cut, l) != 0) lane(bar.begin, l) = 0.;
    else end_reverse(int(lane(s.from, l)), l, lane(update_time, l), bar);
  set_switches(at, outcome.mode);
  step_reverse(past, at.c, bar);
  real mu = 0.;
  if (any(located)) {
    Adjoints root;
    for (int i = 0; i < EVENTS; ++i) seed[i] = located && outcome.event == real(double(i));
    G::guards_reverse(t, before, at.c, seed, root.x, root.c, tpart);
    root.t = root.h = root.begin = 0.;
    step_reverse(past, at.c, root);
    mu = -(bar.h + end) / (tpart[0] + root.h);
    for (int i = 0; i < NX; ++i) bar.x[i] = bar.x[i] + select(located, mu * root.x[i], 0.);
    for (int i = 0; i < NW; ++i) bar.c[i] = bar.c[i] + select(located, mu * root.c[i], 0.);
    bar.t = bar.t + select(located, mu * (root.t + tpart[0]), 0.);
  }
  bar.t = bar.t + select(outcome.cut, end, 0.), bar.h = select(outcome.cut, 0., bar.h);
}
#endif

// Repeat the steps of a segment from its checkpoint, and record them on the tape.
static void repeat_segment(const Job& job, Trajectory& at, const Position& begin, Record* tape, int64_t number) {
  real m[NM + 1], next[NX], c[NC + 1];
#ifdef WITH_TABLES
  real row[CURSORS + 1];  // rows whose adjoints are in the windows
  copy(row, at.now.row, CURSORS);
#endif
  at.now = begin;
  for (int l = 0; l < LANES; ++l) set_sides(at, l);
#ifdef WITH_TABLES
  for (int l = 0; l < LANES; ++l) fill(at, l);
#endif
#ifdef WITH_EVENTS
  set_switches(at, at.now.watch.mode);
#endif
  for (int64_t k = 0; k < number; ++k) {
    ready(job, at);  // a checkpoint was taken when a step was ready
#ifdef WITH_EVENTS
    if (EVENTS) prepare_step(job, at);
#endif
    record_step(tape[k], at, m, next);
    if (k == number - 1) copy(c, at.c, NC + 1);
    settle<false>(job, at, tape[k].slope, next, &tape[k], true);
  }
  copy(at.c, c, NC + 1);  // the sides of jumps during the last step, from which the backward sweep continues
#ifdef WITH_TABLES
  copy(at.now.row, row, CURSORS);
#endif
#ifdef WITH_EVENTS
  set_switches(at, at.now.watch.mode);
#endif
}

// Recorded instants of a group of lanes; the latest one of each lane may still grow.
struct Instants {
  Instant now[LANES];
  int64_t number[LANES], next_step[LANES];  // number of instants; next step of each lane
  bool is_recorded[LANES], is_movable[LANES];     // whether the latest one is to be recorded; whether parameters move it

  void begin(int64_t steps) {
    for (int l = 0; l < LANES; ++l) {
      number[l] = 0, next_step[l] = steps, is_recorded[l] = is_movable[l] = false, now[l].first = INFINITY;
    }
  }
  void close(const Job& job, const AdjointJob& adjoint, int64_t rollout, int l) {
    if (!is_recorded[l] || rollout >= job.count) return;
    if (number[l] < adjoint.most) now[l].write(adjoint.instant + (rollout * adjoint.most + number[l]) * adjoint.width);
    adjoint.instants[rollout] = ++number[l];
  }
};

// Add the event or jump at the end of step k to the record, before the backward sweep reverses the step.
static void record_instants(const Job& job, const AdjointJob& adjoint, int64_t first, int64_t k,
                            const Record& past, const Trajectory& at, const Adjoints& bar, Instants& all) {
  const Step& s = past.step;
  real raw[NX], end[NX];
  bool has_end = false;
  for (int l = 0; l < LANES; ++l) {
    const int to = int(lane(s.to, l));
    const bool done = lane(s.busy, l) != 0, over = lane(s.index, l) + 1 >= lane(s.number, l);
    double occurrence = -1. - to, root = 1., t = lane(s.end, l), near = 0.;
    bool waits = false, occurs = done && to >= 0 && over;
#ifdef WITH_EVENTS
    const StepOutcome& outcome = past.outcome;
    waits = lane(outcome.waits, l) != 0;
    const bool fires = lane(outcome.event, l) >= 0 && (done || waits), cut = lane(outcome.cut, l) != 0;
    occurs = fires || (occurs && !cut);
    if (fires) occurrence = lane(outcome.event, l), root = cut, near = lane(outcome.close, l);
    if (fires) t = waits ? lane(s.t, l) : ::fmin(lane(s.t, l) + lane(s.h, l), t);
#endif
    const double next = double(all.next_step[l]);
    if (done) all.next_step[l] = k;
    if (!occurs) continue;
    if (!has_end) combine<false>(SOLUTION, s.h, past.x, past.slope, raw), G::normalise(raw, end), has_end = true;
    Instant& now = all.now[l];
    if (t < now.first - TOGETHER) {
      all.close(job, adjoint, first + l, l);
      all.is_recorded[l] = all.is_movable[l] = false, now.number = now.missed = 0., now.last = t;
      for (int i = 0; i < NX; ++i) now.bar[i] = lane(bar.x[i], l);
      for (int i = 0; i < PEAKS; ++i) now.met[i] = ELSEWHERE;
    }
    const int number = int(now.number++);
    for (int i = 0; i < PEAKS; ++i)
      if (lane(at.when[i], l) == next) now.met[i] = number ? BETWEEN : AFTERWARDS;
    double later = 0.;  // number of later events that are roots of their own guards
    for (int i = 0; i < number && i < MAX_OCCURRENCES; ++i) later += now.occurrence[i] >= 0 && now.root[i] != 0;
    if (number < MAX_OCCURRENCES) now.occurrence[number] = occurrence, now.root[number] = root;
    now.first = t, now.missed = now.missed != 0 || near > later;
    bool moves = occurrence < 0 && JUMP_BAR[int(-1 - occurrence)] >= 0;
#ifdef WITH_EVENTS
    moves = moves || (occurrence >= 0 && !FIXED[int(occurrence)]);
#endif
    all.is_movable[l] = all.is_movable[l] || moves;
    all.is_recorded[l] = all.is_movable[l] && (number > 0 || now.missed != 0);
    for (int i = 0; i < NX; ++i) now.before[i] = lane((waits ? past.x : end)[i], l);
#ifdef WITH_EVENTS
    for (int i = 0; i < SWITCHES; ++i) now.mode[i] = lane(outcome.mode[i], l);
#endif
    for (int i = 0; i < JUMPS; ++i) now.mode[SWITCHES + i] = lane(at.c[JUMP[i]], l);
  }
}

extern "C" int64_t gradients(const Job* given, const AdjointJob* adjoint) {
  const Job& job = *given;
  const int64_t segment = adjoint->segment;
  Room<Record> tape(segment);
  Room<Trajectory> trajectory(1);
  Checkpoints checkpoints;
  Room<Adjoints> bars(1);
  Room<Instants> instants(1);
  Room<real> parameters(NP + 1), slopes(2 * (NG + 1));
  if (!parameters.at || !slopes.at || !tape.at || !trajectory.at || !bars.at || !instants.at || OUT_OF_MEMORY)
    return NO_MEMORY;
  Trajectory& at = *trajectory.at;
  Adjoints& bar = *bars.at;
  real *const p = parameters.at, *const pbar = slopes.at, *const direct = slopes.at + NG + 1;
  for (int64_t first = 0; first < job.count; first += LANES) {
    real cost[NJ + 1], seed[NJ + 1], rbar[NR + 1];
    gather(job.p, first, job.count, NP, p);
    gather(adjoint->seed, first, job.count, NJ, seed);
    const int64_t steps = integrate(job, first, p, at, tape.at, segment, &checkpoints);
    if (steps < 0) return steps == STOPPED ? first : steps;
    G::objective(at.r, p, cost);
    G::objective_reverse(at.r, p, seed, rbar, direct);
    const real t[1] = {end_of(job, at)};
    bar.t = bar.h = bar.begin = 0.;
    for (int i = NW; i < NB; ++i) bar.c[i] = 0.;
    G::final_reverse(t, at.now.x, at.c, rbar + INTEGRALS + PEAKS, bar.x, bar.c, &bar.t);
    for (int i = 0; i < INTEGRALS; ++i) bar.x[NX - INTEGRALS + i] = rbar[i];
    peaks_reverse(job, steps, t[0], at, at.now.x, rbar, bar);
    for (int l = 0; EVENTS && l < LANES; ++l)
      if (at.status[l] == ENDED) end_reverse(int(lane(at.now.step.from, l)), l, lane(bar.t, l), bar);
    bar.t = bar.h = 0.;
    instants.at->begin(steps);
    const int64_t last = any(at.whole) ? (steps - 1) / segment : -1;  // a diverged rollout has no tape
    for (int64_t s = last; s >= 0; --s) {
      const int64_t begin = s * segment, number = s < last ? segment : steps - begin;
      // the tape has the steps of a later segment
      if (s < last) repeat_segment(job, at, checkpoints.positions.at[s], tape.at, number);
      for (int64_t k = number - 1; k >= 0; --k) {
        if (*job.stop) return first;
        const Record& past = tape.at[k];
#ifdef WITH_TABLES
        if (TABLES) restore_windows(at, past.row, bar);
#endif
        if (MOVING && adjoint->most) record_instants(job, *adjoint, first, begin + k, past, at, bar, *instants.at);
#ifdef WITH_EVENTS
        if (EVENTS && any(past.outcome.cut || past.outcome.event >= 0.)) event_reverse(past, at, bar);
        else
#endif
          step_reverse(past, at.c, bar);
        if (PEAKS) peaks_reverse(job, begin + k, past.step.t, at, past.x, rbar, bar);
        ends_reverse(past.step, at, bar);
      }
    }
#ifdef WITH_TABLES
    if (TABLES) restore_windows(at, nullptr, bar);
#endif
    for (int l = 0; l < LANES; ++l) instants.at->close(job, *adjoint, first + l, l);
    G::setup_reverse(p, bar.x, bar.c, pbar);
    for (int i = 0; i < NG; ++i) pbar[i] = select(at.whole, pbar[i] + direct[i], NAN);
    scatter(pbar, NG, first, job.count, adjoint->gradient);
    store(job, first, at, cost);
  }
  return job.count;
}
