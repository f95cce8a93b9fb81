// The panel of a page without a server: results side by side, their metrics, where they differ, which are shown.
import { $, amountOf, element, tableRow } from "../format.js";
import { Spread } from "./campaign_spread.js";

const ROOMY = 1100; // px from which on the panel is open at first

export class Results {
  constructor(player) {
    this.player = player;
    this.table = $("results").querySelector("table");
    this.spread = new Spread($("spread"), player);
    $("paneling").addEventListener("click", () => this.spread.draw());
    window.addEventListener("resize", () => this.spread.draw());
    player.link.join({ read: () => this.state(), apply: (wanted) => this.become(wanted) });
  }

  load(payload) {
    const { panel, runs } = payload;
    this.payload = payload;
    this.shown = runs.map((_, k) => k).slice(0, panel?.first);
    this.player.load(this.chosen);
    $("paneling").hidden = !panel;
    $("panel").classList.toggle("results", Boolean(panel));
    this.player.panel(Boolean(panel) && window.innerWidth >= ROOMY);
    if (!panel) return;
    $("results").hidden = panel.metrics.length === 0;
    this.fill(panel);
    this.spread.load(panel.spreads);
  }

  // The page with those results that are shown alone.
  get chosen() {
    const { payload, shown } = this;
    return { ...payload, runs: shown.map((k) => payload.runs[k]) };
  }

  fill({ metrics, designs }) {
    this.boxes = [];
    const several = designs.length > 1, paths = Object.keys(designs[0].numbers);
    this.table.tHead.replaceChildren(tableRow("", designs.map(({ name }, k) => this.head(name, k, several)), "th"));
    this.table.tBodies[0].replaceChildren(
      ...metrics.map((metric, m) => tableRow(metric.label, designs.map(({ values }) => amountOf(values[m], metric)))),
      ...paths.map((path) => tableRow(path, designs.map(({ numbers }) => brief(numbers[path])))),
    );
  }

  head(name, k, several) {
    if (!several) return name;
    const label = element("label"), box = element("input");
    Object.assign(box, { type: "checkbox", checked: this.shown.includes(k) });
    box.setAttribute("aria-label", `Show ${name}`);
    box.addEventListener("change", () => this.show(this.boxes.flatMap(({ checked }, at) => (checked ? [at] : []))));
    label.append(box, name);
    this.boxes.push(box);
    return label;
  }

  // At least one; time, view and curves stay.
  show(wanted) {
    const shown = wanted.filter((k) => k in this.payload.runs), same = shown.join() === this.shown.join();
    if (shown.length) this.shown = shown;
    this.boxes.forEach((box, k) => { box.checked = this.shown.includes(k); });
    if (same || !shown.length) return;
    const seen = new URLSearchParams(this.player.state().filter(([, value]) => value !== "" && value !== null));
    this.player.load(this.chosen);
    this.player.become(seen);
    this.player.note();
  }

  state() {
    const { payload, shown } = this, first = payload?.panel?.first;
    return [["shown", payload?.panel && shown.join() !== payload.runs.map((_, k) => k).slice(0, first).join() ? shown.join(" ") : ""]];
  }

  become(wanted) {
    if (this.payload?.panel && wanted.has("shown")) this.show(wanted.get("shown").split(" ").filter(Boolean).map(Number));
  }
}

// A number's text in six digits; any other text as it is.
export function brief(text) {
  return text.trim() && Number.isFinite(Number(text)) ? String(Number(Number(text).toPrecision(6))) : text;
}
