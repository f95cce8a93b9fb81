// A plant that is advanced from one communication point to the next, with its events. Follows `forward.hpp` and the
// tables that `sources.py` writes; `fmi2.hpp` or `fmi3.hpp` follows in turn.
//
// The rollout `main` keeps to the grid of the scenario's steps, whatever the communication points are: it takes every
// step that ends at a communication point or earlier. If the point is within a step, a copy of it, `ahead`, continues to
// the point for the outputs there. The trajectory therefore does not depend on the communication step.
// If an input or a parameter changes at a communication point, `ahead` becomes `main`: the step ends there, as at a jump,
// and the rest of the sample interval is divided into equal steps again.
//
// All variables are members of `Plant`, whose only pointers are to the constant noise: its bytes are its state.
#include <cstdio>
#include <cstdlib>

enum Mode { INSTANTIATED, INITIALIZING, STEPPING, OVER, FAILED, TERMINATED };
static const char* const MODES[] = {"instantiation", "initialization", "stepping", "the end", "an error", "termination"};
enum { RECORDED = 128 };  // largest number of events with one step, which BURST bounds

// A rollout, and the number of times that each event fired.
struct Branch {
  Trajectory at;
  int32_t count[EVENTS + 1];
};

struct Plant {
  Mode mode;
  double start;             // the importer's time at which the rollout begins, s
  double time;              // time of the rollout at the communication point, s
  bool prepared;            // whether `main` began with the present parameters
  bool is_ahead;            // whether `ahead` is at the communication point, not `main`
  bool new_inputs, new_parameters, observed;
  double p[NP + 1];         // parameters, the inputs among them
  double y[NY + 1];         // outputs, valid if `observed`
  Branch main, ahead;
  Branch& present() { return is_ahead ? ahead : main; }
};

// A plant, and the importer's logger.
struct Instance {
  Plant plant;
  void* environment;
  void* logger;
  char* name;
};
static void report(Instance& instance, const char* message);

static const volatile int32_t NEVER = 0;

// Rounding error of the time of a communication point [s]: an importer adds steps, the grid multiplies them.
static double rounding(double time) { return 1e-12 + 4e-15 * ::fabs(time); }

static Job grid_of(const Plant& plant) {
  Job job = {};
  job.count = 1, job.intervals = int64_t(1) << 40, job.every = STEPS_IN_INTERVAL, job.h = STEP, job.finer = 1;
  job.p = plant.p, job.noise = NOISE, job.noises = NOISES, job.scale = SCALE, job.stop = &NEVER, job.cut = -1;
  return job;
}

// Take or try a step, and count the events that fire.
static void take_step(const Job& job, Branch& branch) {
  real slopes[int(method.PLACES) * NX], m[NM + 1], next[NX];
  Trajectory& at = branch.at;
#ifdef WITH_EVENTS
  int64_t event[RECORDED];
  double when[RECORDED];
  Job recording = job;
  recording.most = RECORDED, recording.event = event, recording.when = when;
  at.fired[0] = 0;
  step<true>(NEEDED_STAGES, at, at.now.x, slopes, m, next);
  settle<true>(recording, at, slopes, next, nullptr, false);
  for (int64_t k = 0; k < at.fired[0] && k < RECORDED; ++k) ++branch.count[event[k]];
#else
  step<true>(NEEDED_STAGES, at, at.now.x, slopes, m, next);
  settle<true>(job, at, slopes, next, nullptr, false);
#endif
}

// Advance `main` by the steps of the grid that end at a time or earlier.
static void follow_grid(Plant& plant, double until) {
  const Job job = grid_of(plant);
  Position& now = plant.main.at.now;
  while (now.alive != 0) {
    if (now.step.busy == 0) {
      if (job.time(now.interval) >= until - rounding(until)) return;
      ready(job, plant.main.at);
    }
#ifdef WITH_EVENTS
    prepare_step(job, plant.main.at);
#endif
    if (now.step.t + now.step.h > until + rounding(until)) return;
    take_step(job, plant.main);
  }
}

