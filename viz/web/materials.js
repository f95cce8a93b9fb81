// Physically based surfaces: paint, metal, foil and solar cells. Textures are drawn here; none is loaded.
import { element } from "./format.js";
import { THREE } from "./three.js";

const PIXELS = 256, CELLS = 6; // of a texture; solar cells across a panel's shorter side
const LOOKS = {
  paint: { roughness: 0.5, metalness: 0 }, metal: { roughness: 0.4, metalness: 0.8 },
  foil: { roughness: 0.34, metalness: 0.75 }, solar: { roughness: 0.3, metalness: 0.45 },
};
const PLAIN = { foil: () => crinkles(true), solar: cells }; // textures without gloss, cheap for a processor to look up
const drawn = {};

// The renderer writes sRGB and works in linear light: colours as they are meant on the screen, for it.
// What a description calls black reflects a little: a body that reflects nothing could not be seen against the sky.
const DARKEST = 0.055;

// A metal mirrors the dark sky besides, so that a black one has to be lighter than black paint to look alike.
export function linear(rgb, finish = "paint") {
  const least = DARKEST / (1 - LOOKS[finish].metalness), light = rgb.map((v) => DARKEST + (1 - DARKEST) * v ** 2.2);
  return light.map((v, k) => v + Math.max(0, least - Math.max(...light.slice(k - (k % 3), k - (k % 3) + 3))));
}

export function paint(colour) { return new THREE.Color(colour).convertSRGBToLinear(); }

// ``finish``: of LOOKS; ``coloured``: whether its geometry has colours.
export function surfaceMaterial(finish, { coloured, opacity, side }) {
  const material = new THREE.MeshStandardMaterial({ ...LOOKS[finish], opacity, side, transparent: opacity < 1, vertexColors: coloured });
  if (finish === "solar") material.map = once("cells", cells);
  material.userData = {
    finish, metalness: material.metalness, normalMap: finish === "foil" ? once("crinkles", crinkles) : null,
    envMap: finish === "paint" ? null : once("space", surroundings),
  };
  return material;
}

// Whether metals mirror what is around, and foil is crinkled; a metal without anything to mirror would be black.
export function refineSurface(material, mirrors, creases, anew) {
  const { metalness, normalMap, envMap } = material.userData, before = [material.envMap, material.normalMap];
  if (metalness === undefined) return;
  material.envMap = mirrors ? envMap : null;
  material.normalMap = creases ? normalMap : null;
  material.metalness = mirrors ? metalness : 0.35 * metalness;
  material.needsUpdate = anew || before[0] !== material.envMap || before[1] !== material.normalMap;
}

// Whether a mesh's light is computed for each pixel, by the look of its surface, or for each vertex, without any gloss.
export function shadeSurface(mesh, glossy) {
  const { material } = mesh;
  if (material.userData.metalness === undefined || Boolean(material.isMeshStandardMaterial) === glossy) return;
  const { color, map, vertexColors, opacity, transparent, side, polygonOffset, polygonOffsetFactor, polygonOffsetUnits, userData } = material, { finish } = userData;
  const own = { color, vertexColors, opacity, transparent, side, polygonOffset, polygonOffsetFactor, polygonOffsetUnits };
  if (glossy) mesh.material = new THREE.MeshStandardMaterial({ ...own, ...LOOKS[finish], map: finish === "solar" ? once("cells", cells) : finish === "foil" ? null : map });
  else mesh.material = new THREE.MeshLambertMaterial({ ...own, map: PLAIN[finish] ? once(`plain ${finish}`, () => Object.assign(PLAIN[finish](), { anisotropy: 1, minFilter: THREE.LinearMipmapNearestFilter })) : map });
  mesh.material.userData = userData;
  material.dispose();
}

// Whether the processor draws, without a graphics processor.
export function isSoftware() {
  return once("software", () => {
    const context = element("canvas").getContext("webgl"), about = context?.getExtension("WEBGL_debug_renderer_info");
    const name = about ? context.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
  });
}

function once(name, draw) {
  drawn[name] ??= draw();
  return drawn[name];
}

