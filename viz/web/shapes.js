// Three.js objects from the page's plain data.
import { bytes, floats } from "./format.js";
import { linear, paint, scattered, surfaceMaterial, texturePlaces } from "./materials.js";
import { THREE } from "./three.js";
import { tube } from "./tubes.js";

// Of tips, and of curves: far from each other, and from a dark page as well as, darkened, from a light one.
const TIP_COLOURS = [
  "#56b4e9", "#ffb000", "#f29ad0", "#f0e442", "#9be564", "#c9b6ff", "#dc28f0", "#f0503c", "#a08c50", "#28f0dc", "#28f028", "#f03cb4",
  "#50a064", "#7878f0", "#788c8c", "#f0a08c", "#f05078", "#28f0a0", "#c87828", "#c8dca0", "#8ca028", "#dc78f0", "#28a028", "#f0c864",
];
export const AXIS_COLOURS = ["#ff5c5c", "#5ee05e", "#6fa8ff"];
export const COLOURS = {
  target: "#35e0a1", force: "#ff5c6c", contact: "#c77dff", impulse: "#ff9d2e", reference: "#ffffff", mate: "#ffffff", grid: "#8fa3b8",
  centre: "#ffd23f", momentum: "#7df9ff", plume: "#ffdca8", wheel: "#d7e3ff",
};
export const RUN_COLOURS = ["#56b4e9", "#ff8c42", "#9be564", "#f29ad0", "#f0e442", "#c9b6ff", ...TIP_COLOURS.slice(6)];

// Geometries of the page's meshes, each made once for all solids that show it.
let meshes = [], madeOf;

export function keepMeshes(data) {
  if (data === madeOf) return;
  madeOf = data;
  meshes.forEach((geometry) => geometry.dispose());
  meshes = data.map(({ vertices, triangles, colours }) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(floats(vertices), 3));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(triangles)), 1));
    const made = creased(geometry.toNonIndexed(), Array.from(new Uint32Array(bytes(triangles))));
    if (colours) {
      const each = new Uint8Array(bytes(colours)), corners = new Float32Array(3 * each.length);
      for (let i = 0; i < corners.length; i++) corners[i] = each[3 * Math.floor(i / 9) + (i % 3)] / 255;
      made.setAttribute("color", new THREE.BufferAttribute(corners, 3));
    }
    return made;
  });
}

// Smooth but for edges sharper than 40 degrees: a corner's normal is the mean over its faces that lie much the same way.
function creased(geometry, index) {
  geometry.computeVertexNormals();
  const flat = geometry.attributes.normal.array.slice(), smooth = geometry.attributes.normal, around = new Map();
  index.forEach((vertex, corner) => (around.get(vertex) || around.set(vertex, []).get(vertex)).push(corner));
  const own = new THREE.Vector3(), other = new THREE.Vector3(), sum = new THREE.Vector3();
  index.forEach((vertex, corner) => {
    own.fromArray(flat, 3 * corner);
    sum.set(0, 0, 0);
    for (const k of around.get(vertex)) if (own.dot(other.fromArray(flat, 3 * k)) > 0.766) sum.add(other);
    sum.normalize().toArray(smooth.array, 3 * corner);
  });
  return geometry;
}

// So much wider, as a share of the scene, is each but the largest on every side: of faces in one plane, that of the smaller one is seen.
const MARGIN = 3e-5;

// Boxes, spheres and cylinders are closed and seen from outside alone; a mesh may be open, or wound either way.
const CLOSED = ["box", "sphere", "cylinder"];

// ``scale``: the scene's size, m.
function solidGeometry({ kind, size, mesh }, scale) {
  if (kind === "mesh") return meshes[mesh];
  if (kind === "box") return new THREE.BoxGeometry(...size);
  // as many sides of a circle as make it look round
  const sides = Math.round(Math.min(32, Math.max(8, 200 * Math.sqrt(size[0] / scale))));
  if (kind === "sphere") return new THREE.SphereGeometry(size[0], sides, Math.round(0.6 * sides));
  if (kind === "cone") return new THREE.CylinderGeometry(size[1], size[0], size[2], 32, 1, true).rotateX(Math.PI / 2);
  // a URDF's cylinder lies along z, Three's along y
  return new THREE.CylinderGeometry(size[0], size[0], size[1], sides).rotateX(Math.PI / 2);
}

