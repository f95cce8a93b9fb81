// Phases and events of the first run, in a strip above the seek bar: a click on one goes there.
import { button } from "./format.js";

export const PHASE_COLOURS = ["#31485f", "#4a3f5c"]; // in turn, so that neighbours differ
export const EVENT_COLOURS = { other: "#f0e442", captured: "#4fd1a5", released: "#9aa8b8", slipped: "#ff5d6c", touched: "#ff5d6c", parted: "#9aa8b8" };

export class EventStrip {
  constructor(root, { onSeek }) {
    this.root = root;
    this.onSeek = onSeek;
    this.phases = [];
  }

  load({ phases, marks } = { phases: [], marks: [] }, duration) {
    this.phases = phases;
    const place = (made, begin, end = begin) => {
      made.style.left = `${(100 * begin) / duration}%`;
      if (end > begin) made.style.width = `${(100 * (end - begin)) / duration}%`;
      return made;
    };
    const spans = phases.map(([name, begin, end], k) => {
      const span = button(name, `${name}: ${begin.toFixed(2)} to ${end.toFixed(2)} s`, () => this.onSeek(begin));
      span.className = "phase";
      span.style.background = PHASE_COLOURS[k % 2];
      return place(span, begin, end);
    });
    const ticks = marks.map(([time, text, kind]) => {
      const tick = button("", `${text}, ${time.toFixed(3)} s`, () => this.onSeek(time));
      tick.className = "tick";
      tick.style.color = EVENT_COLOURS[kind] || EVENT_COLOURS.other;
      return place(tick, time);
    });
    this.root.replaceChildren(...spans, ...ticks);
    this.root.hidden = spans.length + ticks.length === 0;
  }

  // Name of the phase at a time, empty where there are none.
  at(time) {
    return this.phases.findLast(([, begin]) => begin <= time)?.[0] || "";
  }

  // Its ends stand where those of time do, px in the window.
  align(left, right) {
    const own = this.root.parentElement.getBoundingClientRect();
    this.root.style.marginLeft = `${left - own.left}px`;
    this.root.style.width = `${right - left}px`;
  }
}
