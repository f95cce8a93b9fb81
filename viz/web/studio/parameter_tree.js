// All numbers of the scenario as a tree that can be searched; a tick makes a slider of one.
import { element, options } from "../format.js";

export class Numbers {
  // ``onPin`` hears of ticks, ``onValue`` of values that are chosen or written here.
  constructor(root, { onPin, onValue }) {
    this.root = root;
    this.onPin = onPin;
    this.onValue = onValue;
    this.search = root.querySelector("input[type=search]");
    this.list = root.querySelector(".list");
    this.search.addEventListener("input", () => this.filter());
    this.leaves = [];
  }

  load(numbers) {
    this.leaves = [];
    const top = { branches: new Map(), leaves: [] };
    for (const one of numbers) this.place(top, one);
    this.list.replaceChildren(...this.branch(top));
    this.filter();
  }

  place(node, one) {
    const parts = one.path.split(".");
    for (const part of parts.slice(0, -1)) {
      if (!node.branches.has(part)) node.branches.set(part, { branches: new Map(), leaves: [] });
      node = node.branches.get(part);
    }
    node.leaves.push(one);
  }

  branch({ branches, leaves }) {
    const found = [...branches].map(([name, node]) => {
      let title = name;
      while (node.branches.size === 1 && !node.leaves.length) { // no click for what has no choice
        const [[next, only]] = node.branches;
        [title, node] = [`${title}.${next}`, only];
      }
      const whole = element("details");
      whole.append(element("summary", title), ...this.branch(node));
      return whole;
    });
    return [...leaves.map((one) => this.leaf(one)), ...found];
  }

  leaf(one) {
    const whole = element("div", undefined, "number"), label = element("label"), about = element("p", this.about(one));
    const name = one.path.slice(one.path.lastIndexOf(".") + 1), value = element("b");
    const pinnable = one.kind === "number" && one.free, control = pinnable ? this.box(one) : this.field(one);
    if (pinnable) label.append(control, `${name} `, value); else label.append(`${name} `, control, ` ${one.unit || ""}`);
    whole.append(label, about);
    this.leaves.push({ one, whole, control, value, pinnable, words: `${one.path} ${one.text || ""}`.toLowerCase() });
    return whole;
  }

  about({ text, low, high, unit, free }) {
    const range = rangeWords(low, high);
    return [text, range && `${range} ${unit || ""}`.trim(), free === false ? "a change needs another compilation" : ""].filter(Boolean).join("; ");
  }

  box(one) {
    const box = element("input");
    box.type = "checkbox";
    box.setAttribute("aria-label", `slider for ${one.path}`);
    box.addEventListener("change", () => this.onPin(one.path, box.checked));
    return box;
  }

  // What is no slider: a choice, a truth, a text, or a number that needs another compilation.
  field({ path, kind, choices }) {
    const field = element(kind === "choice" ? "select" : "input");
    if (kind === "choice") options(field, choices.map((choice) => [choice, choice]));
    else field.type = { truth: "checkbox", number: "number" }[kind] || "text";
    if (kind === "number") field.step = "any";
    field.setAttribute("aria-label", path);
    const read = { truth: () => field.checked, number: () => field.valueAsNumber }[kind] || (() => field.value);
    field.addEventListener("change", () => { if (!Number.isNaN(read())) this.onValue(path, read()); });
    return field;
  }

  // Values and ticks; ``value`` gives a number by its path.
  update(value, pinned) {
    for (const leaf of this.leaves) {
      const { one, control, pinnable } = leaf, now = value(one.path);
      if (pinnable) {
        control.checked = pinned(one.path);
        if (leaf.now === now) continue; // the same again would be laid out again
        leaf.now = now;
        leaf.value.textContent = `${short(now)} ${one.unit || ""}`;
      } else if (one.kind === "truth") control.checked = now;
      else if (document.activeElement !== control) control.value = now ?? "";
    }
  }

  filter() {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const leaf of this.leaves) leaf.whole.hidden = !words.every((word) => leaf.words.includes(word));
    // the innermost first: a branch is shown for what it holds
    for (const branch of [...this.list.querySelectorAll("details")].reverse()) {
      branch.hidden = [...branch.children].slice(1).every((part) => part.hidden);
      if (words.length) branch.open = !branch.hidden;
    }
  }
}

export function rangeWords(low, high) {
  if (Number.isFinite(low) && Number.isFinite(high)) return `${short(low)} to ${short(high)}`;
  if (Number.isFinite(low)) return `at least ${short(low)}`;
  return Number.isFinite(high) ? `at most ${short(high)}` : "";
}

// A number as a field shows it.
export function short(value) {
  return typeof value === "number" ? String(Number(value.toPrecision(6))) : String(value ?? "–");
}
