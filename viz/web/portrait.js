// A phase portrait: one signal over another, for all runs, with a dot where time stands.
import { digits, options } from "./format.js";
import { strokeOf } from "./theme.js";

export class Portrait {
  constructor(figure, opener, onChange) {
    this.figure = figure;
    this.opener = opener;
    this.onChange = onChange;
    this.canvas = figure.querySelector("canvas");
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
    this.draw();
  }

  // "title: name|title: name", empty while it is closed.
  get text() { return this.figure.hidden ? "" : `${this.across.value}|${this.up.value}`; }

  set text(text) {
    [this.across, this.up].forEach((select, k) => { select.value = text.split("|")[k] ?? ""; });
    this.figure.hidden = !(this.across.value && this.up.value);
    this.opener.setAttribute("aria-pressed", String(!this.figure.hidden));
    this.draw();
  }

  draw() {
    if (this.figure.hidden || !this.choices) return; // before a size is asked for, which lays the page out
    const size = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (size[0] < 40) return;
    const chosen = [this.across, this.up].map(({ value }) => this.choices.find(({ text }) => text === value));
    if (chosen.includes(undefined)) return;
    const ratio = window.devicePixelRatio || 1, pen = this.canvas.getContext("2d");
    [this.canvas.width, this.canvas.height] = size.map((length) => Math.round(length * ratio));
    pen.scale(ratio, ratio);
    const ranges = chosen.map(({ signal }) => this.span(signal)), edges = [[44, size[0] - 8], [size[1] - 30, 8]];
    const places = ranges.map(([least, most], k) => (value) => edges[k][0] + ((value - least) / (most - least)) * (edges[k][1] - edges[k][0]));
    this.axes(pen, chosen, ranges, edges);
    this.signals.runs.forEach((run, r) => this.curve(pen, run, r, chosen, places));
  }

  span({ values }) {
    const all = values.filter(Boolean).flatMap((own) => [...own]).filter(Number.isFinite);
    const least = all.reduce((a, b) => Math.min(a, b), Infinity), most = all.reduce((a, b) => Math.max(a, b), -Infinity);
    return most - least > 1e-12 ? [least, most] : [least - 1, most + 1];
  }

  axes(pen, chosen, ranges, edges) {
    const [[left, right], [low, high]] = ranges, [[x0, x1], [y0, y1]] = edges;
    pen.strokeStyle = "#5b6c7e";
    pen.strokeRect(x0, y1, x1 - x0, y0 - y1);
    pen.fillStyle = "#e8edf3";
    pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    const say = (text, x, y, align) => { pen.textAlign = align; pen.fillText(text, x, y); };
    say(digits(left), x0, y0 + 12, "left");
    say(`${digits(right)} ${chosen[0].unit}`, x1, y0 + 12, "right");
    say(digits(low), x0 - 3, y0, "right");
    say(digits(high), x0 - 3, y1 + 9, "right");
    say(chosen[1].unit, x0 - 3, y1 + 22, "right");
  }

  curve(pen, { time, pale }, r, chosen, places) {
    const [x, y] = places;
    const [a, b] = chosen.map(({ signal }) => signal.values[r]);
    if (!a || !b) return;
    pen.globalAlpha = pale ? 0.5 : 1;
    pen.setLineDash(strokeOf(r)[1]);
    pen.strokeStyle = pen.fillStyle = chosen[1].signal.colour; // its ground is dark in either scheme
    pen.lineWidth = 1.5;
    pen.beginPath();
    for (let i = 0; i < time.length; i++) pen.lineTo(x(a[Math.min(i, a.length - 1)]), y(b[Math.min(i, b.length - 1)]));
    pen.stroke();
    const here = chosen.map(({ signal }) => this.signals.value(signal, r, this.time || 0));
    pen.beginPath();
    pen.arc(x(here[0]), y(here[1]), 4, 0, 2 * Math.PI);
    pen.fill();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }
}
