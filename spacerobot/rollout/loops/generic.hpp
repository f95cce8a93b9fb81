// Sizes, tables and functions of a scene as data instead of constants: the loops are then the same for every scene, whose
// functions a virtual machine evaluates. Included after `machine.hpp`. kernel_tables.py writes the list FUNCTIONS, and a
// macro for each size and table.
#include <cstdlib>
enum { MOST_STAGES = 16 };
struct Tableau {
  int64_t STAGES, TOTAL, PLACES;
  double A[MOST_STAGES][MOST_STAGES], B[MOST_STAGES], C[MOST_STAGES], E[MOST_STAGES];
  double INSIDE[3], INNER[3][MOST_STAGES], DENSE[MOST_STAGES][4];
  int64_t PLACE[MOST_STAGES];
};

struct Scene {
  const int64_t* size;              // SIZES and LENGTHS, in this order
  const int64_t* const* integers;   // INTEGERS
  const double* const* reals;       // REALS
  const Tableau* tableau;
  const Program* const* function;   // FUNCTIONS, null for those that the scene does not have
};
static thread_local const Scene* scene;
static thread_local double* const* work;  // slots of each function
static thread_local bool out_of_memory;   // whether there was no memory for a member of a struct
#define OUT_OF_MEMORY out_of_memory
#define method (*scene->tableau)
typedef int64_t Stage;
#define NEEDED_STAGES method.STAGES
#define ALL_STAGES method.TOTAL
#define SOLUTION method.TOTAL

template <class Body> INLINE void for_stages(Stage last, const Body& body) {
  for (int s = 0; s < last; ++s) body(s);
}
template <class Body> INLINE void for_stages_back(Stage last, const Body& body) {
  for (int s = int(last) - 1; s >= 0; --s) body(s);
}

// Array in a struct, whose length depends on the scene.
template <class T> struct Row {
  T* at;
  int64_t number;
  explicit Row(int64_t n) : at(static_cast<T*>(std::calloc(n + 1, sizeof(T)))), number(n) { out_of_memory |= !at; }
  Row(const Row& other) : Row(other.number) { *this = other; }
  Row& operator=(const Row& other) {
    if (at && other.at) std::memcpy(at, other.at, number * sizeof(T));
    return *this;
  }
  ~Row() { std::free(at); }
  operator T*() { return at; }
  operator const T*() const { return at; }
};
#define ROW(type, name, number) Row<type> name{number}
#define THREE_ROWS(type, name, number) Row<type> name[3] = {Row<type>(number), Row<type>(number), Row<type>(number)}

// Pointer to an argument or a result.
struct Argument {
  double* at;
  Argument() : at(nullptr) {}
  Argument(const double* p) : at(const_cast<double*>(p)) {}
  Argument(const Row<double>& row) : at(row.at) {}
};

struct Function {
  int number;
  void operator()(Argument a, Argument b = {}, Argument c = {}, Argument d = {}, Argument e = {}, Argument f = {},
                  Argument g = {}, Argument h = {}) const {
    const Program& program = *scene->function[number];
    double *const all[] = {a.at, b.at, c.at, d.at, e.at, f.at, g.at, h.at}, *const w = work[number];
    program.narrow ? evaluate(program, program.narrow, w, all) : evaluate(program, program.wide, w, all);
  }
};
enum FunctionNumber {
#define NUMBER(name) NUMBER_##name,
  FUNCTIONS(NUMBER)
#undef NUMBER
  FUNCTION_COUNT
};
struct Generated {
#define MEMBER(name) static constexpr Function name{NUMBER_##name};
  FUNCTIONS(MEMBER)
#undef MEMBER
};

// Scope in which this thread's loops use a scene.
struct SceneScope {
  double* slots[FUNCTION_COUNT] = {};
  explicit SceneScope(const Scene* given) {
    scene = given, work = slots, out_of_memory = false;
    for (int f = 0; f < FUNCTION_COUNT; ++f) {
      const Program* const program = given->function[f];
      if (!program) continue;
      slots[f] = static_cast<double*>(std::malloc((program->slots + 1) * sizeof(double)));
      if (!slots[f]) out_of_memory = true;
      else std::memcpy(slots[f], program->constant, program->constants * sizeof(double));
    }
  }
  ~SceneScope() {
    for (double* one : slots) std::free(one);
    scene = nullptr, work = nullptr;
  }
};
