// Small helpers that every part uses: elements, numbers, packed data.
/** @type {(id: string) => HTMLElement & { value: string, disabled: boolean, open: boolean }} */
export const $ = (id) => /** @type {any} */ (document.getElementById(id));

export function element(tag, text, name) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (name) made.className = name;
  return made;
}

export function button(text, label, onClick) {
  const made = element("button", text);
  made.type = "button";
  made.title = label;
  made.setAttribute("aria-label", label);
  made.addEventListener("click", onClick);
  return made;
}

export function mark(colour, shape = "line") {
  const made = element("i", shape === "text" ? "a" : undefined, shape);
  made.style.color = colour;
  return made;
}

export function options(select, pairs) {
  select.replaceChildren(...pairs.map(([value, text]) => {
    const option = element("option", text);
    option.value = value;
    return option;
  }));
}

export function bytes(text) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
}

// Numbers in base 64, or as they are.
export function floats(packed) {
  return packed instanceof Float32Array ? packed : new Float32Array(bytes(packed));
}

// Sample before a time and the share of the way to the next one.
export function locate(times, time) {
  let low = 0, high = times.length - 1;
  if (time >= times[high]) return [high, 0];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle; else high = middle;
  }
  return [low, Math.max(0, (time - times[low]) / (times[high] - times[low]))];
}

export function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= least * 0.999);
}

// A value in three digits.
export function digits(value) {
  const size = Math.abs(value);
  if (!Number.isFinite(value)) return "–";
  return size >= 1e-3 && size < 1e4 ? `${Number(value.toPrecision(3))}` : size ? value.toExponential(1) : "0";
}

export function amount(value, unit) {
  return unit === "mm" && Math.abs(value) >= 1e3 ? `${digits(value / 1e3)} m` : `${digits(value)} ${unit}`;
}

// The size of an error given in mm: less than a micrometre is not shown.
export function errorSize(mm) {
  if (mm >= 1000) return `${(mm / 1e3).toPrecision(3)} m`;
  if (mm >= 1) return `${mm.toPrecision(3)} mm`;
  return mm >= 5e-4 || mm === 0 ? `${mm.toFixed(3)} mm` : "< 0.001 mm";
}

// A metric's value; a dash where there is none.
export function amountOf(value, { unit }) {
  return typeof value === "number" ? amount(value, unit).trim() : "–";
}

// Text that may be broken after the dots, slashes and underscores of names; in step with spacerobot/common/tables.py.
function breakable(text) {
  const parts = text.split(/(?<=[\w*][._])(?=[A-Za-z*])|(?<=\w\w\/)(?=\w{3})/);
  return parts.flatMap((part, k) => (k ? [element("wbr"), part] : [part]));
}

export function tableRow(title, cells, kind = "td") {
  const row = element("tr"), head = element(title ? "th" : "td");
  head.append(...breakable(title));
  if (title) head.scope = "row";
  row.append(head, ...cells.map((cell) => {
    const made = element(kind);
    made.append(cell);
    return made;
  }));
  return row;
}