// A body's solids, as few objects as can be, for each costs a draw call: closed ones of one opacity and finish are one.
export function surfaces(solids, scale) {
  const closed = new Map(), found = [], bySize = [...solids].sort((a, b) => Math.hypot(...b.size) - Math.hypot(...a.size));
  for (const solid of solids) {
    const { rgba: { 3: alpha }, finish } = solid, key = `${alpha} ${finish}`;
    if (!CLOSED.includes(solid.kind)) {
      const geometry = solidGeometry(solid, scale).clone(), own = geometry.attributes.color;
      geometry.setAttribute("uv", texturePlaces(geometry, spans(geometry), finish));
      const mesh = surface(geometry, own ? [...own.array] : colourOf(solid), { alpha, finish, side: THREE.DoubleSide });
      mesh.matrixAutoUpdate = false;
      mesh.matrix.fromArray(solid.matrix);
      found.push(mesh);
    } else closed.set(key, [...(closed.get(key) || []), solid]);
  }
  for (const alike of closed.values()) {
    const geometries = alike.map((solid) => {
      const geometry = solidGeometry(solid, scale);
      const sides = spans(geometry), margin = 2 * MARGIN * scale * bySize.indexOf(solid);
      geometry.setAttribute("uv", texturePlaces(geometry, sides, solid.finish));
      geometry.scale(...sides.map((side) => 1 + margin / side));
      return placed(geometry, solid);
    });
    const colours = alike.flatMap((solid, k) => Array.from({ length: geometries[k].attributes.position.count }, () => colourOf(solid)).flat());
    const whole = merged(geometries), [{ rgba: { 3: alpha }, finish }] = alike;
    whole.setAttribute("color", new THREE.Float32BufferAttribute(colours, 3));
    found.push(surface(whole, colours, { alpha, finish, side: THREE.FrontSide }));
  }
  return found;
}

// Solar cells have the colours of their texture.
function colourOf({ rgba, finish }) { return finish === "solar" ? [1, 1, 1] : rgba.slice(0, 3); }

function spans(geometry) {
  geometry.computeBoundingBox();
  return geometry.boundingBox.getSize(new THREE.Vector3()).toArray();
}

// ``colours``: one, or one for each vertex, as red, green and blue.
function surface(geometry, colours, { alpha, finish, side }) {
  const material = surfaceMaterial(finish, { coloured: colours.length > 3, opacity: alpha, side });
  const mesh = new THREE.Mesh(geometry, material);
  mesh.castShadow = mesh.receiveShadow = true;
  mesh.userData = { opacity: alpha, side, colours };
  dye(mesh);
  return mesh;
}

// A surface in its own colours, or mostly in another one.
/** @param {any} surface  @param {string} [colour] */
export function dye({ geometry, material, userData: { colours } }, colour) {
  const other = new THREE.Color(colour).toArray(), mixed = linear(colours.map((own, k) => (colour ? own + 0.7 * (other[k % 3] - own) : own)), material.userData.finish);
  if (!material.vertexColors) { material.color.fromArray(mixed); return; }
  geometry.attributes.color.copyArray(mixed);
  geometry.attributes.color.needsUpdate = true;
}

// A geometry of its own where a solid is.
function placed(geometry, { matrix }) {
  return geometry.applyMatrix4(new THREE.Matrix4().fromArray(matrix));
}

// Several geometries as one.
function merged(geometries) {
  const whole = new THREE.BufferGeometry(), index = [];
  let first = 0;
  for (const { attributes, index: { array } } of geometries) {
    for (const k of array) index.push(first + k);
    first += attributes.position.count;
  }
  for (const [name, size] of /** @type {[string, number][]} */ ([["position", 3], ["normal", 3], ["uv", 2]])) {
    whole.setAttribute(name, new THREE.Float32BufferAttribute(geometries.flatMap(({ attributes }) => [...attributes[name].array]), size));
  }
  whole.setIndex(index);
  return whole;
}

