// Co-simulation by FMI 3.0: the functions that an importer calls. Follows `plant.hpp`.
#define FMI extern "C" __attribute__((visibility("default")))
typedef uint32_t fmi3ValueReference;
typedef const char* fmi3String;
typedef uint8_t fmi3Byte;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessage)(void*, fmi3Status, fmi3String, fmi3String);
#define THIS (*static_cast<Instance*>(instance))
static fmi3Status status(bool good) { return good ? fmi3OK : fmi3Error; }

static void report(Instance& instance, const char* message) {
  const fmi3LogMessage log = reinterpret_cast<fmi3LogMessage>(instance.logger);
  if (log) log(instance.environment, fmi3Error, "logStatusError", message);
}

FMI const char* fmi3GetVersion() { return "3.0"; }
FMI fmi3Status fmi3SetDebugLogging(void*, bool, size_t, const fmi3String[]) { return fmi3OK; }

FMI void* fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String, bool, bool, bool with_events, bool,
                                      const fmi3ValueReference[], size_t intermediate, void* environment, fmi3LogMessage log, void*) {
  if (with_events || intermediate) return nullptr;  // the model description offers neither
  return instantiate(name, token, environment, reinterpret_cast<void*>(log));
}
FMI void* fmi3InstantiateModelExchange(fmi3String, fmi3String, fmi3String, bool, bool, void*, fmi3LogMessage) { return nullptr; }
FMI void* fmi3InstantiateScheduledExecution(fmi3String, fmi3String, fmi3String, bool, bool, void*, fmi3LogMessage, void*, void*, void*) {
  return nullptr;
}
FMI void fmi3FreeInstance(void* instance) { release(static_cast<Instance*>(instance)); }

FMI fmi3Status fmi3EnterInitializationMode(void* instance, bool, double, double start, bool, double) {
  if (THIS.plant.mode != INSTANTIATED || !(start - start == 0)) return fmi3Error;
  THIS.plant.start = start, THIS.plant.mode = INITIALIZING;
  return fmi3OK;
}
FMI fmi3Status fmi3ExitInitializationMode(void* instance) { return status(begin(THIS)); }
FMI fmi3Status fmi3Terminate(void* instance) {
  THIS.plant.mode = TERMINATED;
  return fmi3OK;
}
FMI fmi3Status fmi3Reset(void* instance) {
  reset(THIS.plant);
  return fmi3OK;
}

FMI fmi3Status fmi3GetFloat64(void* instance, const fmi3ValueReference reference[], size_t n, double value[], size_t values) {
  bool good = n == values;
  for (size_t i = 0; i < n && i < values; ++i) good = get_real(THIS, reference[i], value[i]) && good;
  return status(good);
}
FMI fmi3Status fmi3GetInt32(void* instance, const fmi3ValueReference reference[], size_t n, int32_t value[], size_t values) {
  bool good = n == values;
  for (size_t i = 0; i < n && i < values; ++i) good = get_integer(THIS, reference[i], value[i]) && good;
  return status(good);
}
FMI fmi3Status fmi3SetFloat64(void* instance, const fmi3ValueReference reference[], size_t n, const double value[], size_t values) {
  bool good = n == values;
  for (size_t i = 0; i < n && i < values; ++i) good = set_real(THIS, reference[i], value[i]) && good;
  return status(good);
}
// Types of which there are no variables.
#define ABSENT(name, type) \
  FMI fmi3Status fmi3Get##name(void*, const fmi3ValueReference[], size_t n, type[], size_t) { return status(n == 0); } \
  FMI fmi3Status fmi3Set##name(void*, const fmi3ValueReference[], size_t n, const type[], size_t) { return status(n == 0); }
ABSENT(Float32, float) ABSENT(Int8, int8_t) ABSENT(UInt8, uint8_t) ABSENT(Int16, int16_t) ABSENT(UInt16, uint16_t)
ABSENT(UInt32, uint32_t) ABSENT(Int64, int64_t) ABSENT(UInt64, uint64_t) ABSENT(Boolean, bool) ABSENT(String, fmi3String)
FMI fmi3Status fmi3SetInt32(void*, const fmi3ValueReference[], size_t n, const int32_t[], size_t) { return status(n == 0); }
FMI fmi3Status fmi3GetBinary(void*, const fmi3ValueReference[], size_t n, size_t[], const fmi3Byte*[], size_t) { return status(n == 0); }
FMI fmi3Status fmi3SetBinary(void*, const fmi3ValueReference[], size_t n, const size_t[], const fmi3Byte* const[], size_t) {
  return status(n == 0);
}
FMI fmi3Status fmi3GetClock(void*, const fmi3ValueReference[], size_t n, bool[]) { return status(n == 0); }
FMI fmi3Status fmi3SetClock(void*, const fmi3ValueReference[], size_t n, const bool[]) { return status(n == 0); }

