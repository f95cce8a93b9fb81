// What surrounds the scene: the sun's light with shadows, earthshine, stars, and with an orbit the planet where it would be.
import { element, floats, locate } from "./format.js";
import { scattered } from "./materials.js";
import { THREE } from "./three.js";

const STARS = 1600, PICTURE = 512; // px of the planet's face
const AIR = 1.012; // radius of the air, in the planet's
const FAR = 0.5; // of the farthest that the camera sees: there the sky is
const SEA = [10, 36, 84], GREEN = [52, 74, 38], DRY = [142, 112, 70]; // of the planet, sRGB
// Where no orbit says where the Earth is, it is a backdrop: 500 km below, its limb so far below the middle of the first view, tilted.
const BACKDROP = { radius: 6378137, distance: Float32Array.of(6878137), angle: Float32Array.of(0) }, LIMB = (5.5 * Math.PI) / 180, TILT = 0.2;
const DARK = "#080c14", STUDIO = "#1d2733";

export class Space {
  constructor(viewer) {
    this.viewer = viewer;
    this.sun = new THREE.DirectionalLight(0xfff4e6, 2.2);
    this.sun.castShadow = true;
    this.shine = new THREE.HemisphereLight(0x9dbdec, 0x6a6560, 1.0);
    this.rim = new THREE.DirectionalLight(0xa9c6ff, 1.2); // from behind: the edges of dark bodies stand out from a dark sky
    this.even = new THREE.HemisphereLight(0xffffff, 0x8a8f98, 1.5); // in place of the sun
    this.sky = new THREE.Group();
    this.stars = stars();
    this.sky.add(this.stars);
    for (const [name, object] of Object.entries({ Sun: this.sun, Target: this.sun.target, Rim: this.rim, Aim: this.rim.target, Shine: this.shine, Even: this.even, Sky: this.sky })) {
      viewer.set_object(["Space", name], object);
    }
  }

  // ``planet``: its radius, and over time its distance and the angle of the way to it; null if there is none.
  // ``backdrop``: whether an Earth is shown although no orbit says where it is.
  load({ towards, planar, planet, time, backdrop }, scale) {
    if (this.earth) this.sky.remove(this.earth);
    this.time = time;
    this.planet = planet && { radius: planet.radius, distance: floats(planet.distance), angle: floats(planet.angle) };
    this.way = null;
    if (!planet && backdrop) [this.planet, this.way] = [BACKDROP, this.below(towards)];
    this.earth = this.planet && earth(this.planet, this.nadir(0).negate());
    if (this.earth) this.sky.add(this.earth);
    const [x, y, z] = planar ? [-0.5, -0.75, 1] : new THREE.Vector3(...towards).applyAxisAngle(new THREE.Vector3(0, 0, 1), -0.75).toArray();
    this.direction = new THREE.Vector3(x, y, planar ? z : Math.max(0.55, z + 0.35)).normalize();
    if (this.planet) this.direction.addScaledVector(this.nadir(0), -Math.max(0, this.direction.dot(this.nadir(0)) + 0.45)).normalize();
    const { shadow } = this.sun, half = 0.62 * scale;
    Object.assign(shadow.camera, { left: -half, right: half, top: half, bottom: -half, near: 0.1 * scale, far: 4 * scale });
    Object.assign(shadow, { bias: -2e-4, normalBias: 2e-3 * scale });
    shadow.camera.updateProjectionMatrix();
    this.reach = 2 * scale;
    this.behind = planar ? new THREE.Vector3(0.8, 0.5, 0.35) : new THREE.Vector3(...towards).multiplyScalar(-0.8).add(new THREE.Vector3(0, 0, 0.5));
    this.behind.addScaledVector(this.direction, -0.6).normalize();
    if (this.planet) this.shine.position.copy(this.nadir(0)); else this.shine.position.set(0, 0, -1);
  }

  // Way to the planet's centre, world axes.
  nadir(k, share = 0) {
    if (this.way) return this.way.clone();
    const { angle } = this.planet, now = angle[k] + (share ? share * (angle[k + 1] - angle[k]) : 0);
    return new THREE.Vector3(-Math.cos(now), -Math.sin(now), 0);
  }

