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
      const { data, ...drawing } = this.chart.columns({ signals });
      plotIn(place, {
        ...drawing, padding: [6, 16, 0, 0], cursor: { show: false }, scales: { x: { time: false } },
        axes: [{ size: 18, space: 60, values: (_, times) => times.map((time) => amount(time, "s")) }, { size: 76, space: 18, values: (_, values) => values.map((value) => amount(value, unit)) }],
      }, data);
    }
  }
}
