// Colours of the page's scheme, for what is drawn by hand.
const LIGHT = window.matchMedia("(prefers-color-scheme: light)"), { dataset } = document.documentElement;
export const STILL = window.matchMedia("(prefers-reduced-motion: reduce)");

const heard = [];
let chosen = "";
LIGHT.addEventListener("change", () => scheme(chosen));
scheme("");

// The page is dark, light, or as the system is if none is named; ``onScheme`` hears of changes.
export function scheme(wanted) {
  chosen = ["dark", "light"].includes(wanted) ? wanted : "";
  const own = chosen || (LIGHT.matches ? "light" : "dark");
  if (own === dataset.scheme) return;
  dataset.scheme = own;
  for (const hear of heard) hear();
}

export function onScheme(hear) {
  heard.push(hear);
}

export function chosenScheme() {
  return chosen;
}

export function isLight() {
  return dataset.scheme === "light";
}

export function themed(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// How curves of several runs are drawn, so that each signal keeps its colour.
const STROKES = [["", []], ["dashed", [6, 3]], ["dotted", [2, 2]], ["dash-dotted", [9, 3, 2, 3]], ["long dashes", [14, 4]], ["sparse dots", [2, 6]]];

export function strokeOf(r) {
  return STROKES[r % STROKES.length];
}

// A curve's colour: made for a dark page, darker on a light one.
export function inked(colour) {
  if (!isLight()) return colour;
  return `#${[1, 3, 5].map((k) => Math.round(0.55 * parseInt(colour.slice(k, k + 2), 16)).toString(16).padStart(2, "0")).join("")}`;
}