// Where a body began: the edges of its solids.
export function ghostOf({ solids }, scale) {
  const edge = new THREE.LineBasicMaterial({ color: paint("#cfd8e3"), opacity: 0.5, transparent: true, toneMapped: false }), edges = [];
  for (const solid of solids) edges.push(...placed(new THREE.EdgesGeometry(solidGeometry(solid, scale), 30), solid).attributes.position.array);
  const lines = new THREE.BufferGeometry();
  lines.setAttribute("position", new THREE.Float32BufferAttribute(edges, 3));
  return new THREE.LineSegments(lines, edge);
}

// Position and quaternion (x, y, z, w).
export function setPose(object, pose) {
  object.position.fromArray(pose, 0);
  object.quaternion.fromArray(pose, 3);
}

export function overlay(colour, opacity) {
  return new THREE.MeshBasicMaterial({ color: paint(colour), opacity, transparent: true, depthTest: false, depthWrite: false, toneMapped: false });
}

export function arrow(size, colour) {
  const material = overlay(colour, 1);
  const group = new THREE.Group();
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(size, size, 1, 10).translate(0, 0.5, 0), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(2.8 * size, 6 * size, 14).translate(0, 3 * size, 0), material);
  shaft.renderOrder = head.renderOrder = 30;
  // a dark rim, so that it is legible in front of anything
  const rim = overlay("#05070b", 0.55), shaftRim = new THREE.Mesh(shaft.geometry, rim), headRim = new THREE.Mesh(head.geometry, rim);
  shaftRim.scale.set(1.8, 1, 1.8);
  headRim.scale.setScalar(1.22);
  headRim.position.y = -0.5 * size;
  shaftRim.renderOrder = headRim.renderOrder = 29;
  shaft.add(shaftRim);
  head.add(headRim);
  group.add(shaft, head);
  const point = (from, vector) => {
    const length = vector.length();
    group.visible = length > 0.5 * size;
    if (!group.visible) return;
    group.position.copy(from);
    group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), vector.clone().divideScalar(length));
    const headLength = Math.min(6 * size, 0.6 * length);
    head.scale.setScalar(headLength / (6 * size));
    shaft.scale.set(1, Math.max(1e-6, length - headLength), 1);
    head.position.y = length - headLength;
  };
  return Object.assign(group, { point });
}

// A rotor of six spokes about its z axis in a pale disc, in front of what encloses it.
export function flywheel(radius) {
  const group = new THREE.Group(), rotor = new THREE.Group(), disc = overlay(COLOURS.wheel, 0.3), spoke = overlay(COLOURS.wheel, 0.95);
  const rim = new THREE.Mesh(new THREE.TorusGeometry(radius, 0.08 * radius, 6, 28), spoke);
  const parts = [0, 1, 2].map((k) => new THREE.Mesh(new THREE.BoxGeometry(2 * radius, 0.12 * radius, 0.12 * radius).rotateZ((k * Math.PI) / 3), spoke));
  const mark = new THREE.Mesh(new THREE.SphereGeometry(0.2 * radius, 8, 6).translate(0.72 * radius, 0, 0), spoke); // by which a turn is seen
  rotor.add(rim, mark, ...parts);
  group.add(rotor, new THREE.Mesh(new THREE.CircleGeometry(radius, 28), Object.assign(disc, { side: THREE.DoubleSide })));
  group.children[1].renderOrder = 16;
  for (const part of rotor.children) part.renderOrder = 17;
  return group;
}

// Around what a body shows, in its own frame, and around its largest part.
export function boxesOf(node) {
  const box = new THREE.Box3(), none = new THREE.Box3(new THREE.Vector3(), new THREE.Vector3()), size = new THREE.Vector3();
  let [main, most] = [none, -1];
  for (const { geometry, matrix, userData } of node.children) {
    if (!userData.colours || (userData.opacity < 0.5 && main !== none)) continue; // neither axes and names, nor keep-out shapes and cones
    geometry.computeBoundingBox();
    const own = geometry.boundingBox.clone().applyMatrix4(matrix), volume = own.getSize(size).x * size.y * size.z;
    if (volume > most) [main, most] = [own, volume];
    box.union(own);
  }
  return { box: box.isEmpty() ? none : box, main };
}

