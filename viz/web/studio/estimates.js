// Errors of the filters' estimates in the bands of three standard deviations that the filters state: a plot for each estimate.
import { isBounded } from "../chart.js";
import { amount, element, mark } from "../format.js";
import { inked, onScheme } from "../theme.js";
import { plotIn } from "../uplot_plot.js";

export class Estimates {
  // ``chart`` makes columns of signals, as for its own panels.
  constructor(root, chart) {
    this.root = root;
    this.chart = chart;
    this.list = root.querySelector(".list");
    this.quantities = [];
    new ResizeObserver(() => { if (this.list.clientWidth !== this.width) this.draw(); }).observe(root); // also where it is opened
    onScheme(() => this.draw());
  }

  // ``signals``: all of the motion that is seen; those without a band are left out.
  show({ quantities }) {
    this.quantities = quantities.map((one) => ({ ...one, signals: one.signals.filter(isBounded) })).filter(({ signals }) => signals.length);
    this.root.hidden = this.quantities.length === 0;
    this.draw();
  }

  draw() {
    this.width = this.root.open ? this.list.clientWidth : 0;
    if (!this.width) return;
    const parts = this.quantities.map((quantity) => ({ ...quantity, place: element("div", undefined, "plot"), names: element("div", undefined, "curves") }));
    this.list.replaceChildren(...parts.flatMap(({ names, place }) => [names, place]));
    for (const { title, unit, signals, names, place } of parts) {
      names.append(element("span", `${title} [${unit}]`, "title"));
      for (const signal of signals) {
        const name = element("span");
        name.append(mark(inked(signal.colour)), this.chart.signals.called(signal));
        names.append(name);
      }
      place.setAttribute("role", "img");
      place.setAttribute("aria-label", `${title}, with a band of three standard deviations of the filter`);
      const { data, ...drawing } = this.chart.columns({ signals }), limit = convergedRange(signals);
      if (limit) {
        const widest = signals.reduce((most, { bounds: [bound] }) => Math.max(most, ...bound), 0);
        names.append(element("span", `cut off: bands up to \u00b1${amount(widest, unit)}`, "run"));
      }
      plotIn(place, {
        ...drawing, padding: [6, 16, 0, 0], cursor: { show: false }, scales: { x: { time: false }, ...(limit && { y: { range: [-limit, limit] } }) },
        axes: [{ size: 18, space: 60, values: (_, times) => times.map((time) => amount(time, "s")) }, { size: 76, space: 18, values: (_, values) => values.map((value) => amount(value, unit)) }],
      }, data);
    }
  }
}

const CONVERGED = 1.5, HIDDEN = 2; // in step with viz/figures/estimates.py

// Half of the range of an axis in which the converged filter can be read; null where all of the curves are readable.
// It holds errors and bands wherever the bands are at most CONVERGED times as wide as their median over time.
export function convergedRange(signals) {
  const times = signals[0].bounds[0].length, at = (columns, i) => columns.reduce((most, column) => Math.max(most, Math.abs(column[i]) || 0), 0);
  const widths = Array.from({ length: times }, (_, i) => at(signals.map(({ bounds: [bound] }) => bound), i));
  const largest = widths.map((width, i) => Math.max(width, at(signals.map(({ values: [values] }) => values), i)));
  const usual = CONVERGED * widths.slice().sort((a, b) => a - b)[times >> 1];
  const limit = 1.1 * largest.reduce((most, value, i) => (widths[i] <= usual ? Math.max(most, value) : most), 0);
  return limit > 0 && HIDDEN * limit < largest.reduce((most, value) => Math.max(most, value), 0) ? limit : null;
}
