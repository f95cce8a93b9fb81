// The curves that are seen, as files: a table (CSV) or a picture (PNG).
import { element } from "./format.js";
import { inked, strokeOf, themed } from "./theme.js";

export function curvesTable({ signals, window: [begin, end] }) {
  const columns = signals.runs.flatMap(({ label, time }, r) => {
    const rows = [...time.keys()].filter((i) => time[i] >= begin && time[i] <= end), who = signals.runs.length > 1 ? `${label}: ` : "";
    const shown = signals.shown.flatMap(({ unit, signals: own }) => own.filter(({ values }) => values[r]).map(({ title: of, name, values }) => (
      [`${who}${of} ${name} [${unit}]`, rows.map((i) => values[r][Math.min(i, values[r].length - 1)])]
    )));
    return [[`${who}time [s]`, rows.map((i) => time[i])], ...shown];
  });
  const quoted = (text) => `"${text.replace(/"/g, '""')}"`, most = Math.max(0, ...columns.map(([, values]) => values.length));
  const lines = [columns.map(([name]) => quoted(name)).join(",")];
  for (let i = 0; i < most; i++) lines.push(columns.map(([, values]) => (i < values.length ? Number(values[i].toPrecision(7)) : "")).join(","));
  return `${lines.join("\n")}\n`;
}

// Names above each panel, and the axis of time below the last.
export function curvesPicture({ drawn, times, signals }) {
  const ratio = window.devicePixelRatio || 1, line = 18, parts = drawn.map(({ plot }) => plot.height + line);
  const canvas = element("canvas"), { width } = times, height = parts.reduce((sum, part) => sum + part, 0) + times.height;
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.fillStyle = themed("--bar");
  pen.fillRect(0, 0, width, height);
  pen.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  let top = 0;
  drawn.forEach((one, k) => {
    let left = 8;
    const say = (text, colour) => { pen.fillStyle = colour; pen.fillText(text, left, top + 13); left += pen.measureText(text).width + 12; };
    say(`${one.title} [${one.unit}]`, themed("--ink"));
    for (const signal of one.signals) say(`— ${signals.called(signal)}`, inked(signal.colour));
    signals.runs.forEach(({ label }, r) => { if (r) say(`${strokeOf(r)[0]}: ${label}`, themed("--dim")); });
    pen.drawImage(one.plot.ctx.canvas, 0, top + line, one.plot.width, one.plot.height);
    top += parts[k];
  });
  pen.drawImage(times.ctx.canvas, 0, top, width, times.height);
  return canvas.toDataURL("image/png");
}
