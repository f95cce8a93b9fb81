// A number in the hand: a slider, linear or logarithmic, a field, its range, and what the chosen metric would do.
import { button, digits, element } from "../format.js";
import { rangeWords, short } from "./parameter_tree.js";

const NOTCHES = 400;

export class Slider {
  // ``range``: {low, high, log}; the hooks hear of values, of the end of a change, of another range and, where there is
  // such a hook, of removal.
  constructor(number, range, hooks) {
    this.number = number;
    this.range = range;
    this.hooks = hooks;
    this.whole = element("div", undefined, "slider");
    this.bar = this.input("range", number.path, { min: 0, max: NOTCHES, step: 1 });
    this.field = this.input("number", `${number.path}, ${number.unit || "no unit"}`, { step: "any" });
    this.arrow = element("output", "", "gradient");
    this.bar.addEventListener("input", () => hooks.onValue(number.path, this.valueAt(Number(this.bar.value))));
    this.bar.addEventListener("change", () => hooks.onSettle());
    this.field.addEventListener("change", () => this.typed());
    const head = element("div", undefined, "head"), name = this.name = element("span", "", "path");
    name.title = [number.path, number.text].filter(Boolean).join(": ");
    const row = element("div", undefined, "hand");
    row.append(this.bar, this.field, element("span", number.unit || "", "unit"), this.bounds());
    head.append(name, this.arrow);
    if (hooks.onRemove) head.append(button("×", `Remove the slider of ${number.path}`, () => hooks.onRemove(number.path)));
    this.whole.append(head, row);
  }

  input(type, label, more) {
    const made = Object.assign(element("input"), { type, ...more });
    made.setAttribute("aria-label", label);
    return made;
  }

  bounds() {
    const bounds = element("details"), log = this.input("checkbox", "logarithmic", {});
    this.ends = ["low", "high"].map((end) => {
      const field = this.input("number", `${end === "low" ? "least" : "greatest"} value of the slider`, { step: "any" });
      field.addEventListener("change", () => this.bound({ [end]: Number(field.value) }));
      return field;
    });
    this.log = log;
    log.addEventListener("change", () => this.bound({ log: log.checked }));
    const label = element("label");
    label.append(log, "logarithmic");
    this.words = element("summary", "⋯");
    bounds.append(this.words, ...this.ends, label);
    return bounds;
  }

  typed() {
    const value = Number(this.field.value);
    const allowed = this.field.value.trim() !== "" && value >= this.least && value <= this.greatest;
    this.field.setCustomValidity(allowed ? "" : `allowed: ${rangeWords(this.number.low, this.number.high) || "a number"}`);
    this.field.reportValidity();
    if (!allowed) return;
    this.hooks.onValue(this.number.path, value);
    this.hooks.onSettle();
  }

  get least() { return this.number.low ?? -Infinity; }

  get greatest() { return this.number.high ?? Infinity; }

  // Another range, where it is one: a logarithmic one has no zero in it.
  bound(change) {
    const range = { ...this.range, ...change };
    range.low = Math.max(range.low, this.least);
    range.high = Math.min(range.high, this.greatest);
    range.log &&= range.low > 0;
    if (range.low < range.high) Object.assign(this.range, range);
    this.update(this.value, this.name.textContent === this.number.path);
    this.hooks.onRange();
  }

  valueAt(notch) {
    const { low, high, log } = this.range, share = notch / NOTCHES;
    const value = log ? low * (high / low) ** share : low + share * (high - low);
    return Number(value.toPrecision(4));
  }

  notchOf(value) {
    const { low, high, log } = this.range;
    const share = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    return Math.round(NOTCHES * Math.min(1, Math.max(0, share || 0)));
  }

  // ``full``: whether it is called by its dotted path.
  update(value, full) {
    this.name.textContent = full ? this.number.path : shortPath(this.number.path);
    const { low, high, log } = this.range, said = [value, low, high, log].join();
    this.value = value;
    if (document.activeElement !== this.field || this.field.value === "" || this.field.validity.valid) this.field.value = short(value);
    if (said === this.said) return;
    this.said = said;
    const notch = this.notchOf(value);
    if (Number(this.bar.value) !== notch) this.bar.value = notch;
    this.bar.setAttribute("aria-valuetext", `${short(value)} ${this.number.unit || ""}`);
    this.words.title = this.bar.title = `${short(low)} to ${short(high)}${log ? ", log" : ""}`;
    [this.ends[0].value, this.ends[1].value, this.log.checked] = [short(low), short(high), log];
    this.log.disabled = !(low > 0);
  }

  // What the metric would do if the number rose by a tenth of itself, or by one where it is zero. ``largest``: of all sliders.
  point(slope, { label, unit }, largest) {
    if (slope === undefined || slope === null) { this.arrow.textContent = ""; return; }
    const { value, number } = this, step = value ? Math.abs(value) / 10 : 1, change = slope * step;
    const size = largest > 0 ? Math.abs(change) / largest : 0;
    const sign = element("i", Math.abs(size) < 1e-3 ? "–" : change > 0 ? "▲" : "▼", "sign");
    sign.style.fontSize = `${(0.6 + 0.8 * size).toFixed(2)}em`;
    const words = `${change > 0 ? "+" : change < 0 ? "−" : ""}${digits(Math.abs(change))} ${unit}`;
    this.arrow.replaceChildren(sign, `${words} for ${value ? "+10 %" : `+1 ${number.unit || ""}`}`);
    this.arrow.title = `${label}: ${digits(slope)} ${unit} per ${number.unit || "1"}`;
  }
}

// A dotted path as people read it: "robots.rpr1.tips.tip.pid.kp" is "rpr1 tip pid kp", "robots.rpr1.joints.elbow.angle_deg" is "rpr1 elbow".
export function shortPath(path) {
  const parts = path.replace(/\.joints\.([^.]+)\.(angle_deg|offset)$/, ".$1").split(".");
  return parts.filter((part) => !["robots", "tips", "grasps", "phases", "controllers"].includes(part)).join(" ").replace(/_/g, " ");
}

// What the server says.
export function firstRange({ slider: [low, high, scale] }) {
  return { low, high, log: scale === "log" };
}
