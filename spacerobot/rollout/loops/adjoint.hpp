// Reverse of every function above; the seeds and results carry the name of what they belong to with a bar, and
// cbar has only the NW constants that the wanted parameters reach:
//
//   dynamics_reverse(t, x, c, vbar -> xbar, cbar, tbar)    peaks_reverse(t, x, c, mbar -> xbar, cbar, tbar)
//   normalise_reverse(x, nbar -> xbar)                     final_reverse(t, x, c, ebar -> xbar, cbar, tbar)
//   objective_reverse(r, p, Jbar -> rbar, pbar)            setup_reverse(p, xbar, cbar -> pbar)
//
//   guards_reverse(t, x, c, gbar -> xbar, cbar, tbar)      update_reverse(t, x, c, e, after_bar -> xbar, cbar, tbar)
//
// The last two are there where there are EVENTS. MOVING tells whether the wanted parameters may move the ends of
// segments, that is jumps or events; tbar is empty otherwise, and that of final_reverse where there are no events.
// JUMP_BAR holds the places of the jumps in cbar, -1 for one that stays. cbar of setup_reverse goes on with the rows of
// tables, which no other function sees; C_BAR holds the place in it of each constant, or -1.
#ifndef GENERIC
enum { NW = G::dynamics_reverse_cbar, NB = G::setup_reverse_cbar, NG = G::setup_reverse_pbar, MOVING = G::dynamics_reverse_tbar };
#endif

// An instant at which several things happened, or an event with others close by. Whether their order counts is judged
// elsewhere, by these: when it began and ended; truth where a close event did not fire; how many things happened, and
// the first of them from the last back: jump J as -1 - J, or an event, with truth where it had a root of its own; the
// switches and the sides of jumps before; for each peak whether it was met there, between two things or behind all; the
// state before, and the bar of the state behind.
enum { THINGS = 16 };
enum Met { ELSEWHERE, BETWEEN, BEHIND };
struct Instant {
  double first, last, missed, number, thing[THINGS], root[THINGS];
  ROW(double, mode, SWITCHES + JUMPS + 1);
  ROW(double, met, PEAKS + 1);
  ROW(double, before, NX);
  ROW(double, bar, NX);

  // All of these, one after the other.
  void write(double* to) const {
    const double single[] = {first, last, missed, number};
    const double* const part[] = {single, thing, root, mode, met, before, bar};
    const int size[] = {4, THINGS, THINGS, SWITCHES + JUMPS + 1, PEAKS + 1, NX, NX};
    for (int k = 0; k < 7; ++k)
      for (int i = 0; i < size[k]; ++i) *to++ = part[k][i];
  }
};

struct AdjointJob {
  const double* seed;  // (count, NJ), the weight of each cost
  double* gradient;    // (count, NG)
  int64_t segment;     // steps between checkpoints
  int64_t most;        // instants to be told of each rollout
  int64_t* told;       // (count), instants in all
  double* instant;     // (count, most, width), as Instant writes them
  int64_t width;
};

// What flows back; t and h are those of a step's beginning and length, `begin` that of a segment's beginning where an
// event was.
struct Bars {
  ROW(real, x, NX);
  ROW(real, c, NB + 1);
  real t, h, begin;
};

