// Virtual machine for the functions of a scene. CasADi's own branches for each operation, which takes a processor several
// times as long as the operation. Here operations of one kind whose operands are ready are evaluated one after the other
// in a short loop: they are independent of each other, and few branches are mispredicted.
//
// A program is made from the statements of CasADi's C code, each of which is one operation.

// Kind of an operation, its operator or function in C, and its value.
#define OPERATIONS(DO)                                                                                            \
  DO(ASSIGN, "", A) DO(NEG, "-", -A) DO(NOT, "!", A == 0) DO(INV, "1./", 1. / A) DO(TWICE, "2.*", A + A)          \
  DO(ADD, "+", A + B) DO(SUB, "-", A - B) DO(MUL, "*", A * B) DO(DIV, "/", A / B) DO(LESS, "<", A < B)            \
  DO(LESS_EQUAL, "<=", A <= B) DO(EQUAL, "==", A == B) DO(NOT_EQUAL, "!=", A != B)                                \
  DO(AND, "&&", A != 0 && B != 0) DO(OR, "||", A != 0 || B != 0)                                                  \
  DO(SQUARE, "casadi_sq", A * A) DO(SIN, "casadi_sin", casadi_sin(A)) DO(COS, "casadi_cos", casadi_cos(A))        \
  DO(SELECT, "casadi_if_else_zero", A != 0 ? B : 0.) DO(SQRT, "sqrt", __builtin_sqrt(A))                          \
  DO(ABS, "fabs", __builtin_fabs(A)) DO(ABSOLUTE, "casadi_fabs", __builtin_fabs(A))                               \
  DO(SIGN, "casadi_sign", casadi_sign(A)) DO(MIN, "casadi_fmin", fmin(A, B)) DO(MAX, "casadi_fmax", fmax(A, B))   \
  DO(COPY_SIGN, "copysign", __builtin_copysign(A, B)) DO(TAN, "tan", tan(A)) DO(ASIN, "asin", asin(A))            \
  DO(ACOS, "acos", acos(A)) DO(ATAN, "atan", atan(A)) DO(SINH, "sinh", sinh(A)) DO(COSH, "cosh", cosh(A))         \
  DO(TANH, "tanh", tanh(A)) DO(ASINH, "asinh", asinh(A)) DO(ACOSH, "acosh", acosh(A)) DO(ATANH, "atanh", atanh(A)) \
  DO(EXP, "exp", exp(A)) DO(LOG, "log", log(A)) DO(EXPM1, "expm1", expm1(A)) DO(LOG1P, "log1p", log1p(A))         \
  DO(CASADI_EXPM1, "casadi_expm1", expm1(A)) DO(CASADI_LOG1P, "casadi_log1p", log1p(A))                           \
  DO(ERF, "erf", erf(A)) DO(ERFINV, "erfinv", erfinv(A)) DO(CASADI_ERFINV, "casadi_erfinv", erfinv(A))            \
  DO(FLOOR, "floor", floor(A)) DO(CEIL, "ceil", ceil(A)) DO(POW, "pow", pow(A, B)) DO(ATAN2, "atan2", atan2(A, B)) \
  DO(HYPOT, "hypot", hypot(A, B)) DO(CASADI_HYPOT, "casadi_hypot", hypot(A, B)) DO(FMOD, "fmod", fmod(A, B))      \
  DO(REMAINDER, "remainder", remainder(A, B))                                                                     \
  DO(FUSED, nullptr, __builtin_fma(A, B, C)) DO(FUSED_LESS, nullptr, __builtin_fma(A, B, -C))                     \
  DO(FUSED_FROM, nullptr, __builtin_fma(-A, B, C))
enum Operation {
#define DO(name, written, value) name,
  OPERATIONS(DO)
#undef DO
  OPERATION_COUNT, CONSTANT = OPERATION_COUNT, READ, WRITE, KINDS
};
constexpr const char* WRITTEN[] = {
#define DO(name, written, value) written,
  OPERATIONS(DO)
#undef DO
};

// Successive operations of one kind. Each has four indices: the slot of its result, and those of its operands. READ reads
// from argument `part` and WRITE writes to result `part`; their last index is the place there.
struct Group {
  int32_t kind, part;
  int64_t number;
};
struct Program {
  const Group* group;
  const uint16_t* narrow;  // indices where they fit, else null
  const uint32_t* wide;
  const double* constant;  // values of the first slots
  int64_t groups, constants, slots, inputs;
};

