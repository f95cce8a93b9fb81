// A phase portrait: one signal over another, for all runs, with a dot where time stands.
import { digits, options } from "./format.js";
import { plotIn, stroked } from "./uplot_plot.js";
import { strokeOf } from "./theme.js";

export class Portrait {
  constructor(figure, opener, onChange) {
    this.figure = figure;
    this.opener = opener;
    this.onChange = onChange;
    this.place = figure.querySelector(".plot");
    this.across = figure.querySelector(".across");
    this.up = figure.querySelector(".up");
    for (const select of [this.across, this.up]) select.addEventListener("change", () => { this.draw(); onChange(); });
    opener.addEventListener("click", () => this.open(figure.hidden));
    figure.querySelector(".close").addEventListener("click", () => this.open(false));
    figure.addEventListener("keydown", (event) => { if (event.key === "Escape") this.open(false); });
  }

  open(wanted) {
    this.figure.hidden = !wanted;
    this.opener.setAttribute("aria-pressed", String(wanted));
    (wanted ? this.across : this.opener).focus();
    this.draw();
    this.onChange();
  }

  load(signals) {
    this.signals = signals;
    this.choices = signals.quantities.flatMap(({ title, unit, signals: own }) => own.map((signal) => ({ title, unit, signal, text: `${title}: ${signal.name}` })));
    this.opener.disabled = this.choices.length < 2;
    const kept = [this.across.value, this.up.value], texts = this.choices.map(({ text }) => text);
    if (texts.join() !== this.texts) for (const select of [this.across, this.up]) options(select, texts.map((text) => [text, text]));
    this.texts = texts.join();
    [this.across, this.up].forEach((select, k) => { select.value = texts.includes(kept[k]) ? kept[k] : texts[Math.min(k, texts.length - 1)] ?? ""; });
    this.draw();
  }

  seek(time) {
    this.time = time;
    if (!this.figure.hidden) this.plot?.redraw(false, false);
  }

  // "title: name|title: name", empty while it is closed.
  get text() { return this.figure.hidden ? "" : `${this.across.value}|${this.up.value}`; }

  set text(text) {
    [this.across, this.up].forEach((select, k) => { select.value = text.split("|")[k] ?? ""; });
    this.figure.hidden = !(this.across.value && this.up.value);
    this.opener.setAttribute("aria-pressed", String(!this.figure.hidden));
    this.draw();
  }

  // Each run is a curve with its own values across, which may go back; its dot is drawn anew as time goes on.
  draw() {
    this.plot?.destroy();
    this.plot = undefined;
    if (this.figure.hidden || !this.choices || this.place.clientWidth < 40) return;
    const chosen = [this.across, this.up].map(({ value }) => this.choices.find(({ text }) => text === value));
    if (chosen.includes(undefined)) return;
    const { runs } = this.signals, [x, y] = chosen, there = [...runs.keys()].filter((r) => x.signal.values[r] && y.signal.values[r]);
    const whole = (values, { time }) => (values.length === time.length ? values : new Array(time.length).fill(values[0]));
    const data = there.map((r) => chosen.map(({ signal }) => whole(signal.values[r], runs[r])));
    const colour = y.signal.colour, facets = ["x", "y"].map((scale) => ({ scale, auto: true })); // its ground is dark in either scheme
    const paths = (plot, k) => uPlot.orient(plot, k, (_, across, up, sx, sy, toX, toY, left, top, width, height) => {
      const stroke = new Path2D();
      for (let i = 0; i < across.length; i++) stroke.lineTo(toX(across[i], sx, width, left), toY(up[i], sy, height, top));
      return { stroke };
    });
    const dots = ({ ctx: pen, valToPos }) => there.forEach((r) => {
      const [a, b] = chosen.map(({ signal }) => this.signals.value(signal, r, this.time || 0));
      pen.fillStyle = colour;
      pen.beginPath();
      pen.arc(valToPos(a, "x", true), valToPos(b, "y", true), 4 * devicePixelRatio, 0, 2 * Math.PI);
      pen.fill();
    });
    this.plot = plotIn(this.place, {
      mode: 2, scales: { x: { time: false, range: this.span(x.signal) }, y: { range: this.span(y.signal) } }, padding: [8, 8, 0, 0], cursor: { show: false }, hooks: { draw: [dots] },
      series: [{}, ...there.map((r) => stroked(colour, { facets, paths, dash: strokeOf(r)[1], alpha: runs[r].pale ? 0.5 : 1 }))],
      axes: chosen.map(({ unit }, k) => ({ label: unit, labelSize: 14, size: [20, 44][k], space: [50, 25][k], values: (_, splits) => splits.map(digits) })),
    }, /** @type {any} */ ([null, ...data]));
  }

  /** @returns {[number, number]} */
  span({ values }) {
    const all = values.filter(Boolean).flatMap((own) => [...own]).filter(Number.isFinite);
    const least = all.reduce((a, b) => Math.min(a, b), Infinity), most = all.reduce((a, b) => Math.max(a, b), -Infinity);
    return most - least > 1e-12 ? [least, most] : [least - 1, most + 1];
  }
}
