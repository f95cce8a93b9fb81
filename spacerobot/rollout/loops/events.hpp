// Events of hybrid motion: detection, location and effect.
//
// An event fires where its guard is above zero; the guard of an event that is not armed is minus infinity. SWITCH has the
// indices in c of the switches, which are constant between events, and SETS their values after each event, -1 for no
// change. For each event ENDS is whether it ends the rollout, KINK whether it only marks a point where a law is not
// smooth, CLOCK whether its guard is time minus an instant that only events change, SILENT whether it is not recorded,
// ROUTINE whether batches do not record it, FIXED whether its time depends on no parameter of the derivatives. GAP lists
// the events whose guards are minus a gap. FINE lists switches, FINE_STEP the longest step while one is on, and FINE_GROW
// the number of such steps over which steps grow after it turns on, and shrink before it turns off.
//
// Every step is a trial. If no guard is above zero at its end, it is accepted. Otherwise the lane repeats it with other
// lengths, until its end is after the earliest root by less than TOLERANCE. Then the event fires, and the rest of the
// segment is divided into steps again. Other lanes continue while a lane searches for a root.
//
// A guard is compared with its level. The level is zero, except after an event whose guard stays above zero, such as that
// of a bouncing ball which is below the floor by a rounding error. Then it is the guard's value at the event, until the
// guard has been below zero.
//
// Within a step the guards are evaluated at one third and two thirds, at states from the dense output of the method. The
// cubic through these values and those at both ends shows whether a guard may have a maximum above its level within the
// step. If so, the step is repeated up to there, so that the first of several roots is found and no pair is missed. The
// value at a third point measures the error of the cubic. If a guard with more extrema, or with kinks, may exceed its
// level by that error, half the step is tried.
//
// If all events except clocks are kinks, such as those of sixteen joints with torque limits, most steps are far from all
// of them. The evaluations within the step cost half as much as the dynamics, and are left out if no guard has been nearer
// to its level than WRONG times its change over this step and over the one before, which is at least half as long. A
// parabola with its top in the middle of this step, a (h/2)^2 above both ends, changes over a preceding step of the
// length h by a ((3h/2)^2 - (h/2)^2), eight times as much, and over one of the length h/2 three times as much.
//
// Of two guards that rise in the same step, the second fires after a step of length zero that ends at its own root, so
// that its time depends on the parameters by its own guard. With `backwards` a job fires coincident events in the reverse
// order; sensitivities that agree do not depend on the order.
#ifndef GENERIC
static_assert(Method::B[0] != 0, "the first slope of a step must be there at its end");
#endif

constexpr double TOLERANCE = 1e-12;   // of an event's time, s; backwards it is located after all coincident events
constexpr double SHORTEST = 1e-4;     // fraction of a step from which on maxima of guards are searched for
constexpr double GRAZES = 1e-3;       // fraction of a step within which a guard that grazes its level falls again
constexpr double MARGIN = 0.05;       // error of a guard's cubic that is allowed for, relative to its bend
constexpr double UNSURE = 0.01;       // error relative to the bend from which on half the step is tried
constexpr double WRONG = 12;          // bound of a guard's excess over its cubic, relative to the error at CHECK
constexpr double DEEP = 1e-6;         // depth of contact beyond which no contact is missed, m
enum { CHECK = 2 };                   // index of the point within a step that checks the cubic
constexpr double EARLY = 5e-13;       // time before a clock's instant from which on its guard is above zero, s
enum { MAX_EVALUATIONS = 1000 };      // of gaps within a step, before it is halved
enum { SECANTS = 8, TRIES = 60 };     // lengths tried at maxima or before bisection; lengths tried in all
enum { BURST = 100 };                 // number of events within one step beyond which they are chattering
enum GradientWarning { NONE, GRAZING, COINCIDENT, AT_END };

// Outcome of a step. waits: whether it was not taken. cut: whether it was cut short. event: event that fired at its end
// (at its beginning if it was not taken), or -1. close: number of other events close to it. mode: switches during the step.
struct StepOutcome {
  real waits, cut, event, close;
  ROW(real, mode, SWITCHES + 1);
#ifdef WITH_RATE
  real slope;  // derivative of the event's time
#endif
};

// The guards at a state, and bounds of the rates of gaps.
INLINE void values(Trajectory& at, real t, const real* x, real* g, real* speed) {
  const real instant[1] = {t};
  G::values(instant, x, at.c, g, speed);
}

