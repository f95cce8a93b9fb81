// Every signal of all runs, by quantity; which of them are chosen.
import { floats, locate } from "./format.js";
import { signalColour } from "./shapes.js";

export class Signals {
  // A signal has a name, a colour and, for each run, its values; those of a run that has none are null.
  constructor(runs) {
    this.runs = runs.map((run) => ({ label: run.label, time: floats(run.fine_time), completed: run.completed, pale: run.pale }));
    const quantities = new Map();
    runs.forEach((run, r) => run.quantities.forEach(({ title, unit, signals }) => {
      if (!quantities.has(title)) quantities.set(title, { title, unit, signals: [] });
      const quantity = quantities.get(title);
      signals.forEach(({ name, colour, values, limits }, k) => {
        let signal = quantity.signals.find((one) => one.name === name);
        if (!signal) {
          signal = { name, colour: signalColour(colour || ["own", k]), limits, values: runs.map(() => null) };
          quantity.signals.push(signal);
        }
        signal.values[r] = floats(values);
      });
    }));
    this.quantities = [...quantities.values()];
    this.chosen = new Map();
    if (this.quantities.length) this.choose(this.quantities[0].title);
  }

  // All signals of a quantity, or the one that is named.
  choose(title, name, wanted = true) {
    const quantity = this.quantities.find((one) => one.title === title);
    if (!quantity) return;
    const names = this.chosen.get(title) || new Set();
    for (const signal of quantity.signals) {
      if (name !== undefined && signal.name !== name) continue;
      if (wanted) names.add(signal.name); else names.delete(signal.name);
    }
    if (names.size) this.chosen.set(title, names); else this.chosen.delete(title);
  }

  isChosen(title, name) {
    return Boolean(this.chosen.get(title)?.has(name));
  }

  // Quantities of which something is chosen, with that alone.
  get shown() {
    return this.quantities.filter(({ title }) => this.chosen.has(title)).map((quantity) => (
      { ...quantity, signals: quantity.signals.filter(({ name }) => this.isChosen(quantity.title, name)) }
    ));
  }

  // The choice as a text, and back: "tip error;joint torque:rpr1/joint_1:rpr1/joint_2".
  get text() {
    return this.shown.map(({ title, signals }) => {
      const all = this.quantities.find((one) => one.title === title).signals.length === signals.length;
      return all ? title : [title, ...signals.map(({ name }) => name)].join(":");
    }).join(";");
  }

  set text(text) {
    this.chosen.clear();
    for (const part of text.split(";")) {
      const [title, ...names] = part.split(":");
      if (names.length) names.forEach((name) => this.choose(title, name)); else this.choose(title);
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

  // Least and greatest value of signals between two times, zero among them, and limits that are not far; a diverged
  // run's last instants would hide all before.
  range(signals, [begin, end]) {
    let least = 0, greatest = 0;
    for (const { values } of signals) {
      values.forEach((own, r) => {
        if (!own) return;
        const { time, completed } = this.runs[r], last = completed ? own.length : Math.max(2, 0.8 * own.length);
        for (let i = 0; i < Math.min(own.length, last); i++) {
          if (own.length > 1 && (time[i] < begin || time[i] > end)) continue;
          least = Math.min(least, own[i] || 0);
          greatest = Math.max(greatest, own[i] || 0);
        }
      });
    }
    for (const limit of signals.flatMap(({ limits }) => limits || [])) {
      if (limit > greatest && limit < 2 * greatest) greatest = limit;
      if (limit < least && limit > 2 * least) least = limit;
    }
    return greatest - least < 1e-9 ? [least, least + 1e-3] : [least, greatest];
  }
}