template <class Index>
static void evaluate(const Program& program, const Index* i, double* __restrict w, double* const* argument) {
#define A w[i[1]]
#define B w[i[2]]
#define C w[i[3]]
  for (const Group *g = program.group, *last = g + program.groups; g < last; ++g) {
    const Index* const end = i + 4 * g->number;
    switch (g->kind) {
#define DO(name, written, value) \
  case name: \
    for (; i < end; i += 4) w[i[0]] = value; \
    break;
      OPERATIONS(DO)
#undef DO
      case READ:
        for (const double* from = argument[g->part]; i < end; i += 4) w[i[0]] = from[i[3]];
        break;
      case WRITE:
        for (double* to = argument[program.inputs + g->part]; i < end; i += 4) to[i[3]] = A;
        break;
    }
  }
#undef A
#undef B
#undef C
}

// Statement of a text. `to` and the operands are registers, except that operand 2 is the place in an argument or a result.
// `read` reads the next statement and returns false at the end of the text or if there is no statement.
struct Statement {
  int kind, part, to, operand[3];

  static bool skip(const char*& at, const char* word) {
    const char* p = at;
    for (; *word; ++word, ++p)
      if (*p != *word) return false;
    at = p;
    return true;
  }
  static int number(const char*& at) {
    int n = 0;
    for (; *at >= '0' && *at <= '9'; ++at) n = 10 * n + (*at - '0');
    return n;
  }
  static bool letter(char c) { return (c >= 'a' && c <= 'z') || c == '_'; }
  static bool is_register(const char* at) { return at[0] == 'a' && at[1] >= '0' && at[1] <= '9'; }
  static int operation(const char* at, int64_t length, bool of_two) {
    for (int k = 0; k < FUSED; ++k) {
      int64_t n = 0;
      while (n < length && WRITTEN[k][n] == at[n]) ++n;
      if (n == length && !WRITTEN[k][n] && (letter(*at) || of_two == (k >= ADD && k <= OR))) return k;
    }
    return KINDS;
  }
  bool read(const char*& at) {
    operand[0] = operand[1] = operand[2] = -1, part = 0, to = -1;
    const bool writes = skip(at, "res");
    if (!writes && !(is_register(at) && skip(at, "a"))) return false;
    (writes ? part : to) = number(at);
    if (writes && !skip(at, "[")) return false;
    if (writes) operand[2] = number(at);
    if (writes && !skip(at, "]")) return false;
    if (!skip(at, "=")) return false;
    if (skip(at, "arg")) {
      kind = READ, part = number(at);
      if (!skip(at, "[")) return false;
      operand[2] = number(at);
      return skip(at, "];");
    }
    const bool bracket = skip(at, "(");
    const char* const word = at;
    int64_t length = 0;
    if (!is_register(at)) {
      while (*at && *at != ';' && *at != '(' && !(bracket && is_register(at))) ++at;
      length = at - word;
      if (*at == ';' && !bracket) return kind = CONSTANT, ++at, true;
      if (!bracket && !skip(at, "(")) return false;
    }
    if (!skip(at, "a")) return false;
    operand[0] = number(at);
    const char* sign = at;
    while (*at && *at != ';' && *at != ')' && !is_register(at)) ++at;
    const int64_t between = at - sign;
    if (is_register(at)) ++at, operand[1] = number(at);
    const bool infix = operand[1] >= 0 && length == 0;
    kind = infix ? operation(sign, between, true) : operation(word, length, false);
    if (kind == KINDS || ((bracket || length) && !skip(at, ")"))) return false;
    if (writes) kind = kind == ASSIGN ? WRITE : KINDS;
    return kind != KINDS && skip(at, ";");
  }
};

