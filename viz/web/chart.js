// Chosen signals over time, in panels with one axis of time: values under the pointer, a cursor, a click goes there.
import { EVENT_COLOURS, PHASE_COLOURS } from "./events.js";
import { amount, button, digits, element, floats, mark } from "./format.js";
import { divider } from "./divider.js";
import { plotIn, stroked } from "./uplot_plot.js";
import { inked, isLight, strokeOf } from "./theme.js";

const DECADES = 6; // that a logarithmic panel shows at most
const SIGNAL = "application/x-spacerobot-signal";
const ROOM = 18; // px, between two ticks of values
const NEAR = 6; // px, from which on the pointer is at an event

// Makes that an element can be dragged into a panel as a signal.
export function draggable(made, { title, name }) {
  made.draggable = true;
  made.addEventListener("dragstart", (event) => event.dataTransfer.setData(SIGNAL, JSON.stringify([title, name])));
  return made;
}

// Whether the first run has bounds of a signal.
export function isBounded({ bounds }) {
  return Boolean(bounds[0]);
}

export class Chart {
  // ``onSeek`` hears of times, ``onChange`` of another choice of signals.
  constructor(root, { onSeek, onChange }) {
    this.root = root;
    this.panels = root.querySelector(".panels");
    this.axis = root.querySelector(".axis");
    this.cursor = root.querySelector(".cursor");
    this.onSeek = onSeek;
    this.onChange = onChange;
    this.marked = { phases: [], marks: [] };
    this.drawn = [];
    this.duration = 1;
    // room beside the plots, px; to ask for a style takes longer than to draw a curve
    const style = getComputedStyle(root);
    this.left = parseFloat(style.getPropertyValue("--axis"));
    this.right = parseFloat(style.getPropertyValue("--edge"));
    /** @type {[number, number]} */
    this.window = [0, 1]; // the times that are seen
    for (const part of [this.panels, this.axis]) this.listen(part);
    this.accept(this.axis);
    root.prepend(divider("Height of the curves", { up: true, height: () => this.panels.clientHeight, onHeight: (height) => this.stretch(height) }));
  }

  // All panels higher or lower alike, whatever was the highest that the page gives them by itself.
  stretch(height) {
    const { clientHeight, scrollHeight } = this.panels;
    this.panels.style.maxHeight = `${height}px`;
    if (height > clientHeight && scrollHeight > clientHeight) { this.resize(); return; } // first what is hidden comes in sight
    const sum = this.drawn.reduce((whole, { place }) => whole + place.clientHeight, 0), factor = Math.max(0.1, (sum + height - clientHeight) / sum);
    for (const { panel, place } of this.drawn) this.tall(panel, place.clientHeight * factor, place);
    this.resize();
  }

  tall(panel, height, place) {
    panel.height = Math.max(28, height);
    place.style.flex = "none";
    place.style.height = `${panel.height}px`;
  }

