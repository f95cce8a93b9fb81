// Chosen signals over time, a panel for each quantity: values under the pointer, a cursor, a click goes there.
import { amount, button, digits, element, floats, mark, niceStep } from "./format.js";
import { inked, strokeOf, themed } from "./theme.js";

export class Chart {
  constructor(root, { onSeek, onRemove }) {
    this.root = root;
    this.panels = root.querySelector(".panels");
    this.axis = root.querySelector(".axis");
    this.cursor = root.querySelector(".cursor");
    this.pointer = root.querySelector(".pointer");
    this.onSeek = onSeek;
    this.onRemove = onRemove;
    this.drawn = [];
    this.duration = 1;
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
    part.addEventListener("pointermove", (event) => {
      drag(event);
      this.hover(this.over(event) && event.pointerType !== "touch" ? this.timeAt(event.clientX) : undefined);
    });
    part.addEventListener("pointerleave", () => this.hover(undefined));
    part.addEventListener("wheel", (event) => {
      if (!this.over(event) || !event.deltaY) return;
      event.preventDefault();
      if (event.shiftKey) this.pan(Math.sign(event.deltaY) / 10);
      else this.zoom(event.deltaY < 0 ? 1.25 : 0.8, this.timeAt(event.clientX));
    }, { passive: false });
  }

  over(event) {
    return event.target.tagName === "CANVAS" || event.target.hasPointerCapture?.(event.pointerId);
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
    return bands.quantiles.map((_, q) => bands.bands.subarray((k * bands.quantiles.length + q) * count, (k * bands.quantiles.length + q + 1) * count));
  }

  hasBand(title) {
    return Boolean(this.bands?.signals.some(([of]) => of === title));
  }

