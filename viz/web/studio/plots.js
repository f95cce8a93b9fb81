// Small plots of the panel: best value over rollouts, and how a metric is distributed.
import { amount } from "../format.js";

function plotPen(canvas) {
  const ratio = window.devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas, style = getComputedStyle(canvas);
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
  pen.fillStyle = style.getPropertyValue("--dim");
  pen.strokeStyle = style.getPropertyValue("--accent");
  pen.lineWidth = 1.5;
  return { pen, left: 6, right: width - 6, top: 16, bottom: height - 16 };
}

function caption(pen, text, x, y, align) {
  pen.textAlign = align;
  pen.fillText(text, x, y);
}

// ``points``: [rollouts, best so far]; the axis begins at zero, so that half is half the height.
export function plotConvergence(canvas, points, { label, unit }) {
  const { pen, left, right, top, bottom } = plotPen(canvas), finite = points.filter(([, value]) => Number.isFinite(value));
  if (!finite.length) return;
  const last = finite.at(-1), most = Math.max(...finite.map(([, value]) => value), 1e-12), spent = Math.max(last[0], 1);
  const x = (n) => left + (n / spent) * (right - left), y = (value) => bottom - (Math.max(0, value) / most) * (bottom - top);
  pen.beginPath();
  finite.forEach(([n, value], k) => {
    if (k) pen.lineTo(x(n), y(finite[k - 1][1]));
    pen.lineTo(x(n), y(value));
  });
  pen.stroke();
  caption(pen, amount(most, unit), left, 11, "left");
  caption(pen, `best ${label}: ${amount(last[1], unit)}`, right, 11, "right");
  caption(pen, "0 rollouts", left, bottom + 13, "left");
  caption(pen, String(Math.round(last[0])), right, bottom + 13, "right");
}

// ``mark``: the value of the design in the hand.
export function plotHistogram(canvas, values, mark, { unit }) {
  const { pen, left, right, top, bottom } = plotPen(canvas), finite = [...values].filter(Number.isFinite).sort((a, b) => a - b);
  if (!finite.length) return;
  const shown = Number.isFinite(mark) ? [finite[0], finite.at(-1), mark] : [finite[0], finite.at(-1)];
  const [least, most] = [Math.min(...shown), Math.max(...shown)], bins = Math.max(5, Math.min(30, Math.round(Math.sqrt(finite.length))));
  const counts = new Array(bins).fill(0), span = most - least || 1;
  for (const value of finite) counts[Math.min(bins - 1, Math.floor((bins * (value - least)) / span))] += 1;
  const wide = (right - left) / bins, tall = (bottom - top) / Math.max(...counts);
  pen.fillStyle = pen.strokeStyle;
  counts.forEach((count, k) => pen.fillRect(left + k * wide, bottom - count * tall, wide - 1, count * tall));
  const style = getComputedStyle(canvas);
  pen.strokeStyle = style.getPropertyValue("--ink");
  if (Number.isFinite(mark)) {
    const x = left + ((mark - least) / span) * (right - left);
    pen.beginPath();
    pen.moveTo(x, top);
    pen.lineTo(x, bottom);
    pen.stroke();
  }
  pen.fillStyle = style.getPropertyValue("--dim");
  caption(pen, `median ${amount(finite[finite.length >> 1], unit)}${Number.isFinite(mark) ? "; line: this design" : ""}`, left, 11, "left");
  caption(pen, amount(least, unit), left, bottom + 13, "left");
  caption(pen, amount(most, unit), right, bottom + 13, "right");
}