  // Way to the middle of an Earth whose limb lies across the lower part of a view; ``towards``: from the scene to the eye.
  below(towards) {
    const back = new THREE.Vector3(...towards).normalize(), across = new THREE.Vector3(0, 0, 1).cross(back).normalize(), up = back.clone().cross(across);
    const down = up.multiplyScalar(-Math.cos(TILT)).addScaledVector(across, Math.sin(TILT)), angle = Math.asin(BACKDROP.radius / BACKDROP.distance[0]) + LIMB;
    return back.multiplyScalar(-Math.cos(angle)).addScaledVector(down, Math.sin(angle));
  }

  // The sun shines on a point of the scene; the planet is where it is at a time.
  seek(time, centre) {
    this.sun.target.position.copy(centre);
    this.sun.position.copy(this.direction).multiplyScalar(this.reach).add(centre);
    this.rim.target.position.copy(centre);
    this.rim.position.copy(this.behind).multiplyScalar(this.reach).add(centre);
    if (!this.earth) return;
    const [i, share] = this.way ? [0, 0] : locate(this.time, time), way = this.nadir(i, share);
    this.earth.position.copy(way).multiplyScalar(this.planet.distance[i] / this.planet.distance[0]);
    this.earth.userData.sun.value.copy(this.direction);
  }

  show(layer, visible) {
    const { renderer } = this.viewer;
    if (layer === "sun") [this.sun.visible, this.even.visible] = [visible, !visible];
    if (layer === "earthshine") this.shine.visible = this.rim.visible = visible;
    if (layer === "stars") {
      this.stars.visible = visible;
      renderer.setClearColor?.(visible ? DARK : STUDIO, 1);
    }
    if (layer === "earth" && this.earth) this.earth.visible = visible;
  }

  // The sky is round the camera, as far as it sees.
  place(camera) {
    this.sky.position.copy(this.sky.parent.worldToLocal(camera.getWorldPosition(new THREE.Vector3())));
    this.sky.scale.setScalar(FAR * camera.far);
  }
}

function stars() {
  const next = scattered(3), places = [], colours = [], at = new THREE.Vector3(), tint = new THREE.Color();
  for (let k = 0; k < STARS; k++) {
    const [z, turn] = [2 * next() - 1, 2 * Math.PI * next()], flat = Math.sqrt(1 - z * z);
    places.push(...at.set(flat * Math.cos(turn), flat * Math.sin(turn), z).toArray());
    colours.push(...tint.setHSL(next() < 0.3 ? 0.09 : 0.6, 0.35, 0.12 + 0.88 * next() ** 4).toArray());
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
  geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 3));
  return behind(new THREE.Points(geometry, new THREE.PointsMaterial({ vertexColors: true, size: 1.7, sizeAttenuation: false, toneMapped: false })), -100);
}

// Drawn first, and in front of nothing.
function behind(object, order) {
  object.frustumCulled = false;
  object.renderOrder = order;
  Object.assign(object.material, { depthTest: false, depthWrite: false });
  return object;
}

// The planet's face that may be seen, in distances from its centre at the start; ``outward``: from there to the scene.
function earth({ radius, distance, angle }, outward) {
  const size = radius / distance[0], moved = Math.max(...angle.map((a) => Math.abs(a - angle[0])));
  const opening = Math.min(Math.PI, 1.1 * Math.acos(Math.min(0.98, size)) + moved), sun = { value: new THREE.Vector3() };
  const geometry = new THREE.SphereGeometry(1, 96, 64, 0, 2 * Math.PI, 0, opening), { position, uv } = geometry.attributes;
  for (let i = 0; i < position.count; i++) {
    const [x, y, z] = [position.getX(i), position.getY(i), position.getZ(i)], off = Math.acos(Math.min(1, Math.max(-1, y))) / opening, flat = Math.hypot(x, z) || 1;
    uv.setXY(i, 0.5 + (0.5 * off * x) / flat, 0.5 + (0.5 * off * z) / flat);
  }
  const shade = (fragment, more = {}) => new THREE.ShaderMaterial({
    uniforms: { sun, face: { value: null } }, vertexShader: `uniform vec3 sun; varying vec2 at; varying float light; varying float rim; void main() {
      vec3 outward = normalize(mat3(modelMatrix) * normal); vec4 place = modelMatrix * vec4(position, 1.0); at = uv;
      light = smoothstep(-0.12, 0.5, dot(outward, vec3(sun.x, sun.z, -sun.y))); rim = 1.0 - abs(dot(outward, normalize(cameraPosition - place.xyz)));
      gl_Position = projectionMatrix * viewMatrix * place; }`,
    fragmentShader: `uniform sampler2D face; varying vec2 at; varying float light; varying float rim; void main() { ${fragment} }`, ...more,
  });
  const ground = shade("gl_FragColor = vec4(mix(texture2D(face, at).rgb, vec3(0.5, 0.7, 1.0), 0.7 * pow(rim, 3.0)) * (0.02 + 0.98 * light), 1.0);");
  ground.uniforms.face.value = face(opening);
  // brightest at the ground, none at its own edge; opaque to the renderer, which would draw it over all bodies otherwise
  const limb = (1 - Math.sqrt(1 - AIR ** -2)).toFixed(4);
  const air = shade(`float height = clamp((1.0 - rim) / (1.0 - ${limb}), 0.0, 1.0); gl_FragColor = vec4(0.35, 0.6, 1.0, 1.0) * light * height * height * 0.6 * smoothstep(0.4, ${limb}, rim);`, { blending: THREE.AdditiveBlending });
  const group = new THREE.Group(), globe = behind(new THREE.Mesh(geometry, ground), -99);
  // the middle of the face, its y axis, looks at the scene when it begins
  group.add(globe, behind(new THREE.Mesh(new THREE.SphereGeometry(AIR, 96, 64, 0, 2 * Math.PI, 0, opening * 1.1), air), -98));
  group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), outward);
  group.scale.setScalar(size);
  return Object.assign(group, { userData: { sun } });
}