// Advance `ahead` from `main` to a communication point within a step of the grid.
static void look_ahead(Plant& plant, double until) {
  plant.ahead = plant.main, plant.is_ahead = true;
  Trajectory& at = plant.ahead.at;
  Step& s = at.now.step;
  Job job = grid_of(plant);
  job.cut = at.now.interval, job.point = until;
  if (s.end > until) s.end = until, s.to = -1.;
#ifdef WITH_EVENTS
  cut_segment(job, at, 0, s.t, false);
#else
  s.begin = s.t = ::fmin(s.t, s.end), s.h = s.end - s.t, s.index = 0., s.number = 1.;
#endif
  while (at.now.alive != 0 && s.busy != 0) {
#ifdef WITH_EVENTS
    prepare_step(job, at);
#endif
    take_step(job, plant.ahead);
  }
}

// Apply changed inputs and tunable parameters from the communication point on.
static void apply_changes(Plant& plant) {
  if (!plant.new_inputs && !plant.new_parameters) return;
  Trajectory& at = plant.main.at;
  if (plant.is_ahead) {
    const Job job = grid_of(plant);
    plant.main = plant.ahead, plant.is_ahead = false;
    if (at.now.alive != 0 && job.time(at.now.interval) > plant.time + rounding(plant.time)) next_segment(job, at, 0);
  }
  if (plant.new_parameters) {
    // constants from the new parameters, except switches, sides of jumps and windows, which depend on events and time
    real ignored[NX], c[NC + 1];
    G::setup(plant.p, ignored, c);
    for (int i = 0; i < SWITCHES; ++i) c[SWITCH[i]] = at.c[SWITCH[i]];
    for (int i = 0; i < JUMPS; ++i) c[JUMP[i]] = at.c[JUMP[i]];
    for (int i = 0; i < TABLES; ++i) copy(c + TABLE_WINDOW[i], at.c + TABLE_WINDOW[i], TABLE_WIDTH[i]);
    copy(at.c, c, NC);
  }
  for (int i = 0; i < INPUTS; ++i) at.c[INPUT_CONSTANT[i]] = plant.p[INPUT_PARAMETER[i]];
#ifdef WITH_TABLES
  at.now.stale = 1.;
  look_up(at);
#endif
#ifdef WITH_EVENTS
  at.now.watch.fresh = 1.;
#endif
  plant.new_inputs = plant.new_parameters = plant.observed = false;
}

static void reset(Plant& plant) {
  std::memset(static_cast<void*>(&plant), 0, sizeof plant);
  std::memcpy(plant.p, NOMINAL, sizeof plant.p);
}

// Begin the rollout with the present parameters; false if a grasp does not close.
static bool prepare(Instance& instance) {
  Plant& plant = instance.plant;
  if (plant.prepared) return true;
  real gap[G::gaps_gap + 1];
  G::gaps(plant.p, gap);
  for (int i = 0; i < G::gaps_gap; ++i) {
    if (!(gap[i] > LARGEST_GAP[i])) continue;
    char text[512];
    std::snprintf(text, sizeof text, "%s does not close: its gap is %.4g m, allowed max_gap %g m", GRASP[i], gap[i], LARGEST_GAP[i]);
    report(instance, text);
    return false;
  }
  initialise(grid_of(plant), 0, plant.p, plant.main.at);
  std::memset(plant.main.count, 0, sizeof plant.main.count);
  plant.time = 0, plant.prepared = true, plant.is_ahead = plant.new_inputs = plant.new_parameters = plant.observed = false;
  return true;
}

static void observe(Plant& plant) {
  apply_changes(plant);
  if (plant.observed) return;
  const Trajectory& at = plant.present().at;
  const real t[1] = {plant.time};
  G::outputs(t, at.now.x, at.c, plant.y);
  plant.observed = true;
}

