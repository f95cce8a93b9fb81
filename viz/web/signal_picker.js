// The list from which signals are chosen: quantities, and the signals of each.
import { draggable } from "./chart.js";
import { element, mark } from "./format.js";

export class SignalPicker {
  constructor(panel, opener, onChange) {
    this.panel = panel;
    this.opener = opener;
    this.onChange = onChange;
    this.search = panel.querySelector("input[type=search]");
    this.list = panel.querySelector(".list");
    this.search.addEventListener("input", () => this.filter());
    panel.querySelector(".close").addEventListener("click", () => this.open(false));
    panel.addEventListener("keydown", (event) => { if (event.key === "Escape") this.open(false); });
    opener.addEventListener("click", () => this.open(panel.hidden));
  }

  open(wanted) {
    this.panel.hidden = !wanted;
    this.opener.setAttribute("aria-expanded", String(wanted));
    (wanted ? this.search : this.opener).focus();
  }

  load(signals) {
    this.signals = signals;
    this.opener.disabled = signals.quantities.length === 0;
    const listed = JSON.stringify([signals.full, ...signals.quantities.map(({ title, unit, signals: own }) => [title, unit, own.map(({ name, colour }) => [name, colour])])]);
    if (listed === this.listed) { this.update(); return; } // what is open stays open
    this.listed = listed;
    this.groups = signals.quantities.map((quantity) => this.group(quantity));
    this.list.replaceChildren(...this.groups.map(({ whole }) => whole));
    this.filter();
    this.update();
  }

  group({ title, unit, signals }) {
    const whole = element("details"), summary = element("summary");
    const all = this.box(`all of ${title}`, (wanted) => this.signals.choose(title, undefined, wanted));
    summary.append(all, `${title} [${unit}]`);
    const boxes = signals.map((signal) => {
      const { name, colour } = signal, label = draggable(element("label"), signal), box = this.box(name, (wanted) => this.signals.choose(title, name, wanted));
      label.title = `${name}; drag it into a panel`;
      label.append(box, mark(colour), this.signals.called(signal));
      return { name, box, label };
    });
    whole.append(summary, ...boxes.map(({ label }) => label));
    return { title, whole, all, boxes };
  }

  box(name, choose) {
    const box = element("input");
    box.type = "checkbox";
    box.setAttribute("aria-label", name);
    box.addEventListener("click", (event) => event.stopPropagation());
    box.addEventListener("change", () => {
      choose(box.checked);
      this.update();
      this.onChange();
    });
    return box;
  }

  // What is chosen, in the boxes.
  update() {
    for (const { title, all, boxes } of this.groups) {
      for (const { name, box } of boxes) box.checked = this.signals.isChosen(title, name);
      const count = boxes.filter(({ box }) => box.checked).length;
      all.checked = count === boxes.length;
      all.indeterminate = count > 0 && !all.checked;
    }
  }

  filter() {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const { title, whole, boxes } of this.groups || []) {
      for (const { name, label } of boxes) {
        const text = `${title} ${name} ${label.textContent}`.toLowerCase();
        label.hidden = !words.every((word) => text.includes(word));
      }
      whole.hidden = boxes.every(({ label }) => label.hidden);
      if (words.length) whole.open = !whole.hidden;
    }
  }
}