// The guards at a state, their rates along xdot, and for sensitivities their derivatives along the lane's direction.
INLINE void guards(Trajectory& at, real t, const real* x, const real* xdot, real* g, real* rate, real* slope) {
  const real instant[1] = {t};
#ifdef WITH_RATE
  G::guards(instant, x, at.c, xdot, g, rate, slope);
#else
  G::guards(instant, x, at.c, xdot, g, rate);
#endif
}

// Reset the search for a root, for the next step of lane l.
INLINE void reset_search(Watch& w, int l) {
  lane(w.low, l) = lane(w.tries, l) = lane(w.peak, l) = lane(w.clear, l) = 0., lane(w.high, l) = INFINITY;
}

static void reset_watch(Trajectory& at) {
  Watch& w = at.now.watch;
  for (int i = 0; i < SWITCHES; ++i) w.mode[i] = at.c[SWITCH[i]];
  for (int i = 0; i < EVENTS; ++i) w.level[i] = w.first[i] = w.prior[i] = w.crossed[i] = w.before[i] = w.after[i] = 0.;
  for (int f = 0; f < FINES; ++f) w.on[f] = 0., w.off[f] = INFINITY;
  for (int n = 0; n < GAPS; ++n) w.speed[n] = 0.;
  w.last = -1., w.fresh = 1., w.burst = w.graded = w.prior_h = 0., w.since = -INFINITY;
  for (int l = 0; l < LANES; ++l) reset_search(w, l), at.fired[l] = at.gradient_warning[l] = at.warned_event[l] = 0;
}

// Prepare a step. It ends at the next instant of a clock, just after the guard's root, which therefore needs no search. A
// guard that rose together with another event fires after a step of length zero.
static void prepare_step(const Job& job, Trajectory& at) {
  Watch& w = at.now.watch;
  Step& s = at.now.step;
  if (any(w.fresh)) {
    real g[EVENTS], speed[GAPS + 1];
    values(at, s.t, at.now.x, g, speed);
    for (int i = 0; i < EVENTS; ++i) w.first[i] = select(w.fresh, g[i], w.first[i]);
    for (int n = 0; n < GAPS; ++n) w.speed[n] = select(w.fresh, speed[n], w.speed[n]);
  }
  for (int l = 0; CLOCKS && l < LANES; ++l) {
    if (lane(s.busy, l) == 0 || lane(at.now.alive, l) == 0 || lane(w.high, l) < INFINITY) continue;
    const double t = lane(s.t, l), past = (job.backwards ? TOGETHER : EARLY) + 4 * 2.2e-16 * t;
    for (int i = 0; i < EVENTS; ++i) {
      const double g = lane(w.first[i], l) - lane(w.level[i], l);
      if (!CLOCK[i] || g < -lane(s.h, l) - TOGETHER) continue;
      if (g > 0 && lane(w.fresh, l) != 0) lane(s.h, l) = 0;
      else if (g <= 0 && past - g < lane(s.h, l) - TOLERANCE) {
        lane(s.h, l) = past - g;
        lane(w.peak, l) = ::fmax(lane(w.peak, l), 0.5);  // cut short, whatever the rounding of the guard
      }
    }
  }
}

// Divide the rest of lane l's segment, from t on, into steps; `is_cut` after a step that was cut short.
static void cut_segment(const Job& job, Trajectory& at, int l, double t, bool is_cut) {
  Step& s = at.now.step;
  const double begin = ::fmin(t, lane(s.end, l)), left = lane(s.end, l) - begin;
  const double number = ::fmax(1., ::ceil(left / longest(job, at, l) * (1 - 1e-9)));
  if (is_cut) lane(s.from, l) = HERE;
  lane(s.t, l) = lane(s.begin, l) = begin, lane(s.index, l) = 0.;
  lane(s.number, l) = number, lane(s.h, l) = left / number;
  grade(job, at, l);
  reset_search(at.now.watch, l);
}

// Record a warning about a gradient. Kinks cause none: they change neither state nor rate, and so no derivative.
static void warn_gradient(Trajectory& at, int l, GradientWarning why, int event) {
  const bool graver = at.gradient_warning[l] == NONE || (at.gradient_warning[l] == COINCIDENT && why != COINCIDENT);
  if (graver && !KINK[event]) at.gradient_warning[l] = why, at.warned_event[l] = event;
}

// A guard along the step of a lane: value and rate at its beginning, values at the bracket's ends.
struct Guard {
  double first, rate, low, before, high, after;

