// What surrounds the scene: the sun's light with shadows, earthshine, stars, and with an orbit the planet where it would be.
import { floats, locate } from "./format.js";
import { scattered } from "./materials.js";
import { THREE } from "./three.js";

const STARS = 1600, PICTURE = 512, GRAIN = 128; // px of the planet's face, if that is a square, and of the grain of its clouds
const AIR = 1.012; // radius of the air, in the planet's
const FAR = 0.5; // of the farthest that the camera sees: there the sky is
const SEA = [10, 36, 84], GREEN = [52, 74, 38], DRY = [142, 112, 70]; // of the planet, sRGB
// Where no orbit says where the Earth is, it is a backdrop: 500 km below, its limb so far below the middle of the first view, tilted.
const BACKDROP = { radius: 6378137, distance: Float32Array.of(6878137), angle: Float32Array.of(0) }, LIMB = (5.5 * Math.PI) / 180, TILT = 0.2;
const DARK = "#080c14", STUDIO = "#1d2733";
const SUN = { colour: new THREE.Color(0xfff4e6), strength: 2.2 }, MOON = { colour: new THREE.Color(0xb4c8ff), strength: 1.2 }; // light by day and in the planet's shadow
const PENUMBRA = 0.02; // rad around the planet's edge in which the sun fades

