// Designs: values that differ from the scenario's, by path. The one in the hand, the steps to it, those kept by name.
class Designs {
  // ``own``: the scenario's values by path; more may come with another structure.
  constructor(own, onChange) {
    [this.own, this.onChange] = [own, onChange];
    [this.now, this.steps, this.at] = [{}, [{}], 0];
    this.kept = [];
    this.chosen = null; // kept design that the one in the hand is compared with
  }

  value(path) {
    return this.now[path] ?? this.own[path];
  }

  // While a slider moves; ``settle`` makes it one step.
  set(changes) {
    const now = { ...this.now, ...changes };
    for (const path of Object.keys(changes)) if (now[path] === this.own[path]) delete now[path];
    this.now = now;
    this.onChange();
  }

  settle() {
    if (!this.moving) return;
    this.steps.splice(this.at + 1, Infinity, this.now);
    this.at += 1;
    this.onChange();
  }

  // All values at once, as one step.
  take(values) {
    this.now = { ...values };
    if (this.moving) this.settle(); else this.onChange();
  }

  get moving() { return keyOf(this.now) !== keyOf(this.steps[this.at]); }

  // The design that the one in the hand is compared with; nothing at the first.
  get before() {
    if (this.kept.includes(this.chosen)) return this.chosen.values;
    return this.moving ? this.steps[this.at] : this.steps[this.at - 1];
  }

  get canUndo() { return this.at > 0; }

  get canRedo() { return this.at < this.steps.length - 1; }

  go(steps) {
    const at = this.at + steps;
    if (!(at in this.steps)) return;
    this.at = at;
    this.now = this.steps[at];
    this.onChange();
  }

  keep(name, values = this.now) {
    this.kept.push({ name, values: { ...values } });
    this.onChange();
  }

  drop(kept) {
    this.kept = this.kept.filter((one) => one !== kept);
    this.onChange();
  }

  choose(kept) {
    this.chosen = kept;
    this.onChange();
  }

  // Of whatever an address holds, what can be values of a design.
  static plain(values) {
    const fits = ([, value]) => ["number", "string", "boolean"].includes(typeof value);
    return Object.fromEntries(Object.entries(values || {}).filter(fits));
  }
}

function parsed(text) {
  try {
    return JSON.parse(text) || {};
  } catch {
    return {}; // an address may hold anything
  }
}
