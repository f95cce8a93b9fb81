// Plots by uPlot, in the colours of the element that holds them.

// ``about``: options of uPlot; the plot takes the element's size, and the place of what was in it.
/** @param {HTMLElement} root  @param {Omit<import("uplot").Options, "width" | "height">} about  @param {import("uplot").AlignedData} data */
export function plotIn(root, about, data) {
  const style = getComputedStyle(root), font = "11px system-ui, 'DejaVu Sans', sans-serif";
  const [stroke, line] = ["--dim", "--line"].map((name) => style.getPropertyValue(name));
  const axes = about.axes.map((own) => ({ stroke, font, grid: { stroke: line, width: 1 }, ticks: { show: false }, gap: 4, ...own }));
  const height = root.clientHeight - (about.title ? TITLE : 0);
  root.replaceChildren();
  return new uPlot({ width: root.clientWidth, height, legend: { show: false }, ...about, axes }, data, root);
}

const TITLE = 18; // px; in step with .u-title in page.css

// How a curve is drawn: between pixels too, so that it is smooth.
export function stroked(colour, more = {}) {
  return { stroke: colour, width: 1.5, pxAlign: 0, points: { show: false }, ...more };
}
