// Colours of the page's scheme, for what is drawn by hand.
const LIGHT = window.matchMedia("(prefers-color-scheme: light)");
const STILL = window.matchMedia("(prefers-reduced-motion: reduce)");

function themed(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// A curve's colour: made for a dark page, darker on a light one.
function inked(colour) {
  if (!LIGHT.matches) return colour;
  const parts = [1, 3, 5].map((k) => Math.round(0.55 * parseInt(colour.slice(k, k + 2), 16)));
  return `rgb(${parts.join(" ")})`;
}
