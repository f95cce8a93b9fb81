// Three.js objects from the page's plain data. MeshCat brings Three.js with it.
const THREE = MeshCat.THREE;
// Of tips, and of curves: far from each other, and from a dark page as well as, darkened, from a light one.
const TIP_COLOURS = [
  "#56b4e9", "#ffb000", "#f29ad0", "#f0e442", "#9be564", "#c9b6ff", "#dc28f0", "#f0503c", "#a08c50", "#28f0dc", "#28f028", "#f03cb4",
  "#50a064", "#7878f0", "#788c8c", "#f0a08c", "#f05078", "#28f0a0", "#c87828", "#c8dca0", "#8ca028", "#dc78f0", "#28a028", "#f0c864",
];
const AXIS_COLOURS = ["#ff5c5c", "#5ee05e", "#6fa8ff"];
const COLOURS = {
  target: "#35e0a1", force: "#ff5c6c", contact: "#c77dff", impulse: "#ff9d2e", reference: "#ffffff", mate: "#ffffff", grid: "#8fa3b8",
  centre: "#ffd23f", momentum: "#7df9ff", plume: "#ffdca8",
};
const RUN_COLOURS = ["#56b4e9", "#ff8c42", "#9be564", "#f29ad0", "#f0e442", "#c9b6ff"];

// Geometries of the page's meshes, each made once for all solids that show it.
let meshes = [], madeOf;

function keepMeshes(data) {
  if (data === madeOf) return;
  madeOf = data;
  meshes.forEach((geometry) => geometry.dispose());
  meshes = data.map(({ vertices, triangles }) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(floats(vertices), 3));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(triangles)), 1));
    return creased(geometry.toNonIndexed(), Array.from(new Uint32Array(bytes(triangles))));
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

function solidGeometry(solid) {
  const size = solid.size;
  if (solid.kind === "mesh") return meshes[solid.mesh];
  if (solid.kind === "box") return new THREE.BoxGeometry(size[0], size[1], size[2]);
  if (solid.kind === "sphere") return new THREE.SphereGeometry(size[0], 24, 16);
  if (solid.kind === "cone") return new THREE.CylinderGeometry(size[1], size[0], size[2], 32, 1, true).rotateX(Math.PI / 2);
  // a URDF's cylinder lies along z, Three's along y
  return new THREE.CylinderGeometry(size[0], size[0], size[1], 32).rotateX(Math.PI / 2);
}

function solidMesh(solid) {
  const [r, g, b, alpha] = solid.rgba;
  const material = new THREE.MeshPhongMaterial({
    color: new THREE.Color(r, g, b), opacity: alpha, transparent: alpha < 1, shininess: 24, side: THREE.DoubleSide,
  });
  const mesh = new THREE.Mesh(solidGeometry(solid), material);
  mesh.userData.opacity = alpha;
  mesh.userData.colour = material.color.clone();
  mesh.matrixAutoUpdate = false;
  mesh.matrix.fromArray(solid.matrix);
  return mesh;
}

function ghostOf(node) {
  const ghost = new THREE.Group();
  const fill = new THREE.MeshBasicMaterial({ color: "#ffffff", opacity: 0.1, transparent: true, depthWrite: false,
    polygonOffset: true, polygonOffsetFactor: 4, polygonOffsetUnits: 4 });
  const edge = new THREE.LineBasicMaterial({ color: "#ffffff", opacity: 0.55, transparent: true });
  for (const solid of node.solids) {
    const geometry = solidGeometry(solid);
    const parts = [new THREE.Mesh(geometry, fill), new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 30), edge)];
    for (const part of parts) {
      part.matrixAutoUpdate = false;
      part.matrix.fromArray(solid.matrix);
      ghost.add(part);
    }
  }
  return ghost;
}

// Position and quaternion (x, y, z, w).
function setPose(object, pose) {
  object.position.fromArray(pose, 0);
  object.quaternion.fromArray(pose, 3);
}

function overlay(colour, opacity) {
  return new THREE.MeshBasicMaterial({ color: colour, opacity, transparent: true, depthTest: false, depthWrite: false });
}

const SIDES = 6; // of a tube
const RING = Array.from({ length: SIDES }, (_, k) => [Math.cos((2 * Math.PI * k) / SIDES), Math.sin((2 * Math.PI * k) / SIDES)]);

