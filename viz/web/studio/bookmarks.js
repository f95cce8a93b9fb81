// Kept designs side by side: their metrics, and the numbers in which they differ.
import { amountOf, button, element, tableRow } from "../format.js";
import { short } from "./parameter_tree.js";
import { shortPath } from "./slider.js";

export class Bookmarks {
  // ``designs``: whose; ``metricsOf`` gives a design's metrics once they are known.
  constructor(root, metricsOf) {
    this.root = root;
    this.metricsOf = metricsOf;
    this.name = root.querySelector("input");
    const keep = () => {
      this.designs.keep(this.name.value.trim() || `design ${this.designs.kept.length + 1}`);
      this.name.value = "";
    };
    root.querySelector("button").addEventListener("click", keep);
    this.name.addEventListener("keydown", (event) => { if (event.key === "Enter") keep(); });
  }

  load(designs) {
    this.designs = designs;
  }

  // ``full``: whether numbers are called by their dotted paths.
  show(metrics, units, full) {
    const { designs } = this, table = this.root.querySelector("table");
    table.hidden = designs.kept.length === 0;
    if (table.hidden) { this.shown = undefined; return; }
    const columns = [{ name: "this design", values: designs.now, own: true }, ...designs.kept];
    const known = columns.map(({ values }) => this.metricsOf(values));
    const text = JSON.stringify([columns, known, designs.chosen, metrics.length, full]);
    if (text === this.shown) return; // the focus stays where it is
    this.shown = text;
    const focused = table.contains(document.activeElement) && document.activeElement.getAttribute("aria-label");
    const paths = [...new Set(columns.flatMap(({ values }) => Object.keys(values)))].sort();
    const value = (values, path) => values[path] ?? designs.own[path];
    table.tHead.replaceChildren(tableRow("", columns.map((one) => this.head(one)), "th"));
    table.tBodies[0].replaceChildren(
      ...metrics.map((metric) => tableRow(metric.label, known.map((own) => amountOf(own?.[metric.key], metric)))),
      ...paths.map((path) => tableRow(`${full ? path : shortPath(path)}${units(path) ? ` [${units(path)}]` : ""}`, columns.map(({ values }) => short(value(values, path))))),
    );
    if (focused) table.querySelector(`[aria-label="${CSS.escape(focused)}"]`)?.focus();
  }

  // A field stands for the name until Enter or Escape is pressed, or it is left.
  rename(whole, name) {
    const field = element("input"), heading = whole.firstChild;
    Object.assign(field, { type: "text", value: name });
    field.setAttribute("aria-label", `New name of ${name}`);
    let ended = false; // a field that goes is left as well
    const end = (wanted) => {
      if (ended) return;
      ended = true;
      field.replaceWith(heading);
      this.designs.rename(name, wanted);
    };
    field.addEventListener("keydown", ({ key }) => { if (key === "Enter") end(field.value.trim()); else if (key === "Escape") end(name); });
    field.addEventListener("blur", () => end(field.value.trim()));
    heading.replaceWith(field);
    field.select();
  }

  head({ name, values, own }) {
    const whole = element("div", name), { designs } = this;
    if (own) return whole;
    const compare = button("compare", `Compare with ${name}`, () => designs.choose(designs.chosen === name ? null : name));
    compare.setAttribute("aria-pressed", String(designs.chosen === name));
    const buttons = element("div", undefined, "row");
    buttons.append(
      compare, button("take", `Take ${name}`, () => designs.take(values)),
      button("rename", `Rename ${name}`, () => this.rename(whole, name)), button("delete", `Delete ${name}`, () => designs.drop(name)),
    );
    whole.append(buttons);
    return whole;
  }
}