enum Outcome { DONE, FINISHED, LOST };

// Advance to the next communication point.
static Outcome do_step(Instance& instance, double current, double length) {
  Plant& plant = instance.plant;
  char text[256];
  if (plant.mode != STEPPING) {
    std::snprintf(text, sizeof text, "doStep in the mode of %s, allowed: after the initialization", MODES[plant.mode]);
    report(instance, text);
    return LOST;
  }
  const double here = plant.start + plant.time;
  if (!(length >= 0 && length < INFINITY && ::fabs(current - here) <= 1e-9 + 1e-6 * length + rounding(here))) {
    std::snprintf(text, sizeof text, "doStep from %.9g s by %.9g s, allowed: from %.9g s, where the FMU is, by 0 s or more", current, length, here);
    report(instance, text);
    return LOST;
  }
  const double until = current + length - plant.start;
  apply_changes(plant);
  plant.is_ahead = plant.observed = false;
  follow_grid(plant, until);
  if (plant.main.at.now.alive != 0 && plant.main.at.now.step.busy != 0) look_ahead(plant, until);
  const Trajectory& at = plant.present().at;
  plant.time = at.now.alive != 0 ? until : at.reached;
  if (at.now.alive != 0) return DONE;
  if (at.status[0] == ENDED) {
    plant.mode = OVER;
    return FINISHED;
  }
  plant.mode = FAILED;
  const char* const why = at.status[0] == CHATTERING ? "chattered: too many events in too short a time" : "diverged: a state left its bounds";
  std::snprintf(text, sizeof text, "the plant %s, after %.6g s", why, plant.start + plant.time);
  report(instance, text);
  return LOST;
}

// Variables by their value references: time, parameters, inputs, outputs, whole numbers.
enum {
  FIRST_PARAMETER = 1, FIRST_INPUT = FIRST_PARAMETER + PARAMETERS, FIRST_OUTPUT = FIRST_INPUT + INPUTS,
  FIRST_INTEGER = FIRST_OUTPUT + OUTPUTS, VARIABLES = FIRST_INTEGER + INTEGERS
};

static bool unknown(Instance& instance, uint32_t reference, const char* kind) {
  char text[128];
  std::snprintf(text, sizeof text, "there is no %s with the value reference %u", kind, reference);
  report(instance, text);
  return false;
}

static bool get_real(Instance& instance, uint32_t reference, double& value) {
  Plant& plant = instance.plant;
  if (reference < 1) value = plant.start + plant.time;
  else if (reference < FIRST_INPUT) value = plant.p[PARAMETER[reference - FIRST_PARAMETER]];
  else if (reference < FIRST_OUTPUT) value = plant.p[INPUT_PARAMETER[reference - FIRST_INPUT]];
  else if (reference < FIRST_INTEGER) {
    if (!prepare(instance)) return false;
    observe(plant);
    value = plant.y[OUTPUT[reference - FIRST_OUTPUT]];
  } else return unknown(instance, reference, "real variable");
  return true;
}

// Whole numbers are switches, counts of events, and outputs that are whole, in this order.
static bool get_integer(Instance& instance, uint32_t reference, int32_t& value) {
  Plant& plant = instance.plant;
  if (reference < FIRST_INTEGER || reference >= VARIABLES) return unknown(instance, reference, "whole number");
  if (!prepare(instance)) return false;
  const int k = int(reference) - FIRST_INTEGER, place = INTEGER[k];
  if (k < SHOWN_SWITCHES) value = int32_t(plant.present().at.c[SWITCH[place]]);
  else if (k < SHOWN_SWITCHES + SHOWN_EVENTS) value = plant.present().count[place];
  else {
    observe(plant);
    value = int32_t(::floor(plant.y[place] + 0.5));
  }
  return true;
}