#ifdef WITH_TABLES
// Let windows show again what they showed during a step, if one is given; what flowed back to them meanwhile belongs to
// their rows.
static void turn_back(Trajectory& at, const real* row, Bars& bar) {
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

// Through the stages from the last down to the first; `sum` is the bar of the solution before it is normalised, `stage`
// has room for those of the stages' states.
INLINE void stages_reverse(const Record& past, const real* c, const real* sum, real* stage, Bars& bar) {
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

// bar.x at the end of a step becomes bar.x at its beginning; a lane that waited keeps it.
static void step_reverse(const Record& past, const real* c, Bars& bar) {
  real sum[NX], raw[NX], stage[method.STAGES * NX], kept[NX];
  combine<false>(SOLUTION, past.step.h, past.x, past.slope, raw);
  G::normalise_reverse(raw, bar.x, sum);
  for (int i = 0; i < NX; ++i) {
    kept[i] = bar.x[i];
    bar.x[i] = sum[i] = select(past.step.busy, sum[i], 0.);
  }
  stages_reverse(past, c, sum, stage, bar);
  for (int i = 0; i < NX; ++i) bar.x[i] = select(past.step.busy, bar.x[i], kept[i]);
}

// Seeds of the peaks that were met at step k, or next to it where derivatives are those between steps.
static void peaks_reverse(const Job& job, int64_t k, real t, const Trajectory& at, const real* x, const real* rbar, Bars& bar) {
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

// The bar of the time at which a segment of lane l begins or ends: at a jump, where an event was, or at a sample.
static void end_reverse(int place, int l, double value, Bars& bar) {
  if (MOVING && place >= 0 && JUMP_BAR[place] >= 0) lane(bar.c[JUMP_BAR[place]], l) += value;
  if (place == HERE) lane(bar.begin, l) += value;
}

// From a step's beginning and length to the ends of its segment; the sides of a jump that it began at go back with it.
static void ends_reverse(const Step& s, Trajectory& at, Bars& bar) {
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

// Through a step that was cut short, or with which an event fired. The length tau of one that ends at a guard's root
// follows from g(t + tau, Phi(x, t, tau)) = 0, so that every bar of the step gains mu times that of g, where mu is minus
// the bar of tau over the derivative of g by tau. What fired at once has no root of its own.
static void happened_reverse(const Record& past, Trajectory& at, Bars& bar) {
  const Happened& found = past.happened;
  const Step& s = past.step;
  const real fires = found.event >= 0. && (s.busy || found.waits), located = fires && found.cut;
  const real t[1] = {select(found.waits, s.t, fmin(s.t + s.h, s.end))}, e[1] = {found.event};
  real before[NX], raw[NX], xpart[NX], cpart[NW + 1], tpart[2], seed[EVENTS], moved = 0.;
  if (any(fires)) {
    combine<false>(SOLUTION, s.h, past.x, past.slope, raw);
    G::normalise(raw, before);
    for (int i = 0; i < NX; ++i) before[i] = select(found.waits, past.x[i], before[i]);
    G::update_reverse(t, before, at.c, e, bar.x, xpart, cpart, tpart);
    for (int i = 0; i < NX; ++i) bar.x[i] = select(fires, xpart[i], bar.x[i]);
    for (int i = 0; i < NW; ++i) bar.c[i] = bar.c[i] + select(fires, cpart[i], 0.);
    moved = select(fires, tpart[0], 0.);
  }
  const real end = moved + bar.begin;
  for (int l = 0; l < LANES; ++l)
    if (lane(found.cut, l) != 0) lane(bar.begin, l) = 0.;
    else end_reverse(int(lane(s.from, l)), l, lane(moved, l), bar);
  set_switches(at, found.mode);
  step_reverse(past, at.c, bar);
  real mu = 0.;
  if (any(located)) {
    Bars root;
    for (int i = 0; i < EVENTS; ++i) seed[i] = located && found.event == real(double(i));
    G::guards_reverse(t, before, at.c, seed, root.x, root.c, tpart);
    root.t = root.h = root.begin = 0.;
    step_reverse(past, at.c, root);
    mu = -(bar.h + end) / (tpart[0] + root.h);
    for (int i = 0; i < NX; ++i) bar.x[i] = bar.x[i] + select(located, mu * root.x[i], 0.);
    for (int i = 0; i < NW; ++i) bar.c[i] = bar.c[i] + select(located, mu * root.c[i], 0.);
    bar.t = bar.t + select(located, mu * (root.t + tpart[0]), 0.);
  }
  bar.t = bar.t + select(found.cut, end, 0.), bar.h = select(found.cut, 0., bar.h);
}
#endif

// Do the steps of a segment of the tape once more, from where it began.
static void again(const Job& job, Trajectory& at, const Position& begin, Record* tape, int64_t number) {
  real m[NM + 1], next[NX], c[NC + 1];
#ifdef WITH_TABLES
  real row[CURSORS + 1];  // whose bars the windows hold
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
    if (EVENTS) aim(job, at);
#endif
    record_step(tape[k], at, m, next);
    if (k == number - 1) copy(c, at.c, NC + 1);
    settle<false>(job, at, tape[k].slope, next, &tape[k], true);
  }
  copy(at.c, c, NC + 1);  // the sides of jumps during the last step, where the sweep back goes on
#ifdef WITH_TABLES
  copy(at.now.row, row, CURSORS);
#endif
#ifdef WITH_EVENTS
  set_switches(at, at.now.watch.mode);
#endif
}

// The instants of a group, the last one of each lane still open.
struct Instants {
  Instant now[LANES];
  int64_t told[LANES], taken[LANES];  // the step of each lane that follows
  bool counts[LANES], moves[LANES];  // whether the one that is open shall be told; whether parameters move a thing of it

  void begin(int64_t steps) {
    for (int l = 0; l < LANES; ++l) told[l] = 0, taken[l] = steps, counts[l] = moves[l] = false, now[l].first = INFINITY;
  }
  void close(const Job& job, const AdjointJob& adjoint, int64_t rollout, int l) {
    if (!counts[l] || rollout >= job.count) return;
    if (told[l] < adjoint.most) now[l].write(adjoint.instant + (rollout * adjoint.most + told[l]) * adjoint.width);
    adjoint.told[rollout] = ++told[l];
  }
};

// Note what happened with step k, before the sweep goes back through it.
static void note_instants(const Job& job, const AdjointJob& adjoint, int64_t first, int64_t k,
                          const Record& past, const Trajectory& at, const Bars& bar, Instants& all) {
  const Step& s = past.step;
  real raw[NX], end[NX];
  bool known = false;
  for (int l = 0; l < LANES; ++l) {
    const int to = int(lane(s.to, l));
    const bool done = lane(s.busy, l) != 0, over = lane(s.index, l) + 1 >= lane(s.number, l);
    double thing = -1. - to, root = 1., t = lane(s.end, l), near = 0.;
    bool waits = false, happens = done && to >= 0 && over;
#ifdef WITH_EVENTS
    const Happened& found = past.happened;
    waits = lane(found.waits, l) != 0;
    const bool fires = lane(found.event, l) >= 0 && (done || waits), cut = lane(found.cut, l) != 0;
    happens = fires || (happens && !cut);
    if (fires) thing = lane(found.event, l), root = cut, near = lane(found.near, l);
    if (fires) t = waits ? lane(s.t, l) : ::fmin(lane(s.t, l) + lane(s.h, l), t);
#endif
    const double next = double(all.taken[l]);
    if (done) all.taken[l] = k;
    if (!happens) continue;
    if (!known) combine<false>(SOLUTION, s.h, past.x, past.slope, raw), G::normalise(raw, end), known = true;
    Instant& now = all.now[l];
    if (t < now.first - TOGETHER) {
      all.close(job, adjoint, first + l, l);
      all.counts[l] = all.moves[l] = false, now.number = now.missed = 0., now.last = t;
      for (int i = 0; i < NX; ++i) now.bar[i] = lane(bar.x[i], l);
      for (int i = 0; i < PEAKS; ++i) now.met[i] = ELSEWHERE;
    }
    const int number = int(now.number++);
    for (int i = 0; i < PEAKS; ++i)
      if (lane(at.when[i], l) == next) now.met[i] = number ? BETWEEN : BEHIND;
    double behind = 0.;  // events with roots of their own
    for (int i = 0; i < number && i < THINGS; ++i) behind += now.thing[i] >= 0 && now.root[i] != 0;
    if (number < THINGS) now.thing[number] = thing, now.root[number] = root;
    now.first = t, now.missed = now.missed != 0 || near > behind;
    bool moves = thing < 0 && JUMP_BAR[int(-1 - thing)] >= 0;
#ifdef WITH_EVENTS
    moves = moves || (thing >= 0 && !FIXED[int(thing)]);
#endif
    all.moves[l] = all.moves[l] || moves;
    all.counts[l] = all.moves[l] && (number > 0 || now.missed != 0);
    for (int i = 0; i < NX; ++i) now.before[i] = lane((waits ? past.x : end)[i], l);
#ifdef WITH_EVENTS
    for (int i = 0; i < SWITCHES; ++i) now.mode[i] = lane(found.mode[i], l);
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
  Room<Bars> bars(1);
  Room<Instants> instants(1);
  Room<real> parameters(NP + 1), wanted(2 * (NG + 1));
  if (!parameters.at || !wanted.at || !tape.at || !trajectory.at || !bars.at || !instants.at || EXHAUSTED) return NO_MEMORY;
  Trajectory& at = *trajectory.at;
  Bars& bar = *bars.at;
  real *const p = parameters.at, *const pbar = wanted.at, *const direct = wanted.at + NG + 1;
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
      if (at.fate[l] == ENDED) end_reverse(int(lane(at.now.step.from, l)), l, lane(bar.t, l), bar);
    bar.t = bar.h = 0.;
    instants.at->begin(steps);
    const int64_t last = any(at.whole) ? (steps - 1) / segment : -1;  // what is lost has no tape
    for (int64_t s = last; s >= 0; --s) {
      const int64_t begin = s * segment, number = s < last ? segment : steps - begin;
      if (s < last) again(job, at, checkpoints.kept.at[s], tape.at, number);  // the tape holds a later segment
      for (int64_t k = number - 1; k >= 0; --k) {
        if (*job.stop) return first;
        const Record& past = tape.at[k];
#ifdef WITH_TABLES
        if (TABLES) turn_back(at, past.row, bar);
#endif
        if (MOVING && adjoint->most) note_instants(job, *adjoint, first, begin + k, past, at, bar, *instants.at);
#ifdef WITH_EVENTS
        if (EVENTS && any(past.happened.cut || past.happened.event >= 0.)) happened_reverse(past, at, bar);
        else
#endif
          step_reverse(past, at.c, bar);
        if (PEAKS) peaks_reverse(job, begin + k, past.step.t, at, past.x, rbar, bar);
        ends_reverse(past.step, at, bar);
      }
    }
#ifdef WITH_TABLES
    if (TABLES) turn_back(at, nullptr, bar);
#endif
    for (int l = 0; l < LANES; ++l) instants.at->close(job, *adjoint, first + l, l);
    G::setup_reverse(p, bar.x, bar.c, pbar);
    for (int i = 0; i < NG; ++i) pbar[i] = select(at.whole, pbar[i] + direct[i], NAN);
    scatter(pbar, NG, first, job.count, adjoint->gradient);
    store(job, first, at, cost);
  }
  return job.count;
}
