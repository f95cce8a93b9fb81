// Everything that can be drawn over time, and what of it is chosen: panels, one above the other.
import { floats, locate } from "./format.js";
import { shortNames } from "./labels.js";
import { signalColour } from "./shapes.js";

const FLAGS = ["log", "limits"]; // of a panel

export class Signals {
  // A signal has a name, a label, a colour and, for each run, its values; those of a run that has none are null. An error of an estimate
  // has bounds too, three standard deviations over time.
  // ``before``: those of another motion, whose choice stays.
  constructor(runs, before) {
    this.runs = runs.map((run) => ({ label: run.label, time: floats(run.fine_time), completed: run.completed, pale: run.pale }));
    const quantities = new Map();
    runs.forEach((run, r) => run.quantities.forEach(({ title, unit, signals }) => {
      if (!quantities.has(title)) quantities.set(title, { title, unit, signals: [] });
      const quantity = quantities.get(title);
      signals.forEach(({ name, colour, values, limits, bound }, k) => {
        let signal = quantity.signals.find((one) => one.name === name);
        if (!signal) {
          signal = { name, title, colour: signalColour(colour || ["own", k]), limits, values: runs.map(() => null), bounds: runs.map(() => null) };
          quantity.signals.push(signal);
        }
        signal.values[r] = floats(values);
        if (bound) signal.bounds[r] = floats(bound);
      });
    }));
    this.quantities = [...quantities.values()];
    for (const { signals } of this.quantities) shortNames(signals.map(({ name }) => name)).forEach((label, k) => { signals[k].label = label; });
    // a panel: its signals as [title, name], which have one unit; its scale and whether its limits are in sight; its height, px
    this.panels = before?.panels || [];
    this.full = before?.full || false; // whether names are those of the result
    if (!before && this.quantities.length) this.choose(this.quantities[0].title);
  }

  called({ name, label }) {
    return this.full ? name : label;
  }

  unitOf(title) {
    return this.quantities.find((one) => one.title === title)?.unit;
  }

  // All signals of a quantity, or the one that is named, in the panel that has others of it.
  choose(title, name, wanted = true) {
    for (const signal of this.quantities.find((one) => one.title === title)?.signals || []) {
      if (name !== undefined && signal.name !== name) continue;
      if (!wanted) this.drop(title, signal.name);
      else if (!this.isChosen(title, signal.name)) this.put(title, signal.name, this.panels.find(({ signals }) => signals.some(([of]) => of === title)));
    }
  }

  // A signal goes into a panel of its unit, else into a new one below that panel, or below all.
  move(title, name, panel) {
    if (this.unitOf(title) === undefined) return;
    const own = this.panels.find(({ signals }) => signals.length === 1 && signals[0][0] === title && signals[0][1] === name);
    if (own && own === panel) return;
    this.drop(title, name);
    this.put(title, name, panel);
  }

  put(title, name, panel) {
    if (panel && this.unitOf(panel.signals[0][0]) === this.unitOf(title)) { panel.signals.push([title, name]); return; }
    const below = panel ? this.panels.indexOf(panel) + 1 : this.panels.length;
    this.panels.splice(below, 0, { signals: [[title, name]] });
  }

  drop(title, name) {
    for (const panel of this.panels) panel.signals = panel.signals.filter(([of, one]) => of !== title || one !== name);
    this.panels = this.panels.filter(({ signals }) => signals.length);
  }

  remove(panel) {
    this.panels = this.panels.filter((one) => one !== panel);
  }

  isChosen(title, name) {
    return this.panels.some(({ signals }) => signals.some(([of, one]) => of === title && one === name));
  }

  // What each panel shows; of signals that a run no longer has nothing is left.
  get shown() {
    return this.panels.flatMap((panel) => {
      const titles = [...new Set(panel.signals.map(([of]) => of))];
      const signals = panel.signals.flatMap(([of, name]) => this.quantities.find(({ title }) => title === of)?.signals.filter((one) => one.name === name) || []);
      const taken = new Set(), mixed = titles.length > 1;
      const colour = (own) => (taken.has(own) ? Array.from({ length: 24 }, (_, k) => signalColour(["own", k])).find((other) => !taken.has(other)) || own : own);
      if (mixed) signals.forEach((one, k) => { signals[k] = { ...one, colour: colour(one.colour) }; taken.add(signals[k].colour); });
      return signals.length ? [{ panel, title: titles.join(" + "), unit: this.unitOf(signals[0].title), signals, mixed }] : [];
    });
  }

  // The choice as a text, and back: "tip error~log;joint torque:rpr1/joint_1:rpr1/joint_2|grip torque by axis".
  get text() {
    return this.panels.map((panel) => {
      const titles = [...new Set(panel.signals.map(([of]) => of))], flags = FLAGS.filter((flag) => panel[flag]).map((flag) => `~${flag}`);
      const parts = titles.map((title) => {
        const names = panel.signals.filter(([of]) => of === title).map(([, name]) => name);
        return names.length === this.quantities.find((one) => one.title === title)?.signals.length ? title : [title, ...names].join(":");
      });
      return parts.join("|") + flags.join("");
    }).join(";");
  }

  set text(text) {
    this.panels = [];
    for (const whole of text.split(";")) {
      const [parts, ...flags] = whole.split("~"), count = this.panels.length;
      for (const part of parts.split("|")) {
        const [title, ...names] = part.split(":"), known = this.quantities.find((one) => one.title === title)?.signals || [];
        for (const { name } of known) if ((!names.length || names.includes(name)) && !this.isChosen(title, name)) this.put(title, name, this.panels[count]);
      }
      for (const flag of flags) if (FLAGS.includes(flag) && this.panels[count]) this.panels[count][flag] = true;
    }
  }

  // Value of a signal at a time; the last one after a run's end.
  value(signal, r, time) {
    const values = signal.values[r];
    if (!values) return NaN;
    if (values.length === 1) return values[0];
    const [i, share] = locate(this.runs[r].time, time);
    return share > 0 ? values[i] + share * (values[i + 1] - values[i]) : values[i];
  }
}