FMI fmi3Status fmi3GetFMUState(void* instance, void** state) { return status(keep_state(THIS, *state)); }
FMI fmi3Status fmi3SetFMUState(void* instance, void* state) { return status(restore_state(THIS, state)); }
FMI fmi3Status fmi3FreeFMUState(void*, void** state) {
  discard_state(*state);
  return fmi3OK;
}
FMI fmi3Status fmi3SerializedFMUStateSize(void*, void*, size_t* size) {
  *size = SERIALIZED;
  return fmi3OK;
}
FMI fmi3Status fmi3SerializeFMUState(void*, void* state, fmi3Byte bytes[], size_t size) {
  return status(serialize_state(state, bytes, size));
}
FMI fmi3Status fmi3DeserializeFMUState(void* instance, const fmi3Byte bytes[], size_t size, void** state) {
  return status(deserialize_state(THIS, bytes, size, *state));
}

FMI fmi3Status fmi3EnterStepMode(void*) { return fmi3Error; }
FMI fmi3Status fmi3DoStep(void* instance, double current, double length, bool, bool* event, bool* terminate, bool* early, double* last) {
  const Outcome outcome = do_step(THIS, current, length);
  *event = *early = false, *terminate = outcome == FINISHED, *last = THIS.plant.start + THIS.plant.time;
  return status(outcome != LOST);
}

// What the model description does not offer.
typedef const fmi3ValueReference References[];
#define NOT_OFFERED(name, ...) FMI fmi3Status fmi3##name(__VA_ARGS__) { return fmi3Error; }
NOT_OFFERED(GetNumberOfVariableDependencies, void*, fmi3ValueReference, size_t*)
NOT_OFFERED(GetVariableDependencies, void*, fmi3ValueReference, size_t[], fmi3ValueReference[], size_t[], fmi3DependencyKind[], size_t)
NOT_OFFERED(GetDirectionalDerivative, void*, References, size_t, References, size_t, const double[], size_t, double[], size_t)
NOT_OFFERED(GetAdjointDerivative, void*, References, size_t, References, size_t, const double[], size_t, double[], size_t)
NOT_OFFERED(EnterConfigurationMode, void*)
NOT_OFFERED(ExitConfigurationMode, void*)
NOT_OFFERED(GetIntervalDecimal, void*, References, size_t, double[], fmi3IntervalQualifier[])
NOT_OFFERED(GetIntervalFraction, void*, References, size_t, uint64_t[], uint64_t[], fmi3IntervalQualifier[])
NOT_OFFERED(GetShiftDecimal, void*, References, size_t, double[])
NOT_OFFERED(GetShiftFraction, void*, References, size_t, uint64_t[], uint64_t[])
NOT_OFFERED(SetIntervalDecimal, void*, References, size_t, const double[])
NOT_OFFERED(SetIntervalFraction, void*, References, size_t, const uint64_t[], const uint64_t[])
NOT_OFFERED(SetShiftDecimal, void*, References, size_t, const double[])
NOT_OFFERED(SetShiftFraction, void*, References, size_t, const uint64_t[], const uint64_t[])
NOT_OFFERED(EvaluateDiscreteStates, void*)
NOT_OFFERED(UpdateDiscreteStates, void*, bool*, bool*, bool*, bool*, bool*, double*)
NOT_OFFERED(EnterEventMode, void*)
NOT_OFFERED(EnterContinuousTimeMode, void*)
NOT_OFFERED(CompletedIntegratorStep, void*, bool, bool*, bool*)
NOT_OFFERED(SetTime, void*, double)
NOT_OFFERED(SetContinuousStates, void*, const double[], size_t)
NOT_OFFERED(GetContinuousStateDerivatives, void*, double[], size_t)
NOT_OFFERED(GetEventIndicators, void*, double[], size_t)
NOT_OFFERED(GetContinuousStates, void*, double[], size_t)
NOT_OFFERED(GetNominalsOfContinuousStates, void*, double[], size_t)
NOT_OFFERED(GetNumberOfEventIndicators, void*, size_t*)
NOT_OFFERED(GetNumberOfContinuousStates, void*, size_t*)
NOT_OFFERED(GetOutputDerivatives, void*, References, size_t, const int32_t[], double[], size_t)
NOT_OFFERED(ActivateModelPartition, void*, fmi3ValueReference, double)
