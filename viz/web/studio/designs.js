// Designs: values that differ from the scenario's, by path. The one in the hand, those kept by name, the steps to here.
import { keyOf } from "./rollouts.js";

export class Designs {
  // ``own``: the scenario's values by path; more may come with another structure.
  constructor(own, onChange) {
    this.own = own;
    this.onChange = onChange;
    this.now = {};
    this.kept = [];
    this.steps = [{ now: this.now, kept: this.kept }];
    this.at = 0;
    this.chosen = null; // name of the kept one that the one in the hand is compared with
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
    if (this.moving) this.step({});
  }

  // All values at once, as one step.
  take(values) {
    this.now = { ...values };
    if (this.moving) this.settle(); else this.onChange();
  }

  // A step that can be undone.
  step({ kept = this.kept }) {
    this.kept = kept;
    this.steps.splice(this.at + 1, Infinity, { now: this.now, kept });
    this.at += 1;
    this.onChange();
  }

  get moving() { return keyOf(this.now) !== keyOf(this.steps[this.at].now); }

  // Name and values of the design that the one in the hand is compared with; nothing at the first.
  get before() {
    const own = this.kept.find(({ name }) => name === this.chosen);
    if (own) return own;
    const here = keyOf(this.now), last = this.steps.slice(0, this.at + 1).findLast(({ now }) => keyOf(now) !== here);
    return last && { name: "before", values: last.now };
  }

  get canUndo() { return this.at > 0; }

  get canRedo() { return this.at < this.steps.length - 1; }

  go(steps) {
    const at = this.at + steps;
    if (!(at in this.steps)) return;
    this.at = at;
    ({ now: this.now, kept: this.kept } = this.steps[at]);
    this.onChange();
  }

  // Under a name of its own.
  keep(wanted, values = this.now) {
    this.step({ kept: [...this.kept, { name: freeName(wanted, this.kept), values: { ...values } }] });
  }

  rename(name, wanted) {
    if (!wanted || wanted === name) return;
    const others = this.kept.filter((one) => one.name !== name), free = freeName(wanted, others);
    if (this.chosen === name) this.chosen = free;
    this.step({ kept: this.kept.map((one) => (one.name === name ? { ...one, name: free } : one)) });
  }

  drop(name) {
    this.step({ kept: this.kept.filter((one) => one.name !== name) });
  }

  // Compare with a kept one, or with the design before.
  choose(name) {
    this.chosen = name;
    this.onChange();
  }

  // Of whatever an address holds, what can be values of a design.
  static plain(values) {
    const fits = ([, value]) => ["number", "string", "boolean"].includes(typeof value);
    return Object.fromEntries(Object.entries(values || {}).filter(fits));
  }
}

// A number is added to a name that is taken.
function freeName(wanted, kept) {
  let name = wanted, count = 2;
  while (kept.some((one) => one.name === name)) name = `${wanted} ${count++}`;
  return name;
}

export function parsed(text) {
  try {
    return JSON.parse(text) || {};
  } catch {
    return {}; // an address may hold anything
  }
}
