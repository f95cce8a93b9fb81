// Events of hybrid motion: where each fires, and what it changes. An event fires where its guard is above zero, and a
// guard that is not armed is minus infinity. SWITCH lists the places in c of the switches, which are constant between
// events; SETS holds what each event makes of them (-1: leaves it), ENDS whether the rollout is over with it,
// KINK whether it only marks where a law is not smooth. FINE lists switches, FINE_STEP the longest step while one is on.
//
// Every step is tried. Where no guard is above zero at its end, it is done; else the lane takes it once more, with other
// lengths, until the end lies behind the earliest root by less than TOLERANCE. Then the event fires, and the rest of the
// segment is cut into steps anew. Lanes that look for a root do not hold up the others: those go on meanwhile.
//
// A guard counts from its level. That is zero, but where an event fires and its guard stays above zero (a ball that
// bounces is a rounding error within the floor), what the guard is then, until it was below zero.
static_assert(M::B[0] != 0, "the first slope of a step must be there at its end");

constexpr double TOLERANCE = 1e-12;   // of an event's time, s
constexpr double TOGETHER = 1e-9;     // two events so close may change places, s
constexpr double SHORTEST = 1e-4;     // part of a step after which a guard's peak is looked for
constexpr double GRAZES = 1e-3;       // part of a step within which a guard that grazes turns back
constexpr double MARGIN = 0.05;       // part of its bend that a guard's parabola may be wrong
enum { SECANTS = 8, TRIES = 60 };     // lengths tried at peaks, or before they are halved; in all
enum { BURST = 100 };                 // more events than that within one step are chattering
enum Doubt { NONE, GRAZING, COINCIDENT };

// What came of a step: truth where it was not done, truth where it was cut short, the event that fired at its end (or,
// where it was not done, at its beginning) or -1, and the switches during the step.
struct Happened {
  real waits, cut, event, mode[SWITCHES + 1];
#ifdef RATE
  real slope;  // derivative of the event's time
#endif
};

// The guards at a state, their rates along xdot, and for sensitivities their derivatives along the lane's direction.
INLINE void guards(Trajectory& at, real t, const real* x, const real* xdot, real* g, real* rate, real* slope) {
  const real instant[1] = {t};
#ifdef RATE
  G::guards(instant, x, at.c, xdot, g, rate, slope);
#else
  G::guards(instant, x, at.c, xdot, g, rate);
#endif
}

// Begin the next length tried from nothing.
INLINE void forget(Watch& w, int l) {
  lane(w.low, l) = lane(w.tries, l) = lane(w.peak, l) = 0., lane(w.high, l) = INFINITY;
}

static void watch(Trajectory& at) {
  Watch& w = at.now.watch;
  for (int i = 0; i < SWITCHES; ++i) w.mode[i] = at.c[SWITCH[i]];
  for (int i = 0; i < EVENTS; ++i) w.level[i] = w.before[i] = w.after[i] = 0.;
  w.last = -1., w.fresh = 1., w.burst = 0., w.since = -INFINITY;
  for (int l = 0; l < LANES; ++l) forget(w, l), at.fired[l] = at.doubt[l] = at.doubted[l] = 0;
}

// Let the rest of lane l's segment begin at t. Where it begins `anew`, that is behind a step cut short.
static void cut_segment(const Job& job, Trajectory& at, int l, double t, bool anew) {
  Step& s = at.now.step;
  const double begin = ::fmin(t, lane(s.end, l)), left = lane(s.end, l) - begin;
  const double number = ::fmax(1., ::ceil(left / longest(job, at, l) * (1 - 1e-9)));
  if (anew) lane(s.from, l) = HERE;
  lane(s.t, l) = lane(s.begin, l) = begin, lane(s.index, l) = 0.;
  lane(s.number, l) = number, lane(s.h, l) = left / number;
  forget(at.now.watch, l);
}

// A kink changes neither state nor rate at its instant: derivatives are the same with and without it.
static void doubt(Trajectory& at, int l, Doubt why, int event) {
  if (at.doubt[l] == NONE && !KINK[event]) at.doubt[l] = why, at.doubted[l] = event;
}

// A guard along the step of a lane: value and rate at its beginning, values at the bracket's ends.
struct Guard {
  double first, rate, low, before, high, after;

  // Its root: of the polynomial through all these.
  double root() const {
    const double rise = low > 0 ? ((before - first) / low - rate) / low : ((after - first) / high - rate) / high;
    const double chord = low > 0 ? ((after - before) / (high - low) - (before - first) / low) / high : rise;
    const double third = low > 0 ? (chord - rise) / high : 0.;
    double a = low, b = high;
    for (int k = 0; k < 64; ++k) {
      const double s = a + (b - a) / 2;
      if (first + s * (rate + s * (rise + (s - low) * third)) > 0) b = s;
      else a = s;
    }
    return b;
  }
};