  // Root of the polynomial through all these values.
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

// Guards of a trial step minus their levels: at its start with their rates, within it, and at its end; bounds of the
// rates of gaps at both ends; and the fraction of the step at which a gap closes, or half if that is uncertain.
struct TrialStep {
  ROW(real, g0, EVENTS);
  ROW(real, rate, EVENTS);
  THREE_ROWS(real, inner, EVENTS);
  ROW(real, g1, EVENTS);
  THREE_ROWS(real, fast, GAPS + 1);
  ROW(real, fast1, GAPS + 1);
  real meets;
};

// Record warnings about a gradient through event e at the end of a step of length h; returns the number of close events.
// The event is grazing if the parabola g0 + rate s + rise s^2 / 2 through both ends of the step has its extremum within
// the time `turn` of its end: the derivative of the root's time grows as 1 / slope there. It is coincident if another
// guard is above its level at the end or rises above it within TOGETHER, so that both may change their order.
static int check_root(const Job& job, Trajectory& at, int l, int e, double h, const TrialStep& trial) {
  const double rate = lane(trial.rate[e], l), rise = 2 * ((lane(trial.g1[e], l) - lane(trial.g0[e], l)) / h - rate) / h;
  const double slope = rate + rise * h, turn = GRAZES * job.h;
  if (h > GRAZES * turn && ::fabs(slope) < turn * ::fabs(rise)) warn_gradient(at, l, GRAZING, e);
  int near = 0;
  for (int i = 0; i < EVENTS; ++i) {
    const double soon = TOGETHER * ::fmax(lane(trial.rate[i], l), 0.);
    if (i == e || KINK[e] || KINK[i] || (FIXED[e] && FIXED[i]) || !(lane(trial.g1[i], l) + soon > 0)) continue;
    warn_gradient(at, l, COINCIDENT, i), ++near;
  }
  return near;
}

// Record a warning about a gradient if an event that parameters move (MOVES) is at the rollout's end or just after it,
// where a small change adds or removes it.
static void check_end(const Job& job, Trajectory& at, int l, const TrialStep& trial) {
  for (int i = 0; i < EVENTS; ++i)
    if (MOVES[i] && lane(trial.g1[i], l) + TOGETHER * ::fmax(lane(trial.rate[i], l), 0.) > 0)
      warn_gradient(at, l, AT_END, i);
}

// Cubic of a guard along a step, 0 to 1, in Bernstein form: it lies between the smallest and the largest of its four
// coefficients b. From p(1/3) = (8 b0 + 12 b1 + 6 b2 + b3) / 27 and p(2/3) = (b0 + 6 b1 + 12 b2 + 8 b3) / 27 follow b1 and
// b2. `bend` is the largest second difference of b.
template <class T> struct Cubic {
  T b[4];
  INLINE Cubic of(T g0, T third, T two_thirds, T g1) {
    return {{g0, 3. * third - 1.5 * two_thirds + (g1 * 2. - g0 * 5.) / 6.,
             3. * two_thirds - 1.5 * third + (g0 * 2. - g1 * 5.) / 6., g1}};
  }
  T bend() const { return fmax(fabs(b[1] * 2. - b[0] - b[2]), fabs(b[2] * 2. - b[1] - b[3])); }
  T at(T s) const {
    const T r = 1. - s;
    return r * r * (r * b[0] + 3. * s * b[1]) + s * s * (3. * r * b[2] + s * b[3]);
  }
};

// Whether a guard may be above its level within a step because the cubic is wrong.
template <class T> INLINE T unsure(const Cubic<T>& g, T check) {
  const T wrong = fabs(check - g.at(T(method.INSIDE[CHECK])));
  const T seen = fmax(fmax(fmax(g.b[0], g.b[1]), fmax(g.b[2], g.b[3])), check);
  return wrong > UNSURE * g.bend() + TOGETHER * (fabs(g.b[0]) + fabs(g.b[3])) && seen + WRONG * wrong > 0.;
}

// Fraction of the step at which a cubic has its maximum; NAN without a maximum.
static double peak_of(const Cubic<double>& g) {
  const double first = g.b[1] - g.b[0], second = g.b[2] - g.b[1], third = g.b[3] - g.b[2];
  const double a = first - 2 * second + third, b = first - second, root = ::sqrt(b * b - a * first);
  return b > 0 ? first / (b + root) : (b - root) / a;
}

// Length of lane l's step that ends at the first peak of a guard which may rise above its level within the step, or where
// shapes meet within it; and whether they meet. At the end of a step that `rises` a guard is above its level.
static double shortest_peak(Trajectory& at, int l, const TrialStep& trial, bool rises, bool& shapes_meet) {
  const double h = lane(at.now.step.h, l), margin = lane(at.now.watch.peak, l) >= 1 ? GRAZES : MARGIN;
  double shortest = h;
  for (int i = 0; i < EVENTS; ++i) {
    if (CLOCK[i]) continue;
    const Cubic<double> g = Cubic<double>::of(lane(trial.g0[i], l), lane(trial.inner[0][i], l),
                                              lane(trial.inner[1][i], l), lane(trial.g1[i], l));
    const double s = peak_of(g), bend = 3 * g.bend();
    const bool ends = ::fabs(s - 1) < 10 * GRAZES && g.b[3] <= 0;
    if (margin == GRAZES && ends && -g.b[3] < GRAZES * GRAZES * bend) warn_gradient(at, l, GRAZING, i);
    if (s > SHORTEST && s < 1 - GRAZES && s * h > TOLERANCE && g.at(s) > -margin * bend)
      shortest = ::fmin(shortest, s * h);
    if (h > TOLERANCE && unsure(g, lane(trial.inner[CHECK][i], l))) shortest = ::fmin(shortest, h / 2);
  }
  const double meets = lane(trial.meets, l);
  shapes_meet = h > TOLERANCE && meets < (rises ? 1 - GRAZES : 1);
  return shapes_meet ? ::fmin(shortest, meets * h) : shortest;
}

// First of the events whose guards are above zero, or -1; backwards the one that rose last.
static int first_above(const Job& job, int l, const real* g, const real* rate) {
  int event = -1;
  double least = INFINITY;
  for (int i = 0; i < EVENTS; ++i) {
    if (!(lane(g[i], l) > 0) || (event >= 0 && !job.backwards)) continue;
    const double since = lane(rate[i], l) > 0 ? lane(g[i], l) / lane(rate[i], l) : INFINITY;
    if (since <= least + TOLERANCE) least = ::fmin(least, since), event = i;
  }
  return event;
}

// Event that fires at the start of lane l's step, or -1: events armed by another one precede those that rose by themselves.
static int event_at_once(const Job& job, const Watch& w, int l, const TrialStep& trial) {
  real armed[EVENTS];
  for (int i = 0; i < EVENTS; ++i) armed[i] = select(w.crossed[i], -1., trial.g0[i]);
  const int first = first_above(job, l, armed, trial.rate);
  return first >= 0 ? first : first_above(job, l, trial.g0, trial.rate);
}

// Decide on a trial step of lane l with a guard above its level at the start, within or at the end: event or next length.
static void assess_lane(const Job& job, Trajectory& at, int l, const TrialStep& trial, StepOutcome& outcome) {
  Watch& w = at.now.watch;
  double& h = lane(at.now.step.h, l);
  const int event = first_above(job, l, trial.g1, trial.rate);
  const double tolerance = job.backwards ? 2 * TOGETHER : TOLERANCE;
  lane(outcome.waits, l) = 1.;
  if (lane(w.fresh, l) != 0) {
    const int at_once = event_at_once(job, w, l, trial);
    if (at_once >= 0) {
      const bool rose_itself = lane(w.crossed[at_once], l) != 0;
      if (rose_itself && h > 0) h = 0;
      else lane(outcome.event, l) = at_once, lane(outcome.waits, l) = !rose_itself, lane(outcome.cut, l) = rose_itself;
      return;
    }
  }
  if (lane(w.high, l) == INFINITY) {
    bool shapes_meet = false;
    const double shorter = shortest_peak(at, l, trial, event >= 0, shapes_meet);
    double& peaks = lane(w.peak, l);
    if (shorter < h && peaks < (shapes_meet ? TRIES : SECANTS)) {
      ++peaks, h = shorter;
      return;
    }
    if (event < 0) {
      lane(outcome.waits, l) = 0., lane(outcome.cut, l) = peaks > 0;
      return;
    }
  }
  (event < 0 ? lane(w.low, l) : lane(w.high, l)) = h;
  const double low = lane(w.low, l), high = lane(w.high, l);
  double root = high;
  for (int i = 0; i < EVENTS; ++i) {
    lane((event < 0 ? w.before : w.after)[i], l) = lane(trial.g1[i], l);
    const Guard guard = {lane(trial.g0[i], l),  lane(trial.rate[i], l), low,
                         lane(w.before[i], l), high,                   lane(w.after[i], l)};
    if (guard.after > 0) root = ::fmin(root, CLOCK[i] ? -guard.first : guard.root());
  }
  const double tries = ++lane(w.tries, l);
  const bool near = high - root <= tolerance || high - low <= tolerance || tries > TRIES;
  if (event >= 0 && near) {
    lane(outcome.waits, l) = 0., lane(outcome.cut, l) = 1., lane(outcome.event, l) = event;
    lane(outcome.close, l) = check_root(job, at, l, event, h, trial);
  } else {
    const double middle = low + (high - low) / 2;
    h = near ? high : tries > SECANTS ? middle : ::fmin(high, ::fmax(root, low) + tolerance / 2);
  }
}

// Guards at a fraction of a step, which may differ between lanes, at the state of the dense output; `weight` returns the
// weights of the slopes.
template <bool SHARED, class Weight>
INLINE void look_inside(Trajectory& at, const real* k, real part, Weight weight, real* g, real* speed) {
  const Step& s = at.now.step;
  real x[NX];
  copy(x, at.now.x, NX);
  for (int n = 0; n < SEEING; ++n) {
    real sum = 0.;
#pragma GCC unroll 16
    for (int j = 0; j < method.STAGES; ++j)
      if (method.B[j] != 0) sum = sum + weight(j) * k[place_of<SHARED>(j) + SEEN[n]];
    x[SEEN[n]] = x[SEEN[n]] + s.h * sum;
  }
  values(at, s.t + part * s.h, x, g, speed);
}

// Guards at one of the fixed points within a step.
template <bool SHARED, int PART> INLINE void look_inside(Trajectory& at, const real* k, TrialStep& trial) {
  look_inside<SHARED>(at, k, method.INSIDE[PART], [](int j) { return method.INNER[PART][j]; }, trial.inner[PART],
                      trial.fast[PART]);
}

// Conservative advancement: bodies do not pass each other between two evaluations of their gap. `speed` bounds the
// magnitude of the gap's rate for any position of the nearest points. From gaps a and b a time T apart, the gap at the time
// s is at least max(a - speed s, b - speed (T - s)), which is smallest where both are equal: (a + b - speed T) / 2. The
// bound is the largest of the five points along the step plus their range, since it may be larger between them.
struct Gap {
  real a[5], reach;  // gap at the five points of a step; maximum change over a step
};

INLINE double fraction_of(int place) {
  const double all[] = {0., method.INSIDE[0], method.INSIDE[CHECK], method.INSIDE[1], 1.};
  return all[place];
}

INLINE Gap gap_of(const Watch& w, const Step& s, const TrialStep& trial, int n) {
  const int i = GAP[n];
  const real fast[] = {w.speed[n], trial.fast[0][n], trial.fast[CHECK][n], trial.fast[1][n], trial.fast1[n]};
  real most = fast[0], least = fast[0];
  for (int p = 1; p < 5; ++p) most = fmax(most, fast[p]), least = fmin(least, fast[p]);
  return {{-trial.g0[i], -trial.inner[0][i], -trial.inner[CHECK][i], -trial.inner[1][i], -trial.g1[i]},
          s.h * (most + (most - least))};
}

// Whether a gap may close between two points of a step.
INLINE real may_close(const Gap& gap) {
  real closes = 0.;
  for (int p = 0; p < 4; ++p)
    closes = closes || gap.a[p] + gap.a[p + 1] + 2 * DEEP < gap.reach * (fraction_of(p + 1) - fraction_of(p));
  return closes;
}

// Fraction of lane l's step before which no gap closes, from the fraction `to` with the gaps `now`: the last of the five
// points that the bounds reach, plus the time in which the gaps there may close.
static double advance_fraction(const Gap* gaps, int l, double to, real* now) {
  for (int p = 1; p < 5; ++p) {
    if (to >= fraction_of(p)) continue;
    for (int n = 0; n < GAPS; ++n)
      if (lane(now[n], l) + lane(gaps[n].a[p], l) + 2 * DEEP < lane(gaps[n].reach, l) * (fraction_of(p) - to)) p = 5;
    if (p == 5) break;
    to = fraction_of(p);
    for (int n = 0; n < GAPS; ++n) lane(now[n], l) = lane(gaps[n].a[p], l);
  }
  double ahead = 1 - to;
  for (int n = 0; n < GAPS; ++n)
    if (lane(gaps[n].reach, l) > 0) ahead = ::fmin(ahead, (lane(now[n], l) + DEEP) / lane(gaps[n].reach, l));
  return to + ahead;
}

// Advance along the steps of the lanes whose shapes `may_meet`, by states from the dense output, each time as far as no gap
// can close, and record the fraction at which a gap is closed. The error of these states is assumed to be at most that at
// the step's end, where the true gap is available. If a gap is below that error, or after MAX_EVALUATIONS, half the step is
// tried.
template <bool SHARED>
static void advance_gaps(Trajectory& at, const real* k, const Gap* gaps, real may_meet, TrialStep& trial) {
  Watch& w = at.now.watch;
  const Step& s = at.now.step;
  real g[EVENTS], speed[GAPS + 1], now[GAPS + 1], wrong[GAPS + 1], part = 1.;
  const auto weight = [&part](int j) {
    return part * (method.DENSE[j][0] + part * (method.DENSE[j][1] + part * (method.DENSE[j][2] + part * method.DENSE[j][3])));
  };
  look_inside<SHARED>(at, k, part, weight, g, speed);
  for (int n = 0; n < GAPS; ++n) {
    const real off = fabs(g[GAP[n]] - w.level[GAP[n]] + gaps[n].a[4]);
    wrong[n] = select(off < INFINITY, off, 0.), now[n] = gaps[n].a[0];
  }
  part = 0.;
  for (int evaluations = 0; any(may_meet); ++evaluations) {
    for (int l = 0; l < LANES; ++l) {
      if (lane(may_meet, l) == 0) continue;
      lane(part, l) = advance_fraction(gaps, l, lane(part, l), now);
      if (!(lane(part, l) < 1)) lane(may_meet, l) = 0;
      else if (evaluations >= MAX_EVALUATIONS) lane(may_meet, l) = 0, lane(trial.meets, l) = 0.5;
    }
    if (!any(may_meet)) return;
    look_inside<SHARED>(at, k, part, weight, g, speed);
    for (int n = 0; n < GAPS; ++n) {
      now[n] = w.level[GAP[n]] - g[GAP[n]];
      for (int l = 0; l < LANES; ++l) {
        if (lane(may_meet, l) == 0 || lane(now[n], l) > lane(wrong[n], l)) continue;
        const bool meets = lane(now[n], l) <= 0;
        lane(may_meet, l) = 0, lane(trial.meets, l) = meets ? lane(part, l) : 0.5;
        if (meets) lane(w.clear, l) = lane(part, l) * lane(s.h, l);
      }
    }
  }
}

// Decide in which of the lanes that `count` the step to `next` is accepted, and with which event.
template <bool SHARED>
INLINE void assess_step(const Job& job, Trajectory& at, const real* k, const real* next, real count, StepOutcome& outcome) {
  Watch& w = at.now.watch;
  const Step& s = at.now.step;
  TrialStep trial;
  real end[EVENTS], off[FINES + 1], may_fire = 0.;
  for (int f = 0; f < FINES; ++f) off[f] = INFINITY;
  values(at, s.t + s.h, next, end, trial.fast1);
  const bool may_skip = int(KINKS) + int(CLOCKS) == int(EVENTS) && FINES == 0;
  real inside = !may_skip || w.fresh || w.peak || w.high < INFINITY || w.prior_h < 0.5 * s.h;
  for (int i = 0; i < EVENTS; ++i) {
    w.level[i] = select(w.last == real(double(i)), fmax(w.first[i], 0.), w.level[i]);
    const real level = w.level[i], g0 = w.first[i] - level, g1 = end[i] - level;
    trial.g0[i] = g0, trial.g1[i] = g1;
    may_fire = may_fire || g1 > 0. || (g0 > 0. && w.fresh);
    if (!may_skip || CLOCK[i]) continue;
    const real before = w.prior[i] - level, most = fmax(before, fmax(g0, g1));
    inside = inside || most + WRONG * (most - fmin(before, fmin(g0, g1))) > 0.;
  }
  if (may_skip) inside = count && (inside || may_fire);
  if (int(CLOCKS) < int(EVENTS) && any(inside)) {
    look_inside<SHARED, 0>(at, k, trial);
    look_inside<SHARED, 1>(at, k, trial);
    look_inside<SHARED, CHECK>(at, k, trial);
  }
  for (int i = 0; i < EVENTS && any(inside); ++i) {
    if (CLOCK[i]) continue;
    const real g1 = trial.g1[i];
    for (int n = 0; n < 3; ++n) trial.inner[n][i] = trial.inner[n][i] - w.level[i];
    const Cubic<real> g = Cubic<real>::of(trial.g0[i], trial.inner[0][i], trial.inner[1][i], g1);
    const real near = -3. * MARGIN * g.bend();
    may_fire = may_fire || (inside && (g.b[1] > near || g.b[2] > near || unsure(g, trial.inner[CHECK][i])));
    const real left = g1 / (3. * (g.b[2] - g1)) * s.h;
    for (int f = 0; f < FINES; ++f)
      if (SETS[i * (SWITCHES + 1) + FINE[f]] == 0) off[f] = select(left > 0., fmin(off[f], s.t + s.h + left), off[f]);
  }
  trial.meets = 1.;
  if (GAPS > 0) {
    Gap gaps[GAPS + 1];
    real may_meet = 0.;
    for (int n = 0; n < GAPS; ++n) gaps[n] = gap_of(w, s, trial, n), may_meet = may_meet || may_close(gaps[n]);
    may_meet = may_meet && count && s.h > w.clear && w.high == real(INFINITY);
    if (any(may_meet)) advance_gaps<SHARED>(at, k, gaps, may_meet, trial);
    may_fire = may_fire || trial.meets < 1.;
  }
  const real last = count && s.t + s.h >= job.time(job.intervals) - TOGETHER;
  may_fire = count && (may_fire || w.peak || (w.high < INFINITY));
  outcome.waits = outcome.cut = outcome.close = 0., outcome.event = -1.;
  for (int i = 0; i < SWITCHES; ++i) outcome.mode[i] = w.mode[i];
  if (any(may_fire || last)) {
    real ignored[EVENTS], slope[EVENTS];
    guards(at, s.t, at.now.x, k, ignored, trial.rate, slope);
    for (int l = 0; l < LANES; ++l)
      if (lane(may_fire, l) != 0) assess_lane(job, at, l, trial, outcome);
  }
  const real done = count && !outcome.waits;
  for (int l = 0; l < LANES; ++l)
    if (lane(last, l) != 0 && lane(done, l) != 0) check_end(job, at, l, trial);
  for (int i = 0; i < EVENTS; ++i) {
    const real rose = select(s.h > 0., trial.g1[i] > 0., w.crossed[i]) && !(outcome.event == real(double(i)));
    w.crossed[i] = select(done, rose, w.crossed[i]);
    w.level[i] = select(done, fmin(w.level[i], fmax(end[i], 0.)), w.level[i]);
    w.prior[i] = select(done, w.first[i], w.prior[i]);
    w.first[i] = select(done, end[i], w.first[i]);
  }
  w.prior_h = select(done, s.h, w.prior_h);
  for (int n = 0; n < GAPS; ++n) w.speed[n] = select(done, trial.fast1[n], w.speed[n]);
  for (int f = 0; f < FINES; ++f) w.off[f] = select(done, off[f], w.off[f]);
  w.last = select(done, -1., w.last), w.fresh = w.fresh && !done;
  outcome.cut = outcome.cut || (done && w.graded);
}

#ifdef WITH_RATE
// Derivatives of the lengths of steps that end at events. The derivative of the state at the end of a step is affine in dh,
// the derivative of its length, and so is the guard's total derivative: slope(dh) = slope(0) + dh (slope(1) - slope(0)). The
// guard stays zero at its root, hence dh = -slope(0) / (slope(1) - slope(0)).
static void differentiate_step(Trajectory& at, StepOutcome& outcome, real* next) {
  const Step& s = at.now.step;
  real dt, dh, end[2][NX], slope[2], k[method.TOTAL * NX], m[NM + 1];
  step_time_sensitivity(at, dt, dh);
  outcome.slope = dt;
  if (!any(outcome.cut && (!at.now.watch.graded || outcome.event >= 0.))) return;
  for (int d = 0; d < 2; ++d) {
    real g[EVENTS], rate[EVENTS], along[EVENTS];
    step<false>(NEEDED_STAGES, at, at.now.x, k, m, end[d], dt, real(double(d)));
    at.c[RATE] = dt + double(d);
    guards(at, s.t + s.h, end[d], k, g, rate, along);
    at.c[RATE] = slope[d] = 0.;
    for (int i = 0; i < EVENTS; ++i) slope[d] = select(outcome.event == real(double(i)), along[i], slope[d]);
  }
  const real located = outcome.cut && outcome.event >= 0.;
  dh = select(located, -slope[0] / (slope[1] - slope[0]), 0.);
  for (int i = 0; i < NX; ++i) next[i] = select(outcome.cut, end[0][i] + dh * (end[1][i] - end[0][i]), next[i]);
  outcome.slope = dt + select(outcome.cut, dh, 0.);
}
#endif

// Record event e of lane l, which changes the state from x to `next`.
static void record_event(const Job& job, const Trajectory& at, int l, int e, double t, const real* next) {
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

// End the sample interval of lanes whose last event was at its end, without a step of length zero, if no other guard is
// above its level. The next interval then begins at the event.
static void end_interval(Trajectory& at, real cut) {
  Step& s = at.now.step;
  const real over = cut && s.busy && s.begin >= s.end && s.to == real(-1.);
  if (!any(over)) return;
  real g[EVENTS], speed[GAPS + 1], left = 0.;
  values(at, s.t, at.now.x, g, speed);
  for (int i = 0; i < EVENTS; ++i) left = left || g[i] > at.now.watch.level[i];
  for (int l = 0; l < LANES; ++l)
    if (lane(over, l) != 0 && lane(left, l) == 0) lane(s.to, l) = HERE, lane(s.busy, l) = lane(s.h, l) = 0.;
}

// Apply the events at the ends of accepted steps, and divide the segments after steps that were cut short.
static void apply_events(const Job& job, Trajectory& at, const StepOutcome& outcome, bool is_repeated) {
  Watch& w = at.now.watch;
  const Step& s = at.now.step;
  const real fires = at.now.alive && outcome.event >= 0.;
  if (!any(fires || outcome.cut)) return;
  const real t[1] = {select(outcome.waits, s.t, fmin(s.t + s.h, s.end))}, e[1] = {outcome.event};
  real next[NX];
  if (any(fires)) {
    for (int l = 0; l < LANES; ++l) {
      if (lane(fires, l) == 0) continue;
      const auto* sets = SETS + int(lane(e[0], l)) * (SWITCHES + 1);
      for (int i = 0; i < SWITCHES; ++i)
        if (sets[i] >= 0) lane(w.mode[i], l) = lane(at.c[SWITCH[i]], l) = sets[i];
      for (int f = 0; f < FINES; ++f)
        if (sets[FINE[f]] > 0) lane(w.on[f], l) = lane(t[0], l), lane(w.off[f], l) = INFINITY;
    }
#ifdef WITH_RATE
    if (RATE >= 0) at.c[RATE] = outcome.slope;
#endif
    G::update(t, at.now.x, at.c, e, next);
#ifdef WITH_RATE
    if (RATE >= 0) at.c[RATE] = 0.;
#endif
    at.now.alive = at.now.alive && (is_sound(next, at.begin, job.scale) || !fires);
  }
  for (int l = 0; l < LANES; ++l) {
    if (lane(fires, l) == 0 && lane(outcome.cut, l) == 0) continue;
    const double instant = lane(t[0], l);
    cut_segment(job, at, l, instant, lane(outcome.cut, l) != 0);
#ifdef WITH_RATE
    if (RATE >= 0 && lane(outcome.cut, l) != 0) lane(w.begin_slope, l) = lane(outcome.slope, l);
#endif
    if (lane(fires, l) == 0 || lane(at.now.alive, l) == 0) continue;
    const int event = int(lane(e[0], l));
    if (!is_repeated && !SILENT[event] && (job.jump || !ROUTINE[event]))
      record_event(job, at, l, event, instant, next), ++at.fired[l];
    for (int i = 0; i < NX; ++i) lane(at.now.x[i], l) = lane(next[i], l);
    lane(w.last, l) = event, lane(w.fresh, l) = 1.;
#ifdef WITH_TABLES
    lane(at.now.stale, l) = 1.;
#endif
    const bool close = instant - lane(w.since, l) <= job.h;
    if (CLOCK[event]) continue;
    lane(w.burst, l) = close ? lane(w.burst, l) + 1 : 1.;
    if (!close) lane(w.since, l) = instant;
    if (ENDS[event]) at.status[l] = ENDED;
    else if (lane(w.burst, l) > BURST) at.status[l] = CHATTERING;
    else continue;
    lane(at.now.alive, l) = lane(at.now.step.busy, l) = lane(at.now.step.h, l) = 0.;
  }
  if (CLOCKS) end_interval(at, outcome.cut);
}