// Convert `number` statements to a program: groups (at most `number`) and indices (4 for each operation), for which the
// caller provides the arrays. Constants take the first slots in the order of their statements. Returns the number of groups,
// -1 without memory, or -2 minus the place of a character that cannot be read. `sizes` becomes the numbers of slots and of
// operations.
extern "C" int64_t make_program(const char* text, int64_t number, Group* groups, uint32_t* index, int64_t* sizes) {
  const char* at = text;
  Room<Statement> all(number + 1);
  // defining statement of each register; users of each statement as linked lists; number of operands that each awaits
  Room<int> definition(number + 1), chain(3 * number + 3), waits(number + 1), uses(number + 1), slot(number + 1);
  Room<int> vacant(number + 1);
  Room<int> first(number + 1), ready(number + 1);
  if (!all.at || !definition.at || !chain.at || !waits.at || !uses.at || !slot.at || !vacant.at || !first.at || !ready.at)
    return -1;
  int slots = 0, vacancies = 0;
  for (int i = 0; i < number; ++i) {
    Statement& s = all.at[i];
    if (!s.read(at)) return -2 - (at - text);
    while (*at == '\n') ++at;
    first.at[i] = -1, waits.at[i] = uses.at[i] = 0, slot.at[i] = -1;
    for (int k = 0; k < 2; ++k) {
      if (s.operand[k] < 0) continue;
      if (s.operand[k] > number) return -2 - (at - text);
      s.operand[k] = definition.at[s.operand[k]], ++uses.at[s.operand[k]];
    }
    if (s.to > number) return -2 - (at - text);
    if (s.to >= 0) definition.at[s.to] = i;
    if (s.kind == CONSTANT) slot.at[i] = slots++;
  }
#if defined(__FMA__) || defined(__aarch64__)  // a product with a single user, a sum, is fused with it
  for (int i = 0; i < number; ++i) {
    Statement& s = all.at[i];
    if (s.kind != ADD && s.kind != SUB) continue;
    for (int k = 1; k >= 0; --k) {
      Statement& product = all.at[s.operand[k]];
      const int other = s.operand[1 - k];
      if (product.kind != MUL || uses.at[s.operand[k]] != 1 || other == s.operand[k]) continue;
      uses.at[s.operand[k]] = -1;  // the product is not evaluated by itself
      s.kind = s.kind == ADD ? FUSED : k == 0 ? FUSED_LESS : FUSED_FROM;
      s.operand[0] = product.operand[0], s.operand[1] = product.operand[1], s.operand[2] = other;
      break;
    }
  }
#endif
  int head[KINDS], tail[KINDS], count[KINDS];
  for (int k = 0; k < KINDS; ++k) head[k] = tail[k] = -1, count[k] = 0;
  const auto enqueue = [&](int i) {
    const int kind = all.at[i].kind;
    ready.at[i] = -1, ++count[kind];
    (tail[kind] < 0 ? head[kind] : ready.at[tail[kind]]) = i, tail[kind] = i;
  };
  const auto operands = [&](const Statement& s) { return s.kind >= FUSED && s.kind <= FUSED_FROM ? 3 : 2; };
  for (int i = int(number) - 1; i >= 0; --i) {
    const Statement& s = all.at[i];
    if (s.kind == CONSTANT || uses.at[i] < 0) continue;
    for (int k = 0; k < operands(s); ++k) {
      if (s.operand[k] < 0 || all.at[s.operand[k]].kind == CONSTANT) continue;
      chain.at[3 * i + k] = first.at[s.operand[k]], first.at[s.operand[k]] = 3 * i + k, ++waits.at[i];
    }
  }
  for (int i = 0; i < number; ++i)
    if (all.at[i].kind != CONSTANT && uses.at[i] >= 0 && waits.at[i] == 0) enqueue(i);
  int64_t group_count = 0, indices = 0;
  while (true) {
    // the kind with the most operations that are ready; results are written last
    int kind = -1;
    for (int k = 0; k < KINDS; ++k)
      if (count[k] && (kind < 0 || kind == WRITE || (k != WRITE && count[k] > count[kind]))) kind = k;
    if (kind < 0) break;
    const int begin = head[kind];
    head[kind] = tail[kind] = -1, count[kind] = 0;
    for (int i = begin; i >= 0; i = ready.at[i]) {
      const Statement& s = all.at[i];
      const int part = kind == READ || kind == WRITE ? s.part : 0;
      if (i == begin || groups[group_count - 1].part != part) groups[group_count++] = {kind, part, 0};
      ++groups[group_count - 1].number;
      if (kind != WRITE) slot.at[i] = vacancies ? vacant.at[--vacancies] : slots++;
      uint32_t* const to = index + 4 * indices++;
      to[0] = kind == WRITE ? 0 : slot.at[i];
      for (int k = 0; k < 3; ++k) {
        const bool value = k < operands(s) && s.operand[k] >= 0;
        to[1 + k] = value ? slot.at[s.operand[k]] : k == 2 && s.operand[2] >= 0 ? s.operand[2] : 0;
      }
      for (int k = 0; k < operands(s); ++k) {
        const int o = s.operand[k];
        if (o >= 0 && all.at[o].kind != CONSTANT && --uses.at[o] == 0) vacant.at[vacancies++] = slot.at[o];
      }
    }
    for (int i = begin, next; i >= 0; i = next) {
      next = ready.at[i];
      for (int user = first.at[i]; user >= 0; user = chain.at[user])
        if (--waits.at[user / 3] == 0) enqueue(user / 3);
    }
  }
  sizes[0] = slots, sizes[1] = indices;
  return group_count;
}