// Doubts in a gradient through event e at the end of a step of length h: that the guard turns back soon, or that
// another event is so close that they may change places.
static void judge_root(const Job& job, Trajectory& at, int l, int e, double h, const real* g0, const real* rate,
                       const real* g1) {
  const double rise = 2 * ((lane(g1[e], l) - lane(g0[e], l)) / h - lane(rate[e], l)) / h;
  const double slope = lane(rate[e], l) + rise * h, turn = GRAZES * job.h;
  if (h > GRAZES * turn && ::fabs(slope) < turn * ::fabs(rise)) doubt(at, l, GRAZING, e);
  for (int i = 0; i < EVENTS; ++i)
    if (i != e && !KINK[e] && lane(g1[i], l) + TOGETHER * ::fmax(lane(rate[i], l), 0.) > 0) doubt(at, l, COINCIDENT, i);
}

// How long a step of lane l must be to end at the first peak of a guard that may rise above its level within it.
static double shortest_peak(Trajectory& at, int l, const real* g0, const real* rate, const real* g1) {
  const double h = lane(at.now.step.h, l), margin = lane(at.now.watch.peak, l) != 0 ? GRAZES : MARGIN;
  double shortest = h;
  for (int i = 0; i < EVENTS; ++i) {
    const double first = lane(g0[i], l), r = lane(rate[i], l), bend = (lane(g1[i], l) - first) / h - r;
    const double s = -r / bend / 2;
    if (margin == GRAZES && -lane(g1[i], l) < GRAZES * GRAZES * h * -bend) doubt(at, l, GRAZING, i);
    if (s > SHORTEST && s < 1 - GRAZES && first + r * s * h / 2 > margin * h * bend)
      shortest = ::fmin(shortest, s * h);
  }
  return shortest;
}

// Lane l tried a step of length h with a guard above its level at the end, or within, or at the beginning.
static void judge_lane(const Job& job, Trajectory& at, int l, const real* g0, const real* rate, const real* g1,
                       Happened& found) {
  Watch& w = at.now.watch;
  double& h = lane(at.now.step.h, l);
  int at_once = -1, event = -1;
  for (int i = EVENTS - 1; i >= 0; --i) {
    if (lane(g0[i], l) > 0) at_once = i;
    if (lane(g1[i], l) > 0) event = i;
  }
  lane(found.waits, l) = 1.;
  if (at_once >= 0 && lane(w.fresh, l) != 0) {
    lane(found.event, l) = at_once;
    return;
  }
  if (event < 0 && lane(w.high, l) == INFINITY) {
    const double shorter = shortest_peak(at, l, g0, rate, g1);
    double& peaks = lane(w.peak, l);
    if (shorter < h && peaks < SECANTS) ++peaks, h = shorter;
    else lane(found.waits, l) = 0., lane(found.cut, l) = peaks > 0;
    return;
  }
  (event < 0 ? lane(w.low, l) : lane(w.high, l)) = h;
  const double low = lane(w.low, l), high = lane(w.high, l);
  double root = high;
  for (int i = 0; i < EVENTS; ++i) {
    lane((event < 0 ? w.before : w.after)[i], l) = lane(g1[i], l);
    const Guard guard = {lane(g0[i], l), lane(rate[i], l), low, lane(w.before[i], l), high, lane(w.after[i], l)};
    if (guard.after > 0) root = ::fmin(root, guard.root());
  }
  const double tries = ++lane(w.tries, l);
  const bool near = high - root <= TOLERANCE || high - low <= TOLERANCE || tries > TRIES;
  if (event >= 0 && near) {
    lane(found.waits, l) = 0., lane(found.cut, l) = 1., lane(found.event, l) = event;
    judge_root(job, at, l, event, h, g0, rate, g1);
  } else {
    const double middle = low + (high - low) / 2;
    h = near ? high : tries > SECANTS ? middle : ::fmin(high, ::fmax(root, low) + TOLERANCE / 2);
  }
}

// Find out in which lanes that `count` the step to `next` is done, and what happens with it.
static void judge(const Job& job, Trajectory& at, const real* k, const real* next, real count, Happened& found) {
  Watch& w = at.now.watch;
  const Step& s = at.now.step;
  real g0[EVENTS], rate[EVENTS], g1[EVENTS], ignored[EVENTS], slope[EVENTS], stirs = 0.;
  guards(at, s.t, at.now.x, k, g0, rate, slope);
  guards(at, s.t + s.h, next, k, g1, ignored, slope);
  for (int i = 0; i < EVENTS; ++i) {
    w.level[i] = select(w.last == real(double(i)), fmax(g0[i], 0.), w.level[i]);
    g0[i] = g0[i] - w.level[i], g1[i] = g1[i] - w.level[i];
    const real bend = g1[i] - g0[i] - rate[i] * s.h, shallow = MARGIN * bend;
    const real peaks = rate[i] * s.h > -2 * SHORTEST * bend && rate[i] * s.h + 2. * bend < 0. &&
                       rate[i] * rate[i] * (s.h * s.h) > 4. * bend * (g0[i] - shallow);
    stirs = stirs || g1[i] > 0. || (g0[i] > 0. && w.fresh) || peaks;
  }
  stirs = count && (stirs || w.peak || (w.high < INFINITY));
  found.waits = found.cut = 0., found.event = -1.;
  for (int i = 0; i < SWITCHES; ++i) found.mode[i] = w.mode[i];
  if (any(stirs))
    for (int l = 0; l < LANES; ++l)
      if (lane(stirs, l) != 0) judge_lane(job, at, l, g0, rate, g1, found);
  const real done = count && !found.waits;
  for (int i = 0; i < EVENTS; ++i)
    w.level[i] = select(done, fmin(w.level[i], fmax(g1[i] + w.level[i], 0.)), w.level[i]);
  w.last = select(done, -1., w.last), w.fresh = w.fresh && !done;
}

