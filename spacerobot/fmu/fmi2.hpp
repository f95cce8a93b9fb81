// Co-simulation by FMI 2.0: the functions that an importer calls. Follows `plant.hpp`.
#define FMI extern "C" __attribute__((visibility("default")))
typedef int32_t fmi2Integer, fmi2Boolean;
typedef uint32_t fmi2ValueReference;
typedef const char* fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*fmi2Logger)(void*, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
struct fmi2CallbackFunctions {
  fmi2Logger logger;
  void* (*allocateMemory)(size_t, size_t);
  void (*freeMemory)(void*);
  void (*stepFinished)(void*, fmi2Status);
  void* environment;
};
#define THIS (*static_cast<Instance*>(component))
static fmi2Status status(bool good) { return good ? fmi2OK : fmi2Error; }

static void report(Instance& instance, const char* message) {
  const fmi2Logger logger = reinterpret_cast<fmi2Logger>(instance.logger);
  if (logger) logger(instance.environment, instance.name, fmi2Error, "logStatusError", "%s", message);
}

FMI const char* fmi2GetTypesPlatform() { return "default"; }
FMI const char* fmi2GetVersion() { return "2.0"; }
FMI fmi2Status fmi2SetDebugLogging(void*, fmi2Boolean, size_t, const fmi2String[]) { return fmi2OK; }

FMI void* fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String, const fmi2CallbackFunctions* functions,
                          fmi2Boolean, fmi2Boolean) {
  void* const logger = functions ? reinterpret_cast<void*>(functions->logger) : nullptr;
  return type == fmi2CoSimulation ? instantiate(name, token, functions ? functions->environment : nullptr, logger) : nullptr;
}
FMI void fmi2FreeInstance(void* component) { release(static_cast<Instance*>(component)); }

FMI fmi2Status fmi2SetupExperiment(void* component, fmi2Boolean, double, double start, fmi2Boolean, double) {
  if (THIS.plant.mode != INSTANTIATED || !(start - start == 0)) return fmi2Error;
  THIS.plant.start = start;
  return fmi2OK;
}
FMI fmi2Status fmi2EnterInitializationMode(void* component) {
  if (THIS.plant.mode != INSTANTIATED) return fmi2Error;
  THIS.plant.mode = INITIALIZING;
  return fmi2OK;
}
FMI fmi2Status fmi2ExitInitializationMode(void* component) { return status(begin(THIS)); }
FMI fmi2Status fmi2Terminate(void* component) {
  THIS.plant.mode = TERMINATED;
  return fmi2OK;
}
FMI fmi2Status fmi2Reset(void* component) {
  reset(THIS.plant);
  return fmi2OK;
}

FMI fmi2Status fmi2GetReal(void* component, const fmi2ValueReference reference[], size_t n, double value[]) {
  bool good = true;
  for (size_t i = 0; i < n; ++i) good = get_real(THIS, reference[i], value[i]) && good;
  return status(good);
}
FMI fmi2Status fmi2GetInteger(void* component, const fmi2ValueReference reference[], size_t n, fmi2Integer value[]) {
  bool good = true;
  for (size_t i = 0; i < n; ++i) good = get_integer(THIS, reference[i], value[i]) && good;
  return status(good);
}
FMI fmi2Status fmi2SetReal(void* component, const fmi2ValueReference reference[], size_t n, const double value[]) {
  bool good = true;
  for (size_t i = 0; i < n; ++i) good = set_real(THIS, reference[i], value[i]) && good;
  return status(good);
}
FMI fmi2Status fmi2GetBoolean(void*, const fmi2ValueReference[], size_t n, fmi2Boolean[]) { return status(n == 0); }
FMI fmi2Status fmi2GetString(void*, const fmi2ValueReference[], size_t n, fmi2String[]) { return status(n == 0); }
FMI fmi2Status fmi2SetInteger(void*, const fmi2ValueReference[], size_t n, const fmi2Integer[]) { return status(n == 0); }
FMI fmi2Status fmi2SetBoolean(void*, const fmi2ValueReference[], size_t n, const fmi2Boolean[]) { return status(n == 0); }
FMI fmi2Status fmi2SetString(void*, const fmi2ValueReference[], size_t n, const fmi2String[]) { return status(n == 0); }

FMI fmi2Status fmi2GetFMUstate(void* component, void** state) { return status(keep_state(THIS, *state)); }
FMI fmi2Status fmi2SetFMUstate(void* component, void* state) { return status(restore_state(THIS, state)); }
FMI fmi2Status fmi2FreeFMUstate(void*, void** state) {
  discard_state(*state);
  return fmi2OK;
}
FMI fmi2Status fmi2SerializedFMUstateSize(void*, void*, size_t* size) {
  *size = SERIALIZED;
  return fmi2OK;
}
FMI fmi2Status fmi2SerializeFMUstate(void*, void* state, fmi2Byte bytes[], size_t size) {
  return status(serialize_state(state, reinterpret_cast<unsigned char*>(bytes), size));
}
FMI fmi2Status fmi2DeSerializeFMUstate(void* component, const fmi2Byte bytes[], size_t size, void** state) {
  return status(deserialize_state(THIS, reinterpret_cast<const unsigned char*>(bytes), size, *state));
}
FMI fmi2Status fmi2GetDirectionalDerivative(void*, const fmi2ValueReference[], size_t, const fmi2ValueReference[], size_t,
                                            const double[], double[]) {
  return fmi2Error;
}
FMI fmi2Status fmi2SetRealInputDerivatives(void*, const fmi2ValueReference[], size_t, const fmi2Integer[], const double[]) {
  return fmi2Error;
}
FMI fmi2Status fmi2GetRealOutputDerivatives(void*, const fmi2ValueReference[], size_t, const fmi2Integer[], double[]) {
  return fmi2Error;
}

FMI fmi2Status fmi2DoStep(void* component, double current, double length, fmi2Boolean) {
  const Outcome outcome = do_step(THIS, current, length);
  return outcome == DONE ? fmi2OK : outcome == FINISHED ? fmi2Discard : fmi2Error;
}
FMI fmi2Status fmi2CancelStep(void*) { return fmi2Error; }
FMI fmi2Status fmi2GetStatus(void*, fmi2StatusKind, fmi2Status*) { return fmi2Discard; }
FMI fmi2Status fmi2GetRealStatus(void* component, fmi2StatusKind kind, double* value) {
  if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
  *value = THIS.plant.start + THIS.plant.time;
  return fmi2OK;
}
FMI fmi2Status fmi2GetIntegerStatus(void*, fmi2StatusKind, fmi2Integer*) { return fmi2Discard; }
FMI fmi2Status fmi2GetBooleanStatus(void* component, fmi2StatusKind kind, fmi2Boolean* value) {
  if (kind != fmi2Terminated) return fmi2Discard;
  *value = THIS.plant.mode == OVER;
  return fmi2OK;
}
FMI fmi2Status fmi2GetStringStatus(void*, fmi2StatusKind, fmi2String*) { return fmi2Discard; }
