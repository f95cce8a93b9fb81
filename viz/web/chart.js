// Chosen signals over time, a plot for each quantity: values under the pointer, a cursor, a click goes there.
import { amount, button, digits, element, floats, mark } from "./format.js";
import { plotIn, stroked } from "./uplot_plot.js";
import { inked, strokeOf } from "./theme.js";

export class Chart {
  constructor(root, { onSeek, onRemove }) {
    this.root = root;
    this.panels = root.querySelector(".panels");
    this.axis = root.querySelector(".axis");
    this.cursor = root.querySelector(".cursor");
    this.onSeek = onSeek;
    this.onRemove = onRemove;
    this.drawn = [];
    this.duration = 1;
    // room beside the plots, px; to ask for a style takes longer than to draw a curve
    const style = getComputedStyle(root);
    this.left = parseFloat(style.getPropertyValue("--axis"));
    this.right = parseFloat(style.getPropertyValue("--edge"));
    /** @type {[number, number]} */
    this.window = [0, 1]; // the times that are seen
    for (const part of [this.panels, this.axis]) this.listen(part);
  }

  listen(part) {
    const drag = (event) => {
      if (event.buttons === 1 && this.over(event)) this.onSeek(this.timeAt(event.clientX));
    };
    part.addEventListener("pointerdown", (event) => {
      if (!this.over(event)) return;
      part.setPointerCapture(event.pointerId);
      drag(event);
    });
    part.addEventListener("pointermove", drag);
    part.addEventListener("wheel", (event) => {
      if (!this.over(event) || !event.deltaY) return;
      event.preventDefault();
      if (event.shiftKey) this.pan(Math.sign(event.deltaY) / 10);
      else this.zoom(event.deltaY < 0 ? 1.25 : 0.8, this.timeAt(event.clientX));
    }, { passive: false });
  }

  over({ target, pointerId }) {
    return target.closest(".plot, .axis") || target.hasPointerCapture?.(pointerId);
  }

  load(signals, duration) {
    const whole = this.window[1] - this.window[0] >= this.duration * 0.999;
    this.signals = signals;
    this.duration = duration;
    this.window = whole || this.window[1] > duration ? [0, duration] : this.window;
    this.choose();
  }

  // Quantiles of a quantity's signals over many samples, drawn under its curves; none if null.
  band(spread) {
    this.bands = spread && { ...spread, time: floats(spread.time), bands: floats(spread.bands) };
    if (this.signals) this.choose();
  }

  // Rows of quantiles of a signal, the lowest first; none where nothing is known.
  quantilesOf(title, name) {
    const { bands } = this, k = bands ? bands.signals.findIndex(([of, one]) => of === title && one === name) : -1, count = bands?.time.length;
    if (k < 0) return [];
    const row = (q) => bands.bands.subarray((k * bands.quantiles.length + q) * count, (k * bands.quantiles.length + q + 1) * count);
    return bands.quantiles.map((_, q) => Array.from(row(q), (value) => (Number.isFinite(value) ? value : null)));
  }

  hasBand(title) {
    return Boolean(this.bands?.signals.some(([of]) => of === title));
  }

  rangeOf({ title, signals }) {
    const [least, greatest] = this.signals.range(signals, this.window), [begin, end] = this.window;
    const rows = signals.flatMap(({ name }) => this.quantilesOf(title, name)), inside = (i) => this.bands.time[i] >= begin && this.bands.time[i] <= end;
    const seen = rows.flatMap((row) => row.filter((value, i) => value !== null && inside(i)));
    return [Math.min(least, ...seen), Math.max(greatest, ...seen)];
  }

  // Nearer (above 1) or farther, about a time; that of the cursor if none is given.
  zoom(factor, about = this.time) {
    const [begin, end] = this.window, wide = Math.min(this.duration, Math.max(this.duration / 1e4, (end - begin) / factor));
    const share = Math.min(1, Math.max(0, (about - begin) / (end - begin)));
    this.look(about - share * wide, wide);
  }