  rangeOf({ title, signals }) {
    const [least, greatest] = this.signals.range(signals, this.window), [begin, end] = this.window;
    const ends = signals.flatMap(({ name }) => { const rows = this.quantilesOf(title, name); return rows.length ? [rows[0], rows.at(-1)] : []; });
    const seen = ends.flatMap((row) => [...row].filter((value, i) => Number.isFinite(value) && this.bands.time[i] >= begin && this.bands.time[i] <= end));
    return [seen.reduce((low, value) => Math.min(low, value), least), seen.reduce((high, value) => Math.max(high, value), greatest)];
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

  // The choice of signals has changed, or their values. Panels that say the same as before stay: new ones are laid out anew.
  choose() {
    const { runs, shown } = this.signals, said = shown.map((quantity) => this.words(quantity));
    if (said.join("\n") !== this.said) {
      this.said = said.join("\n");
      this.made = shown.map((quantity) => this.panel(quantity));
      this.panels.replaceChildren(this.cursor, this.pointer, ...this.made.map(({ panel }) => panel));
    }
    this.drawn = shown.map((quantity, k) => {
      const { panel, canvas, places } = this.made[k], own = runs.flatMap((_, r) => quantity.signals.map((signal) => [signal, r]));
      return { ...quantity, panel, canvas, values: own.map((one, i) => [places[i], ...one]), range: this.rangeOf(quantity) };
    });
    this.root.hidden = this.drawn.length === 0;
    this.resize();
  }

  // All that a panel says but values.
  words({ title, unit, signals }) {
    const names = signals.map(({ name, colour }) => [name, inked(colour)]);
    return JSON.stringify([title, unit, names, this.signals.runs.map(({ label }) => label), this.hasBand(title)]);
  }

  panel({ title, unit, signals }) {
    const panel = element("div", undefined, "panel"), names = element("div", undefined, "curves"), canvas = element("canvas");
    const places = [], { runs } = this.signals;
    names.append(button("×", `Remove ${title}`, () => this.onRemove(title)), element("span", `${title} [${unit}]`, "title"));
    runs.forEach(({ label }, r) => {
      if (runs.length > 1) names.append(element("span", `${label}${r ? ` (${strokeOf(r)[0]})` : ""}:`, "run"));
      for (const { name, colour } of signals) {
        const one = element("span"), value = element("b");
        one.append(mark(inked(colour)), `${name} `, value);
        places.push(value);
        names.append(one);
      }
    });
    if (this.hasBand(title)) {
      const share = this.bands.quantiles.map((q) => `${Math.round(100 * q)}`).join(", ");
      names.append(element("span", `bands: ${share} % of samples`, "run"));
    }
    panel.append(names, canvas);
    return { panel, canvas, places };
  }

  // Left and right end of the time axis in the window, px.
  get span() {
    const first = this.drawn[0]?.canvas, style = getComputedStyle(this.root);
    const box = (first || this.root).getBoundingClientRect();
    const left = parseFloat(style.getPropertyValue("--axis")), right = parseFloat(style.getPropertyValue("--edge"));
    return [box.left + left, Math.max(box.left + left + 1, box.right - right)];
  }

  timeAt(x) {
    const [left, right] = this.span;
    const [begin, end] = this.window;
    return begin + Math.min(1, Math.max(0, (x - left) / (right - left))) * (end - begin);
  }

  xAt(time) {
    return this.xOf(time, ...this.span);
  }

  // The cursor and the values in the names.
  seek(time) {
    this.time = time;
    if (!this.drawn.length) return;
    this.place(this.cursor, time);
    this.say();
  }

  hover(time) {
    this.pointed = time;
    this.pointer.hidden = time === undefined;
    if (time !== undefined) {
      this.place(this.pointer, time);
      this.pointer.dataset.time = `${time.toPrecision(4)} s`;
    }
    this.say();
  }

  say() {
    const time = this.pointed ?? this.time;
    this.root.classList.toggle("pointed", this.pointed !== undefined);
    for (const { unit, values } of this.drawn) {
      for (const [value, signal, r] of values) value.textContent = amount(this.signals.value(signal, r, time), unit);
    }
  }

  place(line, time) {
    line.style.visibility = time < this.window[0] || time > this.window[1] ? "hidden" : "";
    line.style.left = `${this.xAt(time) - this.panels.getBoundingClientRect().left}px`;
    line.style.height = `${this.panels.scrollHeight}px`;
  }

  resize() {
    for (const line of [this.cursor, this.pointer]) line.style.height = "0";
    for (const one of this.drawn) this.curves(one);
    this.times();
    if (this.time !== undefined) this.seek(this.time);
  }

  pen(canvas) {
    const box = canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
    const pen = canvas.getContext("2d"), size = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    else pen.reset();
    pen.scale(ratio, ratio);
    pen.translate(-box.left, 0);
    pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    pen.fillStyle = themed("--dim");
    return pen;
  }

  curves({ canvas, title, signals, range: [least, greatest] }) {
    const height = canvas.clientHeight, top = 7, bottom = height - 7, [left, right] = this.span;
    if (right - left < 20 || !height) return;
    const pen = this.pen(canvas);
    const y = (value) => {
      const share = (value - least) / (greatest - least);
      return bottom - Math.min(1.1, Math.max(-0.1, share)) * (bottom - top);
    };
    this.levels(pen, [least, greatest], y);
    pen.save();
    pen.beginPath();
    pen.rect(left, 0, right - left, height);
    pen.clip();
    for (const signal of signals) {
      this.limits(pen, signal, [least, greatest], y);
      this.shade(pen, this.quantilesOf(title, signal.name), signal.colour, y);
    }
    signals.forEach((signal) => signal.values.forEach((values, r) => {
      if (!values) return;
      const { time } = this.signals.runs[r], perSecond = (right - left) / (this.window[1] - this.window[0]), origin = left - this.window[0] * perSecond;
      pen.strokeStyle = inked(signal.colour);
      pen.lineWidth = 1.5;
      pen.setLineDash(strokeOf(r)[1]);
      pen.globalAlpha = this.signals.runs[r].pale ? 0.5 : 1;
      pen.beginPath();
      for (let i = 0; i < time.length; i++) pen.lineTo(origin + time[i] * perSecond, y(values[Math.min(i, values.length - 1)]));
      pen.stroke();
    }));
    pen.restore();
  }

  // Between the outermost two quantiles pale, between the next less so; the middle one thin.
  shade(pen, rows, colour, y) {
    if (!rows.length) return;
    const [left, right] = this.span, { time } = this.bands, middle = rows.length >> 1;
    const points = (row, order) => { for (const i of order) pen.lineTo(this.xOf(time[i], left, right), y(row[i])); };
    const forth = [...time.keys()], back = [...forth].reverse();
    pen.fillStyle = pen.strokeStyle = inked(colour);
    for (let k = 0; k < middle; k++) {
      pen.globalAlpha = 0.18;
      pen.beginPath();
      points(rows[k], forth);
      points(rows[rows.length - 1 - k], back);
      pen.fill();
    }
    [pen.globalAlpha, pen.lineWidth] = [0.8, 0.8];
    pen.setLineDash([]);
    pen.beginPath();
    points(rows[middle], forth);
    pen.stroke();
    pen.globalAlpha = 1;
  }

  xOf(time, left, right) {
    const [begin, end] = this.window;
    return left + ((time - begin) / (end - begin)) * (right - left);
  }

  // Where a signal may not go, dashed in its colour.
  limits(pen, { colour, limits }, [least, greatest], y) {
    const [left, right] = this.span;
    for (const limit of limits || []) {
      if (limit === null || limit < least || limit > greatest) continue;
      pen.strokeStyle = inked(colour);
      pen.setLineDash([2, 4]);
      pen.beginPath();
      pen.moveTo(left, y(limit));
      pen.lineTo(right, y(limit));
      pen.stroke();
    }
    pen.setLineDash([]);
  }

  levels(pen, [least, greatest], y) {
    const [left, right] = this.span, small = 0.25 * (greatest - least);
    pen.strokeStyle = themed("--line");
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const marks = [least, 0, greatest].filter((value) => value === 0 || Math.abs(value) > small);
    for (const value of new Set(marks)) {
      pen.beginPath();
      pen.moveTo(left, y(value));
      pen.lineTo(right, y(value));
      pen.stroke();
      pen.fillText(digits(value), left - 5, y(value));
    }
  }

  times() {
    if (!this.drawn.length) return;
    const pen = this.pen(this.axis), [left, right] = this.span;
    const [begin, end] = this.window, step = niceStep((end - begin) / Math.min(10, Math.max(2, (right - left) / 60)));
    pen.textBaseline = "top";
    for (let k = Math.ceil(begin / step - 1e-6); k * step <= end + 1e-6 * step; k++) {
      const share = (k * step - begin) / (end - begin);
      pen.textAlign = share < 0.03 ? "left" : share > 0.97 ? "right" : "center";
      pen.fillText(`${Number((k * step).toPrecision(6))} s`, this.xAt(k * step), 2);
    }
  }
}