// A round line through n points; six triangles pairs a segment, so that a draw range shows a part of it.
function tube(points, radius, material) {
  const mesh = new THREE.Mesh(tubeGeometry(points, radius), material);
  mesh.frustumCulled = false;
  mesh.perSegment = 6 * SIDES;
  return mesh;
}

// Rings of vertices, the first at the first point; each ring's normal is the one before it, turned as little as can be.
function tubeGeometry(points, radius) {
  const n = points.length / 3, positions = new Float32Array(n * SIDES * 3);
  let [tx, ty, tz, nx, ny, nz] = [1, 0, 0, 0, 0, 1], at = 0; // tangent and normal
  for (let i = 0; i < n; i++) {
    const a = 3 * Math.max(0, i - 1), b = 3 * Math.min(n - 1, i + 1);
    const [dx, dy, dz] = [points[b] - points[a], points[b + 1] - points[a + 1], points[b + 2] - points[a + 2]];
    const length = Math.hypot(dx, dy, dz);
    if (length > 1e-9) [tx, ty, tz] = [dx / length, dy / length, dz / length];
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
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setIndex(new THREE.BufferAttribute(tubeFaces(n), 1));
  return geometry;
}

// Corners of the triangles between n rings, the same for all such tubes.
const facesOf = new Map();

function tubeFaces(n) {
  if (!facesOf.has(n)) {
    const faces = new Uint32Array(Math.max(0, n - 1) * SIDES * 6);
    for (let i = 0, at = 0; i < n - 1; i++) {
      for (let k = 0; k < SIDES; k++, at += 6) {
        const a = i * SIDES + k, b = i * SIDES + ((k + 1) % SIDES);
        faces.set([a, b, a + SIDES, b, b + SIDES, a + SIDES], at);
      }
    }
    facesOf.set(n, faces);
  }
  return facesOf.get(n);
}

function arrow(size, colour) {
  const material = overlay(colour, 1);
  const group = new THREE.Group();
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(size, size, 1, 10).translate(0, 0.5, 0), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(2.8 * size, 6 * size, 14).translate(0, 3 * size, 0), material);
  shaft.renderOrder = head.renderOrder = 30;
  group.add(shaft, head);
  group.point = (from, vector) => {
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
  return group;
}

function ball(radius, colour, order) {
  const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 16, 12), overlay(colour, 1));
  mesh.renderOrder = order;
  return mesh;
}

// Thin lines, one for each tip of each sample: points (samples, times, tips, 3).
function cloudOf(points, [samples, times, tips]) {
  const places = [], colours = [];
  for (let s = 0; s < samples; s++) {
    for (let k = 0; k < tips; k++) {
      const { r, g, b } = new THREE.Color(tipColour(k)), at = (i) => 3 * ((s * times + i) * tips + k);
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
  const material = new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.35, depthTest: false });
  const lines = new THREE.LineSegments(geometry, material);
  lines.renderOrder = 9;
  lines.frustumCulled = false;
  return lines;
}

// A cone of gas that leaves a nozzle against the force on the body.
function plume(colour) {
  const material = new THREE.MeshBasicMaterial({
    color: colour, opacity: 0.6, transparent: true, depthWrite: false, side: THREE.DoubleSide,
  });
  const cone = new THREE.Mesh(new THREE.ConeGeometry(0.22, 1, 20, 1, true).translate(0, -0.5, 0), material);
  cone.renderOrder = 15;
  cone.fire = (from, force, shortest) => {
    const length = force.length();
    cone.visible = length > shortest;
    if (!cone.visible) return;
    cone.position.copy(from);
    cone.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), force.clone().divideScalar(length));
    cone.scale.setScalar(length);
  };
  return cone;
}

// A body's own axes: x red, y green, z blue.
function triad(length) {
  const group = new THREE.Group();
  [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
    const points = new Float32Array([0, 0, 0, ...axis.map((v) => v * length)]);
    const line = tube(points, 0.03 * length, overlay(AXIS_COLOURS[k], 1));
    line.renderOrder = 25;
    group.add(line);
  });
  return group;
}

function tipColour(k) {
  return TIP_COLOURS[k % TIP_COLOURS.length];
}

// Colour of a signal: that of its tip, of its body, of all together, or one of its own.
function signalColour([kind, k]) {
  return kind === "all" ? "#ffffff" : tipColour(k);
}