  // By a share of what is seen.
  pan(share) {
    const [begin, end] = this.window;
    this.look(begin + share * (end - begin), end - begin);
  }

  look(begin, wide) {
    const from = Math.min(this.duration - wide, Math.max(0, begin));
    this.window = [from, from + wide];
    for (const one of this.drawn) one.range = this.rangeOf(one);
    this.resize();
  }

  // The choice of signals has changed, or their values. Panels that show the same as before stay: new ones are laid out.
  choose() {
    const { shown } = this.signals, same = shown.map((quantity) => this.words(quantity)).join("\n");
    this.root.hidden = shown.length === 0;
    if (same !== this.same) {
      this.same = same;
      for (const { plot } of this.drawn) plot.destroy();
      this.times?.destroy();
      this.times = undefined;
      this.drawn = shown.map((quantity) => this.panel(quantity));
      this.panels.replaceChildren(this.cursor, ...this.drawn.map(({ panel }) => panel));
    }
    this.drawn.forEach((one, k) => {
      Object.assign(one, shown[k], { range: this.rangeOf(shown[k]) });
      const { data, series, bands } = this.columns(one);
      if (one.plot) one.plot.setData(data, false); else one.plot = this.plot(one, { series, bands }, data);
    });
    this.resize();
  }

  // All that decides what a panel is made of, but values.
  words({ title, unit, signals }) {
    const names = signals.map(({ name, colour, limits }) => [name, inked(colour), limits]);
    return JSON.stringify([title, unit, names, this.signals.runs.map(({ label, pale }) => [label, pale]), this.hasBand(title)]);
  }

  panel({ title, unit, signals }) {
    const panel = element("div", undefined, "panel"), names = element("div", undefined, "curves"), place = element("div", undefined, "plot");
    const values = [], { runs } = this.signals;
    names.append(button("×", `Remove ${title}`, () => this.onRemove(title)), element("span", `${title} [${unit}]`, "title"));
    runs.forEach(({ label }, r) => {
      if (runs.length > 1) names.append(element("span", `${label}${r ? ` (${strokeOf(r)[0]})` : ""}:`, "run"));
      for (const { name, colour } of signals) {
        const one = element("span"), value = element("b");
        one.append(mark(inked(colour)), `${name} `, value);
        values.push(value);
        names.append(one);
      }
    });
    if (this.hasBand(title)) {
      const share = this.bands.quantiles.map((q) => `${Math.round(100 * q)}`).join(", ");
      names.append(element("span", `bands: ${share} % quantiles of samples`, "run"));
    }
    panel.append(names, place);
    return { panel, place, values, plot: undefined, range: [0, 1], unit, signals, title };
  }

  // What uPlot draws: times and columns, and how. Quantiles lie under limits, these under the curves.
  columns({ title, signals }) {
    const { runs } = this.signals, series = [{}], bands = [], tables = [];
    const put = (time, columns) => tables.push([time, ...columns]);
    for (const { name, colour } of this.bands ? signals : []) {
      const rows = this.quantilesOf(title, name), first = series.length, middle = rows.length >> 1, shade = inked(colour);
      if (rows.length) put(this.bands.time, rows);
      rows.forEach((_, k) => series.push(stroked(k === middle ? `${shade}cc` : "transparent", { width: 0.8 })));
      for (let k = 0; k < middle; k++) bands.push({ series: [first + rows.length - 1 - k, first + k], fill: `${shade}2e` });
    }
    const { time: whole } = runs.reduce((last, run) => (run.time.at(-1) > last.time.at(-1) ? run : last));
    for (const { colour, limits } of signals) {
      const known = (limits || []).filter((limit) => limit !== null);
      put(whole, known.map((limit) => new Array(whole.length).fill(limit)));
      series.push(...known.map(() => stroked(inked(colour), { width: 1, dash: [2, 4] })));
    }
    runs.forEach(({ time, pale }, r) => {
      put(time, signals.map(({ values }) => (values[r]?.length === time.length ? values[r] : new Array(time.length).fill(values[r]?.[0] ?? null))));
      for (const { colour } of signals) series.push(stroked(inked(colour), { dash: strokeOf(r)[1], alpha: pale ? 0.5 : 1 }));
    });
    return { data: uPlot.join(tables), series, bands };
  }