export class Space {
  constructor(viewer) {
    this.viewer = viewer;
    this.sun = new THREE.DirectionalLight(SUN.colour, SUN.strength);
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
    this.shine.position.set(0, 0, -1);
    this.sun.color.copy(SUN.colour);
    this.sun.intensity = SUN.strength;
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
    this.shine.position.copy(way);
    const day = step(-PENUMBRA, PENUMBRA, this.direction.angleTo(way) - Math.asin(this.planet.radius / this.planet.distance[i]));
    this.sun.color.copy(MOON.colour).lerp(SUN.colour, day);
    this.sun.intensity = MOON.strength + day * (SUN.strength - MOON.strength);
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

// The belt of the planet that may be seen, in distances from its centre at the start; ``outward``: from there to the scene.
function earth({ radius, distance, angle }, outward) {
  const size = radius / distance[0], seen = 1.1 * Math.acos(Math.min(0.98, size)), sun = { value: new THREE.Vector3() };
  const [first, last] = [Math.min(...angle), Math.max(...angle)];
  const belt = (half) => ({ from: first - half, along: Math.min(2 * Math.PI, last - first + 2 * half), above: Math.max(0, Math.PI / 2 - half), across: Math.min(Math.PI, 2 * half) });
  const shell = (height, { from, along, above, across }) => new THREE.SphereGeometry(height, Math.ceil(along / 0.025), Math.ceil(across / 0.025), Math.PI + from, along, above, across);
  const shade = (fragment, more = {}) => new THREE.ShaderMaterial({
    uniforms: { sun, face: { value: null }, grain: { value: null }, tiles: { value: new THREE.Vector2() } },
    vertexShader: `uniform vec3 sun; varying vec2 at; varying float light; varying float rim; void main() {
      vec3 outward = normalize(mat3(modelMatrix) * normal); vec4 place = modelMatrix * vec4(position, 1.0); at = uv;
      light = smoothstep(-0.12, 0.5, dot(outward, vec3(sun.x, sun.z, -sun.y))); rim = 1.0 - abs(dot(outward, normalize(cameraPosition - place.xyz)));
      gl_Position = projectionMatrix * viewMatrix * place; }`,
    fragmentShader: `uniform sampler2D face; uniform sampler2D grain; uniform vec2 tiles; varying vec2 at; varying float light; varying float rim; void main() { ${fragment} }`, ...more,
  });
  // the grain frays the edges of clouds and coasts; by night there are moonlit clouds, the lights of towns, and a glow of the air at the limb
  const ground = shade(`
    vec2 fine = texture2D(grain, at * tiles).rg - 0.5, finer = texture2D(grain, at * tiles * 5.0).rg - 0.5;
    vec4 below = texture2D(face, at + (fine + 0.4 * finer) * 0.16 / tiles);
    vec3 lit = below.rgb * (1.0 + 0.35 * fine.r + 0.3 * finer.r);
    vec3 day = mix(lit, vec3(0.5, 0.7, 1.0), 0.7 * pow(rim, 3.0)), night = lit * vec3(0.09, 0.12, 0.2) + vec3(0.008, 0.014, 0.03);
    night += below.a * smoothstep(0.02, 0.2, finer.g) * vec3(1.0, 0.72, 0.4) * (1.0 - rim) + vec3(0.1, 0.2, 0.24) * pow(rim, 4.0);
    gl_FragColor = vec4(mix(night, day, light), 1.0);`);
  const around = belt(seen);
  Object.assign(ground.uniforms, { face: { value: face(around, seen) }, grain: { value: grain() } });
  ground.uniforms.tiles.value.set(...[around.along, around.across].map((side) => Math.round((6 * side) / seen)));
  // brightest at the ground, none at its own edge; opaque to the renderer, which would draw it over all bodies otherwise
  const limb = (1 - Math.sqrt(1 - AIR ** -2)).toFixed(4);
  const air = shade(`float height = clamp((1.0 - rim) / (1.0 - ${limb}), 0.0, 1.0);
    gl_FragColor = vec4(mix(vec3(0.1, 0.24, 0.26), vec3(0.35, 0.6, 1.0), light), 1.0) * height * height * 0.6 * smoothstep(0.4, ${limb}, rim);`, { blending: THREE.AdditiveBlending });
  const group = new THREE.Group();
  group.add(behind(new THREE.Mesh(shell(1, around), ground), -99), behind(new THREE.Mesh(shell(AIR, belt(1.1 * seen)), air), -98));
  // the belt's x axis looks at the scene when it begins, its y axis is normal to the orbit
  const normal = new THREE.Vector3(0, 0, 1).addScaledVector(outward, -outward.z).normalize();
  group.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(outward, normal, outward.clone().cross(normal)));
  group.scale.setScalar(size);
  return Object.assign(group, { userData: { sun } });
}

// Seas, land and clouds of no planet in particular, on a belt; alpha is where towns are.
function face({ from, along, above, across }, seen) {
  const scale = PICTURE / Math.sqrt(along * across), [wide, tall] = [Math.round(scale * along), Math.round(scale * across)];
  const data = new Uint8Array(4 * wide * tall), fine = Math.min(9, Math.PI / seen);
  for (let i = 0; i < wide * tall; i++) {
    const turn = from + ((i % wide) / wide) * along, down = above + (1 - Math.floor(i / wide) / tall) * across;
    const x = fine * Math.cos(turn) * Math.sin(down) + 5, y = fine * Math.cos(down) + 5, z = fine * Math.sin(turn) * Math.sin(down) + 5;
    const warp = 1.2 * clouded(1.3 * x, y + 4, 1.3 * z, 3);
    const land = step(0.5, 0.53, clouded(1.1 * x, 1.1 * y, 1.1 * z, 6)), cloud = step(0.5, 0.78, clouded(3.4 * x + warp, 3.4 * y + warp, 3.4 * z, 6));
    const dry = land > 0 ? clouded(2 * x + 9, 2 * y, 2 * z, 3) : 0, town = land > 0 ? step(0.52, 0.72, clouded(7 * x, 7 * y + 9, 7 * z, 3)) : 0;
    for (let c = 0; c < 3; c++) {
      const ground = SEA[c] * (1 - land) + land * (GREEN[c] * (1 - dry) + DRY[c] * dry);
      data[4 * i + c] = ground + cloud * (238 - ground);
    }
    data[4 * i + 3] = 255 * land * town * (1 - cloud);
  }
  return smooth(data, wide, tall);
}

// Noise that repeats, of two channels.
function grain() {
  const data = new Uint8Array(4 * GRAIN * GRAIN), next = scattered(5), cells = [8, 16, 32, 64];
  const corners = cells.map((count) => Float32Array.from({ length: 2 * count * count }, next));
  for (let i = 0; i < GRAIN * GRAIN; i++) {
    for (let channel = 0; channel < 2; channel++) {
      let sum = 0;
      cells.forEach((count, octave) => {
        const x = ((i % GRAIN) / GRAIN) * count, y = (Math.floor(i / GRAIN) / GRAIN) * count, a = faded(x % 1), b = faded(y % 1);
        const at = (dx, dy) => corners[octave][2 * (((Math.floor(y) + dy) % count) * count + ((Math.floor(x) + dx) % count)) + channel];
        const low = at(0, 0) + a * (at(1, 0) - at(0, 0)), high = at(0, 1) + a * (at(1, 1) - at(0, 1));
        sum += (low + b * (high - low)) / 2 ** (octave + 1);
      });
      data[4 * i + channel] = (255 * sum) / (1 - 2 ** -cells.length);
    }
  }
  return Object.assign(smooth(data, GRAIN, GRAIN), { wrapS: THREE.RepeatWrapping, wrapT: THREE.RepeatWrapping });
}

function smooth(data, wide, tall) {
  const texture = new THREE.DataTexture(data, wide, tall, THREE.RGBAFormat);
  return Object.assign(texture, { magFilter: THREE.LinearFilter, minFilter: THREE.LinearMipmapLinearFilter, generateMipmaps: true, needsUpdate: true });
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
