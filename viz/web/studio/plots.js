// Small plots of the panel: best value over rollouts, and how a metric is distributed.
import { amount } from "../format.js";
import { plotIn, stroked } from "../uplot_plot.js";

// ``points``: [rollouts, best so far]; the axis begins at zero, so that half is half the height.
export function plotConvergence(root, points, { label, unit }) {
  const finite = points.filter(([, value]) => Number.isFinite(value));
  if (!finite.length) return;
  const columns = [0, 1].map((k) => finite.map((point) => point[k])), spent = Math.max(columns[0].at(-1), 1), most = Math.max(...columns[1], 1e-12);
  plotIn(root, {
    title: `best ${label}: ${amount(columns[1].at(-1), unit)}`, padding: [6, 16, 0, 0], cursor: { show: false },
    scales: { x: { time: false, range: [0, spent] }, y: { range: [0, most] } },
    series: [{}, stroked(accent(root), { paths: uPlot.paths.stepped({ align: 1 }) })],
    axes: [{ size: 18, space: 60 }, { size: 60, space: 30, values: (_, splits) => splits.map((value) => amount(value, unit)) }],
  }, /** @type {any} */ (columns));
}

// ``mark``: the value of the present design.
export function plotHistogram(root, values, mark, { unit }) {
  const finite = [...values].filter(Number.isFinite).sort((a, b) => a - b), marked = Number.isFinite(mark);
  if (!finite.length) return;
  const shown = marked ? [finite[0], finite.at(-1), mark] : [finite[0], finite.at(-1)];
  const least = Math.min(...shown), span = Math.max(...shown) - least || 1, bins = Math.max(5, Math.min(30, Math.round(Math.sqrt(finite.length))));
  const counts = new Array(bins).fill(0), middles = counts.map((_, k) => least + ((k + 0.5) / bins) * span);
  for (const value of finite) counts[Math.min(bins - 1, Math.floor((bins * (value - least)) / span))] += 1;
  const line = ({ ctx: pen, bbox: { top, height }, valToPos }) => {
    pen.fillStyle = getComputedStyle(root).getPropertyValue("--ink");
    if (marked) pen.fillRect(valToPos(mark, "x", true), top, 1.5 * devicePixelRatio, height);
  };
  const fill = accent(root);
  plotIn(root, {
    title: `median ${amount(finite[finite.length >> 1], unit)}${marked ? "; line: this design" : ""}`, padding: [4, 16, 0, 16], cursor: { show: false },
    scales: { x: { time: false, range: [least, least + span] }, y: { range: [0, Math.max(...counts)] } }, hooks: { draw: [line] },
    series: [{}, stroked(fill, { fill, width: 0, paths: uPlot.paths.bars({ size: [1], gap: 1 }) })],
    axes: [{ size: 18, space: 60, grid: { show: false }, values: (_, splits) => splits.map((value) => amount(value, unit)) }, { show: false }],
  }, [middles, counts]);
}

function accent(root) {
  return getComputedStyle(root).getPropertyValue("--accent");
}