#ifdef RATE
// Let steps that were cut short stretch with their events: the tangent is affine in the derivative of a step's length,
// and the guard's is zero at its root.
static void stretch(Trajectory& at, Happened& found, real* next) {
  const Step& s = at.now.step;
  real dt, dh, end[2][NX], slope[2], k[M::TOTAL * NX], m[NM + 1];
  moved(at, dt, dh);
  found.slope = dt;
  if (!any(found.cut)) return;
  for (int d = 0; d < 2; ++d) {
    real g[EVENTS], rate[EVENTS], along[EVENTS];
    step<false>(at, at.now.x, k, m, end[d], dt, real(double(d)));
    at.c[RATE] = dt + double(d);
    guards(at, s.t + s.h, end[d], k, g, rate, along);
    at.c[RATE] = slope[d] = 0.;
    for (int i = 0; i < EVENTS; ++i) slope[d] = select(found.event == real(double(i)), along[i], slope[d]);
  }
  const real located = found.cut && found.event >= 0.;
  dh = select(located, -slope[0] / (slope[1] - slope[0]), 0.);
  for (int i = 0; i < NX; ++i) next[i] = select(found.cut, end[0][i] + dh * (end[1][i] - end[0][i]), next[i]);
  found.slope = dt + select(found.cut, dh, 0.);
}
#endif

// Note event e of lane l, which took the state from x to `next`.
static void tell_event(const Job& job, const Trajectory& at, int l, int e, double t, const real* next) {
  const int64_t rollout = at.first + l, k = at.fired[l];
  if (rollout >= job.count || k >= job.most) return;
  const int64_t place = rollout * job.most + k;
  job.event[place] = e, job.when[place] = t;
  if (!job.jump) return;
  for (int i = 0; i < NX; ++i) {
    job.jump[2 * place * NX + i] = lane(at.now.x[i], l);
    job.jump[(2 * place + 1) * NX + i] = lane(next[i], l);
  }
}

// Let the events fire that were found, behind the steps that were done; and cut the segments behind steps cut short.
static void happen(const Job& job, Trajectory& at, const Happened& found, bool again) {
  Watch& w = at.now.watch;
  const Step& s = at.now.step;
  const real fires = at.now.alive && found.event >= 0.;
  if (!any(fires || found.cut)) return;
  const real t[1] = {select(found.waits, s.t, fmin(s.t + s.h, s.end))}, e[1] = {found.event};
  real next[NX];
  if (any(fires)) {
    for (int l = 0; l < LANES; ++l)
      for (int i = 0; i < SWITCHES && lane(fires, l) != 0; ++i) {
        const double value = SETS[int(lane(e[0], l))][i];
        if (value >= 0) lane(w.mode[i], l) = lane(at.c[SWITCH[i]], l) = value;
      }
#ifdef RATE
    at.c[RATE] = found.slope;
#endif
    G::update(t, at.now.x, at.c, e, next);
#ifdef RATE
    at.c[RATE] = 0.;
#endif
    at.now.alive = at.now.alive && (is_sound(next, at.begin, job.scale) || !fires);
  }
  for (int l = 0; l < LANES; ++l) {
    if (lane(fires, l) == 0 && lane(found.cut, l) == 0) continue;
    const double instant = lane(t[0], l);
    cut_segment(job, at, l, instant, lane(found.cut, l) != 0);
#ifdef RATE
    if (lane(found.cut, l) != 0) lane(w.began, l) = lane(found.slope, l);
#endif
    if (lane(fires, l) == 0 || lane(at.now.alive, l) == 0) continue;
    const int event = int(lane(e[0], l));
    if (!again) tell_event(job, at, l, event, instant, next), ++at.fired[l];
    for (int i = 0; i < NX; ++i) lane(at.now.x[i], l) = lane(next[i], l);
    lane(w.last, l) = event, lane(w.fresh, l) = 1.;
    const bool close = instant - lane(w.since, l) <= job.h;
    lane(w.burst, l) = close ? lane(w.burst, l) + 1 : 1.;
    if (!close) lane(w.since, l) = instant;
    if (ENDS[event]) at.fate[l] = ENDED;
    else if (lane(w.burst, l) > BURST) at.fate[l] = CHATTERING;
    else continue;
    lane(at.now.alive, l) = lane(at.now.step.busy, l) = lane(at.now.step.h, l) = 0.;
  }
}