// Where a texture lies on a shape: seen along the axis that each normal is nearest to, as many tiles as look alike on any size.
export function texturePlaces({ attributes: { position, normal } }, size, finish) {
  const solid = finish === "solar", least = [...size].sort((a, b) => a - b)[1] || size[0], greatest = Math.max(...size);
  const across = (length) => (solid ? Math.max(1, Math.round((CELLS * length) / least)) / length : 2 / greatest);
  const uv = new Float32Array(2 * position.count), at = new THREE.Vector3(), out = new THREE.Vector3();
  for (let i = 0; i < position.count; i++) {
    at.fromBufferAttribute(position, i);
    out.fromBufferAttribute(normal, i);
    const sides = out.toArray().map(Math.abs), main = sides.indexOf(Math.max(...sides)), rest = [0, 1, 2].filter((c) => c !== main);
    rest.forEach((c, k) => { uv[2 * i + k] = at.getComponent(c) * across(size[c] ?? greatest) + (solid ? (size[c] ?? greatest) * across(size[c] ?? greatest) / 2 : 0); });
  }
  return new THREE.BufferAttribute(uv, 2);
}

function canvasTexture(width, height, draw) {
  const canvas = element("canvas");
  Object.assign(canvas, { width, height });
  draw(canvas.getContext("2d"));
  const texture = new THREE.CanvasTexture(canvas);
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
  return texture;
}

// One cell: silicon with cut corners, thin bus bars, and the gap to its neighbours.
function cells() {
  const texture = canvasTexture(PIXELS, PIXELS, (pen) => {
    pen.fillStyle = "#b9b7ad";
    pen.fillRect(0, 0, PIXELS, PIXELS);
    const shade = pen.createLinearGradient(0, 0, PIXELS, PIXELS);
    [[0, "#2b3f8f"], [0.5, "#1a2768"], [1, "#26388a"]].forEach(([at, colour]) => shade.addColorStop(at, colour));
    pen.fillStyle = shade;
    const [a, b, c] = [0.025 * PIXELS, 0.975 * PIXELS, 0.12 * PIXELS];
    pen.beginPath();
    for (const [x, y] of [[a + c, a], [b - c, a], [b, a + c], [b, b - c], [b - c, b], [a + c, b], [a, b - c], [a, a + c]]) pen.lineTo(x, y);
    pen.fill();
    pen.fillStyle = "#8d9bd8";
    for (let k = 1; k < 4; k++) pen.fillRect((k / 4) * PIXELS - 1.5, a, 3, b - a);
  });
  return Object.assign(texture, { encoding: THREE.sRGBEncoding, anisotropy: 4 });
}

// Numbers that look random and are the same on every page.
export function scattered(seed) {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

// Normals of a foil that was folded flat again: plane facets around scattered points, each tilted its own way; or their brightness.
function crinkles(bright = false) {
  const next = scattered(7), facets = Float64Array.from({ length: 4 * 260 }, (_, k) => next() - (k % 4 < 2 ? 0 : 0.5)); // x, y, two tilts each
  return canvasTexture(PIXELS, PIXELS, (pen) => {
    const picture = pen.createImageData(PIXELS, PIXELS);
    for (let i = 0; i < PIXELS * PIXELS; i++) {
      const x = (i % PIXELS) / PIXELS, y = Math.floor(i / PIXELS) / PIXELS;
      let least = 9, own = 0;
      for (let k = 0; k < facets.length; k += 4) {
        let dx = Math.abs(x - facets[k]), dy = Math.abs(y - facets[k + 1]);
        if (dx > 0.5) dx = 1 - dx; // the tile repeats
        if (dy > 0.5) dy = 1 - dy;
        const off = dx * dx + dy * dy;
        if (off < least) { least = off; own = k; }
      }
      const grey = 205 + 95 * facets[own + 2];
      picture.data.set(bright ? [grey, grey, grey, 255] : [128 + 120 * facets[own + 2], 128 + 120 * facets[own + 3], 232, 255], 4 * i);
    }
    pen.putImageData(picture, 0, 0);
  });
}

// What metal mirrors: a dark sky with the Earth's glow below and the sun's around it.
function surroundings() {
  const texture = canvasTexture(64, 32, (pen) => {
    const sky = pen.createLinearGradient(0, 0, 0, 32);
    [[0, "#6b7480"], [0.35, "#2b313a"], [0.55, "#161b24"], [0.68, "#41597c"], [1, "#6f8fbd"]].forEach(([at, colour]) => sky.addColorStop(at, colour));
    pen.fillStyle = sky;
    pen.fillRect(0, 0, 64, 32);
    for (const x of [14, 46]) {
      const glow = pen.createRadialGradient(x, 9, 0, x, 9, 12);
      [[0, "#fff6e0"], [0.3, "#d9cdb4aa"], [1, "#0000"]].forEach(([at, colour]) => glow.addColorStop(at, colour));
      pen.fillStyle = glow;
      pen.fillRect(0, 0, 64, 32);
    }
  });
  return Object.assign(texture, { mapping: THREE.EquirectangularReflectionMapping, encoding: THREE.sRGBEncoding });
}