  plot(one, drawing, data) {
    // least, zero and greatest, where they are not close to each other
    const marks = (_, __, least, greatest) => [...new Set([least, 0, greatest].filter((value) => value === 0 || Math.abs(value) > 0.25 * (greatest - least)))];
    return plotIn(one.place, {
      ...drawing, padding: [7, this.right, 7, 0], scales: { x: { time: false }, y: { auto: false } },
      axes: [{ show: false }, { size: this.left, splits: marks, values: (_, splits) => splits.map(digits) }],
      cursor: {
        sync: { key: "time" }, y: false, drag: { x: false }, points: { show: false }, bind: { dblclick: () => () => this.look(0, this.duration) },
      },
      hooks: { setCursor: [(plot) => this.hover(plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, "x") : undefined)] },
    }, data);
  }

  // Left and right end of the time axis in the window, px.
  get span() {
    const box = (this.drawn[0]?.place || this.root).getBoundingClientRect(), left = box.left + this.left;
    return [left, Math.max(left + 1, box.right - this.right)];
  }

  timeAt(x) {
    const [left, right] = this.span, [begin, end] = this.window;
    return begin + Math.min(1, Math.max(0, (x - left) / (right - left))) * (end - begin);
  }

  // The cursor and the values in the names.
  seek(time) {
    this.time = time;
    if (!this.drawn.length) return;
    const [left, right] = this.span, [begin, end] = this.window, { style } = this.cursor;
    style.visibility = time < begin || time > end ? "hidden" : "";
    style.left = `${left + ((time - begin) / (end - begin)) * (right - left) - this.panels.getBoundingClientRect().left}px`;
    style.height = `${this.panels.scrollHeight}px`;
    this.say();
  }

  hover(time) {
    this.pointed = time;
    if (this.drawn[0]?.plot) this.drawn[0].plot.root.querySelector(".u-cursor-x").dataset.time = time === undefined ? "" : `${time.toPrecision(4)} s`;
    this.say();
  }

  say() {
    const time = this.pointed ?? this.time, { runs } = this.signals;
    this.root.classList.toggle("pointed", this.pointed !== undefined);
    for (const { unit, signals, values } of this.drawn) {
      runs.forEach((_, r) => signals.forEach((signal, k) => {
        values[r * signals.length + k].textContent = amount(this.signals.value(signal, r, time), unit);
      }));
    }
  }

  // The sizes of the plots, or the times that are seen, have changed.
  resize() {
    this.cursor.style.height = "0";
    if (!this.drawn.length) return;
    const [min, max] = this.window;
    this.times ||= plotIn(this.axis, {
      series: [{}], scales: { x: { time: false }, y: { auto: false } }, padding: [0, this.right, 0, this.left], cursor: { show: false },
      axes: [{ size: 16, gap: 2, space: 60, values: (_, splits) => splits.map((time) => `${Number(time.toPrecision(6))} s`) }, { show: false }],
    }, [[0, 1]]);
    for (const { plot, place, range } of [...this.drawn, { plot: this.times, place: this.axis, range: [0, 1] }]) {
      const { clientWidth: width, clientHeight: height } = place;
      if (plot.width !== width || plot.height !== height) plot.setSize({ width, height });
      plot.setScale("x", { min, max });
      plot.setScale("y", { min: range[0], max: range[1] });
    }
    if (this.time !== undefined) this.seek(this.time);
  }
}
