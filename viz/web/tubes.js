// Paths as round lines: rings of vertices where a path bends, and between them straight.
import { THREE } from "./three.js";

const SIDES = 6, CORNERS = 3 * SIDES;
const RING = Array.from({ length: SIDES }, (_, k) => [Math.cos((2 * Math.PI * k) / SIDES), Math.sin((2 * Math.PI * k) / SIDES)]);
const BEND = 1 / 16; // of its radius: so far a path may lie beside its points

export function tube(points, radius, material) {
  const mesh = new THREE.Mesh(tubeGeometry(points, radius), material);
  mesh.frustumCulled = false;
  return mesh;
}

// A tube through points (n, 3), one after the other.
export function tubeGeometry(points, radius) {
  const places = bends(points, BEND * radius), positions = new Float32Array(places.length * CORNERS);
  let [tx, ty, tz, nx, ny, nz] = [1, 0, 0, 0, 0, 1], at = 0; // tangent and normal
  places.forEach((i, k) => {
    const a = 3 * places[Math.max(0, k - 1)], b = 3 * places[Math.min(places.length - 1, k + 1)];
    const [dx, dy, dz] = [points[b] - points[a], points[b + 1] - points[a + 1], points[b + 2] - points[a + 2]];
    const length = Math.hypot(dx, dy, dz);
    if (length > 1e-9) [tx, ty, tz] = [dx / length, dy / length, dz / length];
    // each ring's normal is the one before it, turned as little as can be
    let along = nx * tx + ny * ty + nz * tz;
    [nx, ny, nz] = [nx - along * tx, ny - along * ty, nz - along * tz];
    if (Math.hypot(nx, ny, nz) < 1e-3) [nx, ny, nz] = [tz * tz + tx * ty, -tx * tx - ty * tz, ty * ty - tz * tx]; // any across
    along = Math.hypot(nx, ny, nz);
    [nx, ny, nz] = [nx / along, ny / along, nz / along];
    const [ox, oy, oz] = [ty * nz - tz * ny, tz * nx - tx * nz, tx * ny - ty * nx];
    for (const [c, s] of RING) {
      positions[at++] = points[3 * i] + radius * (c * nx + s * ox);
      positions[at++] = points[3 * i + 1] + radius * (c * ny + s * oy);
      positions[at++] = points[3 * i + 2] + radius * (c * nz + s * oz);
    }
  });
  const geometry = new THREE.BufferGeometry();
  geometry.userData = { points, places, positions };
  geometry.setAttribute("position", new THREE.BufferAttribute(positions.slice(), 3));
  geometry.setIndex(tubeFaces(places.length));
  return geometry;
}

// Numbers of the points (n, 3) between which a path is straight but for a tolerance; the first and the last among them.
function bends(points, tolerance) {
  const last = points.length / 3 - 1, kept = [0], ahead = [last];
  while (ahead.length) {
    const from = kept.at(-1), to = ahead.at(-1), [far, off] = farthest(points, from, to);
    if (off > tolerance) ahead.push(far);
    else kept.push(ahead.pop());
  }
  return last > 0 ? kept : [0];
}

// Of the points between two, the number and the distance of the one farthest from the line from one to the other.
function farthest(points, from, to) {
  const [a, b] = [3 * from, 3 * to], x = points[b] - points[a], y = points[b + 1] - points[a + 1], z = points[b + 2] - points[a + 2];
  const square = x * x + y * y + z * z;
  let [number, most] = [from, -1];
  for (let i = from + 1; i < to; i++) {
    const px = points[3 * i] - points[a], py = points[3 * i + 1] - points[a + 1], pz = points[3 * i + 2] - points[a + 2];
    const share = square > 0 ? Math.min(1, Math.max(0, (px * x + py * y + pz * z) / square)) : 0;
    const off = (px - share * x) ** 2 + (py - share * y) ** 2 + (pz - share * z) ** 2;
    if (off > most) [number, most] = [i, off];
  }
  return [number, Math.sqrt(Math.max(0, most))];
}

// A tube as far as its point number i: behind the bend before it the next ring is where that point is.
export function grow({ geometry }, i) {
  const { points, places, positions } = geometry.userData, ring = places.findLastIndex((place) => place <= i), more = places[ring] < i;
  const seen = geometry.attributes.position, from = CORNERS * ring;
  seen.array.set(positions);
  for (let k = 0; more && k < CORNERS; k++) {
    seen.array[from + CORNERS + k] = positions[from + k] + points[3 * i + (k % 3)] - points[3 * places[ring] + (k % 3)];
  }
  seen.needsUpdate = true;
  geometry.setDrawRange(0, 6 * SIDES * (ring + more));
}

// Corners of the triangles between n rings.
function tubeFaces(n) {
  const faces = [];
  for (let i = 0; i < n - 1; i++) {
    for (let k = 0; k < SIDES; k++) {
      const a = i * SIDES + k, b = i * SIDES + ((k + 1) % SIDES);
      faces.push(a, b, a + SIDES, b, b + SIDES, a + SIDES);
    }
  }
  return faces;
}
