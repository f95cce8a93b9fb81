// Functions that Python calls if the loops are the same for every scene.
extern "C" int64_t rollouts_of(const Scene* given, const Job* job) {
  const SceneScope scope(given);
  return out_of_memory ? int64_t(NO_MEMORY) : rollouts(job);
}
extern "C" int64_t gradients_of(const Scene* given, const Job* job, const AdjointJob* adjoint) {
  const SceneScope scope(given);
  return out_of_memory ? int64_t(NO_MEMORY) : gradients(job, adjoint);
}
extern "C" int64_t evaluate_program(const Program* program, double* const* arguments) {
  Room<double> slots(program->slots + 1);
  if (!slots.at) return NO_MEMORY;
  std::memcpy(slots.at, program->constant, program->constants * sizeof(double));
  program->narrow ? evaluate(*program, program->narrow, slots.at, arguments)
                  : evaluate(*program, program->wide, slots.at, arguments);
  return 0;
}
