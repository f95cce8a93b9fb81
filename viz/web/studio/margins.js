// Stability margins of the design's loops, computed by the server when requested; the worst loop comes first.
import { digits, tableRow } from "../format.js";
import { keyOf } from "./rollouts.js";

const COLUMNS = [
  ["disk", "disk"], ["phase", "phase"], ["gain_up", "gain"], ["delay", "delay"], ["crossover", "crossover"],
];

export class Margins {
  // ``begin`` starts a job; ``design`` gives the values of the design in the hand, ``time`` the time shown.
  constructor(root, { begin, design, time }) {
    this.root = root;
    this.design = design;
    this.wide = root.querySelector(".wide");
    this.table = root.querySelector("table");
    this.compute = root.querySelector(".compute");
    this.compute.addEventListener("click", () => {
      this.of = design();
      this.say("starting");
      begin({ type: "margins", values: this.of, at: root.querySelector("select").value === "shown" ? time() : 0 });
    });
  }

  hear(job) {
    if (job.loops) this.result = { ...job, of: this.of };
    if (job.loops) this.fill(job);
    this.say(job.state === "failed" ? job.message : job.message || job.state);
    if (job.loops) this.show();
  }

  fill({ loops, units }) {
    const head = COLUMNS.map(([key, title]) => (units[key] === "1" ? title : `${title} [${units[key]}]`));
    this.table.tHead.replaceChildren(tableRow("loop", head, "th"));
    this.table.tBodies[0].replaceChildren(...loops.map((loop) => tableRow(loop.name, COLUMNS.map(([key]) => cell(loop, key)))));
    this.wide.hidden = false;
  }

  // Says which design and time the table is for.
  show() {
    const { result } = this;
    if (!result) return;
    const stale = keyOf(result.of) !== keyOf(this.design()), { growing, fastest, destabilised } = result;
    const modes = growing === 1 ? "1 mode grows" : `${growing} modes grow`, rate = `${growing > 1 ? "at most " : ""}${digits(fastest)} 1/s`;
    const drift = growing ? `; ${modes} slowly (${rate}), which is a drift of the motion` : "";
    const stable = destabilised ? `unstable: ${modes} (${rate})` : `stable${drift}`;
    const note = result.loops.some(({ delay }) => delay === 0) ? " Where the delay is 0, any additional delay makes the loop unstable: its gain stays above one at high frequencies." : "";
    this.say(stale ? `Of the design before the last change, at ${result.at}: compute again.` : `${result.loops.length} loops at ${result.at}: ${stable}.${note}`);
    this.wide.classList.toggle("stale", stale);
  }

  enable(able) {
    this.compute.disabled = !able;
  }

  say(text) {
    this.root.querySelector(".words").textContent = text;
  }
}

// An unlimited margin is infinite; a loop whose gain is never one has no crossover.
function cell(loop, key) {
  if (loop.varies) return key === "disk" ? "varies in time" : "–";
  if (key === "gain_up") return `${limit(loop, "gain_down", "−∞")} to ${limit(loop, key)}`;
  return limit(loop, key, key === "crossover" ? "–" : "∞");
}

function limit(loop, key, unlimited = "∞") {
  return loop[key] === null ? unlimited : digits(loop[key]);
}
