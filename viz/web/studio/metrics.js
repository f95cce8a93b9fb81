// The metrics of the design in the hand, beside those of the one before; one of them is chosen.
import { amountOf, element } from "../format.js";

const FIRST_METRICS = 6; // shown at first: those of everything together come before those of each tip and body

export class Metrics {
  constructor(table, more, { onChoose, onFold }) {
    this.table = table;
    this.more = more;
    this.onChoose = onChoose;
    this.rows = [];
    more.addEventListener("click", () => {
      more.setAttribute("aria-expanded", String(!this.whole));
      this.fold();
      onFold();
    });
  }

  // Those that are in sight.
  get seen() { return this.rows.filter(({ row }) => !row.hidden).map(({ metric }) => metric); }

  get whole() { return this.more.getAttribute("aria-expanded") === "true"; }

  fold() {
    this.rows.forEach(({ row, box }, k) => { row.hidden = !this.whole && k >= FIRST_METRICS && !box.checked; });
    this.more.hidden = this.rows.length <= FIRST_METRICS;
    this.more.textContent = this.whole ? "fewer metrics" : `all ${this.rows.length} metrics`;
  }

  load(metrics, chosen) {
    this.metrics = metrics;
    this.rows = metrics.map((metric) => {
      const row = element("tr"), head = element("th"), label = element("label"), box = element("input");
      Object.assign(box, { type: "radio", name: "metric", value: metric.key, checked: metric.key === chosen });
      box.addEventListener("change", () => this.onChoose(metric.key));
      label.append(box, metric.label);
      label.title = metric.text || "";
      head.append(label);
      head.scope = "row";
      const cells = [0, 1, 2].map(() => element("td"));
      row.append(head, ...cells);
      row.dataset.metric = metric.key;
      return { row, box, cells, metric };
    });
    this.table.tBodies[0].replaceChildren(...this.rows.map(({ row }) => row));
    this.fold();
  }

  // ``now`` and ``before``: values by key; nothing where there is no such design.
  show(now, before) {
    this.table.classList.toggle("alone", !before);
    for (const { row, cells, metric } of this.rows) {
      const value = now?.[metric.key], other = before?.[metric.key];
      cells[0].textContent = amountOf(value, metric);
      cells[1].textContent = before ? amountOf(other, metric) : "";
      cells[2].textContent = before ? changeWords(value, other) : "";
      row.dataset.value = value ?? "";
    }
  }

  choose(name) {
    for (const { box, metric } of this.rows) box.checked = metric.key === name;
    this.fold();
  }
}

// Change against the design before, lower is better.
function changeWords(value, other) {
  if (typeof value !== "number" || typeof other !== "number") return "–";
  if (value === other) return "same";
  const share = other ? (100 * (value - other)) / Math.abs(other) : NaN;
  if (!Number.isFinite(share)) return "from zero";
  const size = Math.abs(share) < 1 ? Math.abs(share).toFixed(1) : String(Number(Math.abs(share).toPrecision(2)));
  return size === "0.0" ? "0 %" : `${share > 0 ? "+" : "−"}${size} %`;
}