export function ball(radius, colour, order) {
  const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 16, 12), overlay(colour, 1));
  mesh.renderOrder = order;
  return mesh;
}

// Thin lines, one for each tip of each sample: points (samples, times, tips, 3).
export function cloudOf(points, [samples, times, tips]) {
  const places = [], colours = [];
  for (let s = 0; s < samples; s++) {
    for (let k = 0; k < tips; k++) {
      const { r, g, b } = paint(tipColour(k)), at = (i) => 3 * ((s * times + i) * tips + k);
      for (let i = 0; i + 1 < times; i++) {
        for (const j of [at(i), at(i + 1)]) {
          places.push(points[j], points[j + 1], points[j + 2]);
          colours.push(r, g, b);
        }
      }
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
  geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 3));
  const material = new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.35, depthTest: false, toneMapped: false });
  const lines = new THREE.LineSegments(geometry, material);
  lines.renderOrder = 9;
  lines.frustumCulled = false;
  return lines;
}

const PARTICLES = 110;
export const PIXELS = { value: 1 }; // of a metre at one metre's distance, for all plumes

// Gas that leaves a nozzle against the force on the body: soft particles that widen and fade, where time has carried them.
export function plume(colour) {
  const geometry = new THREE.BufferGeometry(), uniforms = { time: { value: 0 }, pixels: PIXELS, colour: { value: paint(colour) } };
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(Array.from({ length: 3 * PARTICLES }, scattered(11)), 3));
  const gas = new THREE.Points(geometry, new THREE.ShaderMaterial({
    uniforms, transparent: true, depthWrite: false, blending: THREE.AdditiveBlending,
    vertexShader: `uniform float time; uniform float pixels; varying float age; void main() {
      age = fract(position.x + 1.7 * time); float turn = 6.2832 * position.y, off = (0.02 + 0.24 * age) * sqrt(position.z);
      vec4 seen = modelViewMatrix * vec4(off * cos(turn), -age, off * sin(turn), 1.0);
      gl_PointSize = clamp(pixels * length(modelMatrix[1].xyz) * (0.1 + 0.42 * age) / -seen.z, 1.0, 96.0); gl_Position = projectionMatrix * seen; }`,
    fragmentShader: `uniform vec3 colour; varying float age; void main() {
      float soft = 1.0 - smoothstep(0.0, 0.5, length(gl_PointCoord - 0.5));
      gl_FragColor = vec4(mix(vec3(1.0), colour, sqrt(age)), 1.0) * soft * soft * 0.6 * (1.0 - age) * (1.0 - age); }`,
  }));
  gas.frustumCulled = false;
  gas.renderOrder = 15;
  const fire = (from, force, shortest, time) => {
    const length = force.length();
    gas.visible = length > shortest;
    if (!gas.visible) return;
    uniforms.time.value = time;
    gas.position.copy(from);
    gas.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), force.clone().divideScalar(length));
    gas.scale.setScalar(1.6 * length);
  };
  const refine = (share) => geometry.setDrawRange(0, Math.round(share * PARTICLES));
  return Object.assign(gas, { fire, refine });
}

// A body's own axes: x red, y green, z blue.
export function triad(length) {
  const group = new THREE.Group();
  [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
    const points = new Float32Array([0, 0, 0, ...axis.map((v) => v * length)]);
    const line = tube(points, 0.03 * length, overlay(AXIS_COLOURS[k], 1));
    line.renderOrder = 25;
    group.add(line);
  });
  return group;
}

export function tipColour(k) {
  return TIP_COLOURS[k % TIP_COLOURS.length];
}

// Colour of a signal: that of its tip, of its body, of all together, or one of its own.
export function signalColour([kind, k]) {
  return kind === "all" ? "#ffffff" : tipColour(k);
}
