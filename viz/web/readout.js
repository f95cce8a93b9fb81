// Time, and the size of each tip's error.
import { element, errorSize, mark } from "./format.js";
import { shortNames } from "./labels.js";
import { tipColour } from "./shapes.js";

export class Readout {
  constructor(root) {
    this.root = root;
    this.values = [];
  }

  // ``colours``: of the runs, where they lie over each other; ``full``: tips by the names of the result.
  load(runs, colours, full) {
    runs = runs.filter(({ data }) => !data.pale);
    this.clock = element("div", "", "time");
    this.phase = element("div", "", "phase");
    this.values = [];
    const rows = [this.clock, this.phase];
    runs.forEach((run, r) => {
      if (runs.length > 1) rows.push(this.heading(run.data.label, colours && colours[r]));
      const { tip_names: names } = run.data;
      (full ? names : shortNames(names)).forEach((name, k) => {
        if (!run.errors[k]) return;
        const row = element("div", undefined, "tip"), value = element("b");
        row.append(mark(tipColour(k)), `${name} error `, value);
        rows.push(row);
        this.values.push([value, run, k]);
      });
    });
    this.root.replaceChildren(...rows);
  }

  heading(label, colour) {
    const row = element("div", undefined, "run");
    if (colour) row.append(mark(colour, "box solid"));
    row.append(label);
    return row;
  }

  // ``phase``: that of the time, if there are any.
  seek(time, phase) {
    this.clock.textContent = `t = ${time.toFixed(2)} s`;
    this.phase.textContent = phase;
    this.phase.hidden = !phase;
    for (const [value, run, k] of this.values) {
      const past = time > run.end + 1e-9;
      value.textContent = past ? `${run.data.completed ? "ended" : "diverged"} after ${run.end.toPrecision(3)} s` : errorSize(1e3 * run.error(k, time));
    }
  }
}
