// A bar that is dragged, or moved by arrow keys, to give something another height.
import { element } from "./format.js";

const STEP = 12; // px, of an arrow key

// ``height`` reads it [px], ``onHeight`` sets it; ``up``: the bar lies above what it makes higher.
export function divider(label, { height, onHeight, up = false }) {
  const bar = element("div", undefined, "divider");
  Object.assign(bar, { tabIndex: 0, title: `${label}: drag, or arrow keys` });
  for (const [name, value] of [["role", "separator"], ["aria-orientation", "horizontal"], ["aria-label", label]]) bar.setAttribute(name, value);
  const by = (down, first = height()) => onHeight(Math.max(24, first + (up ? -down : down)));
  bar.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    event.stopPropagation();
    bar.setPointerCapture(event.pointerId);
    const first = height(), { clientY } = event, drag = (moved) => by(moved.clientY - clientY, first);
    bar.addEventListener("pointermove", drag);
    bar.addEventListener("lostpointercapture", () => bar.removeEventListener("pointermove", drag), { once: true });
  });
  bar.addEventListener("keydown", (event) => {
    if (!["ArrowUp", "ArrowDown"].includes(event.key)) return;
    event.preventDefault();
    event.stopPropagation();
    by(event.key === "ArrowDown" ? STEP : -STEP);
  });
  return bar;
}