  // What a signal can be dropped on: a panel, or the axis for a new one.
  accept(part, one) {
    const over = (yes) => () => part.classList.toggle("over", yes);
    part.addEventListener("dragover", (event) => { if (event.dataTransfer.types.includes(SIGNAL)) { event.preventDefault(); over(true)(); } });
    part.addEventListener("dragleave", over(false));
    part.addEventListener("drop", (event) => {
      over(false)();
      const dropped = event.dataTransfer.getData(SIGNAL);
      if (!dropped) return;
      event.preventDefault();
      const [title, name] = JSON.parse(dropped);
      this.signals.move(title, name, one?.panel);
      this.onChange();
    });
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

  // ``marked``: phases and events, as the page's data has them.
  load(signals, duration, marked) {
    this.marked = marked || { phases: [], marks: [] };
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
  quantilesOf({ title, name }) {
    const { bands } = this, k = bands ? bands.signals.findIndex(([of, one]) => of === title && one === name) : -1, count = bands?.time.length;
    if (k < 0) return [];
    const row = (q) => bands.bands.subarray((k * bands.quantiles.length + q) * count, (k * bands.quantiles.length + q + 1) * count);
    return bands.quantiles.map((_, q) => Array.from(row(q), (value) => (Number.isFinite(value) ? value : null)));
  }

  // Least and greatest value that is seen, and how: uPlot gives those of the curves in the window.
  /** @returns {[number, number]} */
  spanOf({ panel, signals }, least, greatest) {
    const limits = signals.flatMap((signal) => (signal.limits || []).filter((limit) => limit !== null)), own = [least, greatest];
    if (!Number.isFinite(least)) return [0, 1];
    for (const limit of limits) { // those that are not far, or all
      if (panel.limits || (limit > own[1] && limit < 2 * own[1]) || (limit < own[0] && limit > 2 * own[0])) [least, greatest] = [Math.min(least, limit), Math.max(greatest, limit)];
    }
    if (panel.log) {
      const top = Math.max(greatest, 1e-12);
      return /** @type {[number, number]} */ (uPlot.rangeLog(Math.max(least, top / 10 ** DECADES), top, 10, false));
    }
    const size = greatest - least;
    if (least > 0 && least <= size) least = 0; // a zero that is near is in sight
    if (greatest < 0 && -greatest <= size) greatest = 0;
    const room = 0.04 * (greatest - least) || Math.abs(greatest) / 10 || 1e-3;
    return [least && least - room, greatest && greatest + room];
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
    this.resize();
  }

  // The choice of signals has changed, or their values. Panels that show the same as before stay: new ones are laid out.
  choose() {
    const { shown } = this.signals, same = shown.map((one) => this.words(one)).join("\n");
    this.root.hidden = shown.length === 0;
    if (same !== this.same) {
      this.same = same;
      for (const { plot } of this.drawn) plot.destroy();
      this.times?.destroy();
      this.times = undefined;
      this.drawn = shown.map((one) => this.panel(one));
      this.panels.replaceChildren(this.cursor, ...this.drawn.map(({ whole }) => whole));
    }
    this.drawn.forEach((one, k) => {
      shown[k].panel.height ??= one.panel.height;
      Object.assign(one, shown[k]);
      const { data, series, bands } = this.columns(one);
      if (one.plot) one.plot.setData(data, false); else one.plot = this.plot(one, { series, bands }, data);
    });
    this.resize();
  }

  // All that decides what a panel is made of, but values.
  words({ panel, title, unit, signals }) {
    const names = signals.map(({ title: of, name, colour, limits }) => [of, name, inked(colour), limits]);
    const { runs } = this.signals;
    return JSON.stringify([title, unit, names, panel.log, panel.limits, this.signals.full, runs.map(({ label, pale, completed }) => [label, pale, completed]), signals.some((one) => this.quantilesOf(one).length), signals.some(isBounded)]);
  }

  panel({ panel, title, unit, signals, mixed }) {
    const whole = element("div", undefined, "panel"), names = element("div", undefined, "curves"), place = element("div", undefined, "plot");
    const values = [], { runs } = this.signals, change = (act) => () => { act(); this.onChange(); };
    const one = { panel, whole, place, values, plot: undefined, unit, signals, title, mixed }; // its panel may become another one that shows the same
    names.append(button("×", `Remove ${title}`, change(() => this.signals.remove(one.panel))));
    const toggle = (flag, label) => {
      const made = button(flag, `${label} of ${title}`, change(() => { one.panel[flag] = !one.panel[flag]; }));
      made.setAttribute("aria-pressed", String(Boolean(panel[flag])));
      names.append(made);
    };
    toggle("log", "Logarithmic scale");
    const limited = signals.some(({ limits }) => limits?.some((limit) => limit !== null));
    if (limited) toggle("limits", "Show all limits");
    if (!mixed) names.append(element("span", `${title} [${unit}]`, "title"));
    runs.forEach(({ label }, r) => {
      if (runs.length > 1) names.append(element("span", `${label}${r ? ` (${strokeOf(r)[0]})` : ""}:`, "run"));
      for (const signal of signals) {
        const made = draggable(element("span"), signal), value = element("b");
        made.title = `${signal.title}: ${signal.name}; drag it into another panel`;
        made.append(mark(inked(signal.colour)), `${mixed ? `${signal.title} ` : ""}${this.signals.called(signal)} `, value);
        values.push(value);
        names.append(made);
      }
    });
    if (limited) names.append(element("span", "dotted: limits", "run"));
    if (signals.some((each) => this.quantilesOf(each).length)) {
      const share = this.bands.quantiles.map((q) => `${Math.round(100 * q)}`).join(", ");
      names.append(element("span", `bands: ${share} % quantiles of samples`, "run"));
    }
    if (signals.some(isBounded)) names.append(element("span", "band: \u00b13 standard deviations of the filter", "run"));
    const height = () => place.clientHeight, onHeight = (wanted) => { this.tall(one.panel, wanted, place); this.resize(); };
    whole.append(names, place, divider(`Height of ${title}`, { height, onHeight }));
    if (panel.height) this.tall(panel, panel.height, place);
    this.accept(whole, one);
    return one;
  }

  // What uPlot draws: times and columns, and how. Quantiles lie under limits, these under the curves.
  columns({ signals }) {
    const { runs } = this.signals, series = [{}], bands = [], tables = [];
    const put = (time, columns) => tables.push([time, ...columns]);
    for (const signal of this.bands ? signals : []) {
      const rows = this.quantilesOf(signal), first = series.length, middle = rows.length >> 1, shade = inked(signal.colour);
      if (rows.length) put(this.bands.time, rows);
      rows.forEach((_, k) => series.push(stroked(k === middle ? `${shade}cc` : "transparent", { width: 0.8 })));
      for (let k = 0; k < middle; k++) bands.push({ series: [first + rows.length - 1 - k, first + k], fill: `${shade}2e` });
    }
    for (const { bounds: [bound], colour } of signals.filter(isBounded)) { // of the first run, under its curve
      const first = series.length, edge = `${inked(colour)}66`;
      put(runs[0].time, [1, -1].map((sign) => Array.from(bound, (value) => sign * value)));
      series.push(...[0, 1].map(() => stroked(edge, { width: 0.8, auto: runs[0].completed })));
      bands.push({ series: [first, first + 1], fill: `${inked(colour)}22` });
    }
    const { time: whole } = runs.reduce((last, run) => (run.time.at(-1) > last.time.at(-1) ? run : last));
    for (const { colour, limits } of signals) {
      const known = (limits || []).filter((limit) => limit !== null);
      put(whole, known.map((limit) => new Array(whole.length).fill(limit)));
      series.push(...known.map(() => stroked(inked(colour), { width: 1, dash: [2, 4], auto: false })));
    }
    runs.forEach(({ time, pale, completed }, r) => {
      const rows = signals.map(({ values }) => (values[r]?.length === time.length ? values[r] : new Array(time.length).fill(values[r]?.[0] ?? null)));
      put(time, rows);
      for (const { colour } of signals) series.push(stroked(inked(colour), { dash: strokeOf(r)[1], alpha: pale ? 0.5 : 1, auto: completed }));
      if (completed) return;
      // a diverged run's last instants would hide all before: an unseen copy without them sets the scale
      put(time, rows.map((row) => [...row].fill(null, Math.max(2, 0.8 * row.length))));
      series.push(...rows.map(() => stroked("transparent")));
    });
    return { data: uPlot.join(tables), series, bands };
  }

  plot(one, drawing, data) {
    const { unit, panel } = one;
    // numbers in as many digits as tell two ticks apart
    const words = (_, splits, __, ___, step) => splits.map((value) => {
      if (value === null || value === undefined) return "";
      const most = Math.max(...splits.map(Math.abs)), places = panel.log || !(step > 0) ? 3 : Math.min(15, Math.max(1, Math.ceil(Math.log10(most / step)) + 2));
      const rounded = (tick) => Number((tick ?? 0).toPrecision(places)), long = most < 1e-2 && splits.some((tick) => String(rounded(tick)).length > 6); // wider than the axis
      return `${Math.abs(value) >= 1e5 || (value && Math.abs(value) < 1e-4) ? digits(value) : value && long ? rounded(value).toExponential() : rounded(value)} ${unit}`;
    });
    // of a logarithmic scale the powers of ten, as many as have room
    const powers = (plot, splits) => {
      const every = Math.ceil((ROOM * Math.log10(plot.scales.y.max / plot.scales.y.min)) / (plot.bbox.height / devicePixelRatio)), power = (value) => Math.log10(value);
      return splits.map((value) => (value > 0 && Math.abs(power(value) - Math.round(power(value))) < 1e-9 && Math.round(power(value)) % every === 0 ? value : null));
    };
    return plotIn(one.place, {
      ...drawing, padding: [7, this.right, 7, 0],
      scales: { x: { time: false }, y: { distr: panel.log ? 3 : 1, range: (_, least, greatest) => this.spanOf(one, least, greatest) } },
      axes: [{ space: 60, size: 0, values: () => [] }, { size: this.left, space: ROOM, values: words, ...(panel.log ? { filter: powers, grid: { filter: powers } } : {}) }],
      cursor: {
        sync: { key: "time" }, y: false, drag: { x: false }, points: { show: false }, bind: { dblclick: () => () => this.look(0, this.duration) },
      },
      hooks: {
        drawClear: [(plot) => this.ground(plot)], drawAxes: [(plot) => this.flags(plot)],
        setCursor: [(plot) => this.hover(plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, "x") : undefined)],
      },
    }, data);
  }

  // Phases as stripes behind the curves.
  ground({ ctx: pen, bbox: { left, top, width, height }, valToPos }) {
    const at = (time) => Math.min(left + width, Math.max(left, valToPos(time, "x", true)));
    this.marked.phases.forEach(([, begin, end], k) => {
      pen.fillStyle = `${PHASE_COLOURS[k % 2]}${isLight() ? "1f" : "4d"}`;
      pen.fillRect(at(begin), top, at(end) - at(begin), height);
    });
  }

  // Events as lines.
  flags({ ctx: pen, bbox: { top, height }, valToPos }) {
    const [begin, end] = this.window;
    for (const [time, , kind] of this.marked.marks.filter(([at]) => at >= begin && at <= end)) {
      pen.fillStyle = inked(EVENT_COLOURS[kind] || EVENT_COLOURS.other);
      pen.fillRect(valToPos(time, "x", true), top, devicePixelRatio, height);
    }
  }

  // Whether there are curves, and room for them.
  get seen() { return this.drawn.length > 0 && this.root.offsetWidth > 0; }

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
    if (this.drawn[0]?.plot) this.drawn[0].plot.root.querySelector(".u-cursor-x").dataset.time = time === undefined ? "" : this.moment(time);
    this.say();
  }

  // A time in words, with its phase and the event that is near.
  moment(time) {
    const { phases, marks } = this.marked, [left, right] = this.span, near = (NEAR * (this.window[1] - this.window[0])) / (right - left);
    const phase = phases.findLast(([, begin]) => begin <= time)?.[0], event = marks.find(([at]) => Math.abs(at - time) <= near)?.[1];
    return [`${time.toPrecision(4)} s`, event || phase].filter(Boolean).join(", ");
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
    if (!this.seen) return;
    const [min, max] = this.window;
    this.times ||= plotIn(this.axis, {
      series: [{}], scales: { x: { time: false } }, padding: [0, this.right, 0, this.left], cursor: { show: false },
      axes: [{ size: 16, gap: 2, space: 60, values: (_, splits) => splits.map((time) => `${Number(time.toPrecision(6))} s`) }, { show: false }],
    }, [[0, 1]]);
    for (const { plot, place } of [...this.drawn, { plot: this.times, place: this.axis }]) {
      const { clientWidth: width, clientHeight: height } = place;
      if (plot.width !== width || plot.height !== height) plot.setSize({ width, height });
      plot.setScale("x", { min, max });
    }
    if (this.time !== undefined) this.seek(this.time);
  }
}