static bool set_real(Instance& instance, uint32_t reference, double value) {
  Plant& plant = instance.plant;
  if (reference < FIRST_PARAMETER || reference >= FIRST_OUTPUT) return unknown(instance, reference, "parameter or input");
  const bool is_input = reference >= FIRST_INPUT;
  const int k = int(reference) - (is_input ? FIRST_INPUT : FIRST_PARAMETER);
  double& number = plant.p[is_input ? INPUT_PARAMETER[k] : PARAMETER[k]];
  if (!(value - value == 0)) {
    report(instance, "found a value that is no finite number");
    return false;
  }
  if (number == value) return true;
  if (plant.mode == INSTANTIATED || plant.mode == INITIALIZING) plant.prepared = false;
  else if (is_input) plant.new_inputs = true;
  else if (TUNABLE[k]) plant.new_parameters = true;
  else {
    report(instance, "a parameter that is not tunable can be set until the initialization ends");
    return false;
  }
  number = value;
  return true;
}

static bool begin(Instance& instance) {
  if (instance.plant.mode != INITIALIZING || !prepare(instance)) return false;
  instance.plant.mode = STEPPING;
  return true;
}

// New instance; null if the token is that of another export, or there is no memory.
static Instance* instantiate(const char* name, const char* token, void* environment, void* logger) {
  Instance* const instance = static_cast<Instance*>(std::malloc(sizeof(Instance)));
  if (!instance) return nullptr;
  const size_t length = name ? std::strlen(name) : 0;
  instance->name = static_cast<char*>(std::malloc(length + 1));
  if (instance->name) std::memcpy(instance->name, name ? name : "", length + 1);
  instance->environment = environment, instance->logger = logger;
  reset(instance->plant);
  if (instance->name && token && !std::strcmp(token, TOKEN)) return instance;
  report(*instance, "the binary and the model description are of different exports");
  std::free(instance->name), std::free(instance);
  return nullptr;
}

static void release(Instance* instance) {
  if (instance) std::free(instance->name), std::free(instance);
}

// States for rollback. A serialized state begins with the token of the export.
enum { TOKEN_SIZE = sizeof TOKEN, SERIALIZED = TOKEN_SIZE + sizeof(Plant) };

static bool keep_state(const Instance& instance, void*& state) {
  if (!state) state = std::malloc(sizeof(Plant));
  if (state) std::memcpy(state, static_cast<const void*>(&instance.plant), sizeof(Plant));
  return state != nullptr;
}

static bool restore_state(Instance& instance, const void* state) {
  if (state) std::memcpy(static_cast<void*>(&instance.plant), state, sizeof(Plant));
  return state != nullptr;
}

static void discard_state(void*& state) { std::free(state), state = nullptr; }

static bool serialize_state(const void* state, unsigned char* bytes, size_t size) {
  if (!state || size < size_t(SERIALIZED)) return false;
  std::memcpy(bytes, TOKEN, TOKEN_SIZE);
  std::memcpy(bytes + TOKEN_SIZE, state, sizeof(Plant));
  Plant* const plant = reinterpret_cast<Plant*>(bytes + TOKEN_SIZE);
  std::memset(static_cast<void*>(&plant->main.at.noise), 0, sizeof plant->main.at.noise);
  std::memset(static_cast<void*>(&plant->ahead.at.noise), 0, sizeof plant->ahead.at.noise);
  return true;
}

static bool deserialize_state(Instance& instance, const unsigned char* bytes, size_t size, void*& state) {
  if (size != size_t(SERIALIZED) || std::memcmp(bytes, TOKEN, TOKEN_SIZE)) {
    report(instance, "the serialized state is of another export");
    return false;
  }
  if (!state) state = std::malloc(sizeof(Plant));
  if (!state) return false;
  std::memcpy(state, bytes + TOKEN_SIZE, sizeof(Plant));
  Plant* const plant = static_cast<Plant*>(state);
  plant->main.at.noise[0] = plant->ahead.at.noise[0] = NOISE;
  return true;
}