// Seas, land and clouds of no planet in particular, seen from above its middle.
function face(opening) {
  const canvas = element("canvas"), pen = canvas.getContext("2d"), fine = Math.min(9, Math.PI / opening);
  canvas.width = canvas.height = PICTURE;
  const picture = pen.createImageData(PICTURE, PICTURE);
  for (let i = 0; i < PICTURE * PICTURE; i++) {
    const u = (2 * (i % PICTURE)) / PICTURE - 1, v = (2 * Math.floor(i / PICTURE)) / PICTURE - 1, out = Math.hypot(u, v), s = (Math.sin(out * opening) / (out || 1)) * fine;
    const x = s * u + 5, y = Math.cos(out * opening) * fine + 5, z = s * v + 5, warp = 1.2 * clouded(1.3 * x, y + 4, 1.3 * z, 3);
    const land = step(0.5, 0.53, clouded(1.1 * x, 1.1 * y, 1.1 * z, 6)), cloud = step(0.5, 0.78, clouded(3.4 * x + warp, 3.4 * y + warp, 3.4 * z, 6));
    const dry = land > 0 ? clouded(2 * x + 9, 2 * y, 2 * z, 3) : 0;
    for (let c = 0; c < 3; c++) {
      const ground = SEA[c] * (1 - land) + land * (GREEN[c] * (1 - dry) + DRY[c] * dry);
      picture.data[4 * i + c] = ground + cloud * (238 - ground);
    }
    picture.data[4 * i + 3] = 255;
  }
  pen.putImageData(picture, 0, 0);
  return new THREE.CanvasTexture(canvas);
}

function step(low, high, v) {
  return faded(Math.min(1, Math.max(0, (v - low) / (high - low))));
}

// Noise of several octaves, 0 to 1.
function clouded(x, y, z, octaves) {
  let [sum, size] = [0, 0.5];
  for (let k = 0; k < octaves; k++, size /= 2) sum += size * noise(x * 2 ** k + 17 * k, y * 2 ** k, z * 2 ** k);
  return sum / (1 - size * 2) || 0;
}

// At a corner of a grid.
function corner(l, m, n) {
  let h = Math.imul(l, 374761393) + Math.imul(m, 668265263) + Math.imul(n, 1274126177);
  h = Math.imul(h ^ (h >>> 13), 1274126177);
  return ((h ^ (h >>> 16)) >>> 0) / 4294967296;
}

// Between two corners along the first axis.
function edge(i, j, k, a) {
  const from = corner(i, j, k);
  return from + a * (corner(i + 1, j, k) - from);
}

function noise(x, y, z) {
  const i = Math.floor(x), j = Math.floor(y), k = Math.floor(z), a = faded(x - i), b = faded(y - j), c = faded(z - k);
  const low = edge(i, j, k, a), high = edge(i, j, k + 1, a);
  const near = low + b * (edge(i, j + 1, k, a) - low), far = high + b * (edge(i, j + 1, k + 1, a) - high);
  return near + c * (far - near);
}

function faded(t) { return t * t * (3 - 2 * t); }
