// Whether bodies have the same shapes.
import { viewerIn } from "./no_webgl_viewer.js";
import { Eye } from "./camera.js";
import { niceStep } from "./format.js";
import { INSETS, Insets } from "./insets.js";
import { LAYERS } from "./legend.js";
import { isSoftware, refineSurface, shadeSurface } from "./materials.js";
import { Run, extentOf } from "./run.js";
import { LEVELS, Quality } from "./quality.js";
import { COLOURS, PIXELS, RUN_COLOURS, keepMeshes } from "./shapes.js";
import { Space } from "./space.js";
import { THREE } from "./three.js";

const MARKS_IN_AUTO = 0.5; // so large are marks where the camera comes near and goes away

export function alike(nodes, others) {
  return nodes === others || JSON.stringify(nodes) === JSON.stringify(others);
}

// The scene: runs beside or over each other, layers, camera.
export class Scene {
  constructor(pane, side, onResize) {
    this.pane = pane;
    this.viewer = viewerIn(pane);
    this.viewer.gui.domElement.style.display = "none";
    this.viewer.hide_background();
    this.eye = new Eye(this.viewer, pane, side, () => { this.refit(); onResize(); });
    this.runs = [];
    this.over = this.near = false;
    this.followed = "";
    this.time = 0;
    for (const name of ["PointLightNegativeX", "PointLightPositiveX", "FillLight", "SpotLight", "AmbientLight"]) this.viewer.delete_path(["Lights", name]);
    for (const name of ["Grid", "Axes"]) this.viewer.set_property([name], "visible", false);
    this.space = new Space(this.viewer);
    this.quality = new Quality((level) => { this.refine(level); this.redraw(); }, isSoftware());
    this.insets = new Insets(this.viewer, this.pane);
    const draw = this.viewer.render.bind(this.viewer);
    this.viewer.render = () => {
      const { camera, renderer } = this.viewer;
      this.space.place(camera);
      PIXELS.value = renderer.domElement?.height / (2 * Math.tan((camera.fov * Math.PI) / 360));
      draw();
      if (this.runs.length) this.insets.draw(this.runs[0], this.payload);
    };
  }

  // A canvas whose size has changed is black until something is drawn.
  redraw() {
    if (this.runs.length && this.viewer.renderer.domElement) this.viewer.render();
  }

  // Draw as fine as a level says.
  refine(level) {
    const { ratio, shadows, soft, mirrors, creases, gloss, share } = level;
    const { sun: { shadow, shadow: { map } }, sun } = this.space, { renderer } = this.viewer;
    // where edges are not smoothed as they are drawn, they are by more pixels once nothing moves
    const smooth = level !== LEVELS[0] || renderer.getContext?.().getContextAttributes().antialias;
    renderer.setPixelRatio((smooth ? 1 : 1.5) * ratio * window.devicePixelRatio);
    sun.castShadow = shadows > 0;
    const edges = soft ? THREE.PCFShadowMap : THREE.BasicShadowMap, others = renderer.shadowMap && renderer.shadowMap.type !== edges;
    if (others) renderer.shadowMap.type = edges;
    // hard shadows need no more points than the picture
    const points = soft ? shadows : Math.min(shadows, 2 ** Math.floor(Math.log2(Math.max(1, this.pane.clientWidth))));
    if (sun.castShadow && shadow.mapSize.x !== points) {
      shadow.mapSize.set(points, points);
      /** @type {any} */ (map)?.dispose();
      shadow.map = null;
    }
    for (const { nodes, plumes } of this.runs) {
      for (const gas of plumes) gas.refine(share);
      for (const mesh of nodes.flatMap(({ children }) => children).filter(({ material }) => material)) {
        shadeSurface(mesh, gloss);
        refineSurface(mesh.material, mirrors, creases, others);
      }
    }
    this.viewer.set_dirty();
  }

  // ``shown``: whether each layer is, by name; kept, not copied.
  load(payload, shown) {
    this.payload = payload;
    this.shown = shown;
    this.near = false;
    this.auto = payload.shots.length > 1;
    this.followed = "";
    this.time = 0;
    keepMeshes(payload.meshes);
    this.build();
    this.first = extentOf(this.runs);
    this.beyond = [[0, 0, 0], [0, 0, 0]]; // how far motions that came later leave that of the first, m
    this.grid();
    const [{ time, data: { planet } }] = this.runs;
    this.space.load({ ...payload, planet, time }, payload.scale);
    this.arrange();
  }

  // Objects of all runs; paths, arrows and marks are thin where the camera is close.
  build() {
    for (const [k] of this.runs.entries()) this.viewer.delete_path([`run${k}`]);
    const { scale, longest_arrow: longest, greatest_force: force, runs } = this.payload;
    const each = (greatest) => (greatest > 0 ? (longest * scale) / greatest : 0), { momentum, thrust, impulse } = this.greatest;
    const sizes = { scene: scale, newton: each(force), thrust: each(thrust), impulse: each(impulse), newtonSecond: each(momentum) };
    this.runs = runs.map((data, k) => {
      const run = new Run(data, sizes, this.near ? this.closeness() : this.auto ? MARKS_IN_AUTO : 1);
      this.viewer.set_object([`run${k}`], run.root);
      return run;
    });
    for (const [name] of LAYERS) this.show(name);
    this.refine(LEVELS[this.quality.applied]);
  }

  // Other motions of the same bodies: camera, layers and time stay. Whether the objects of the runs are others than before.
  renew(runs) {
    this.quality.stir();
    const same = runs.length === this.runs.length && runs.every(({ nodes }, k) => alike(nodes, this.runs[k].data.nodes));
    this.payload = { ...this.payload, runs };
    if (same) {
      this.runs.forEach((run, k) => { if (run.data.poses === runs[k].poses) run.data = runs[k]; else run.renew(runs[k]); });
    } else {
      this.build();
      this.runs.forEach((run, k) => run.tint(this.colours && this.colours[k], k > 0));
    }
    this.seek(this.time);
    this.widen();
    return !same;
  }

  // The view is fitted to the first motion; another one that leaves it widens it, and it stays wide.
  widen() {
    const most = this.payload.scale, now = extentOf(this.runs.filter(({ data }) => data.completed));
    const [low, high] = now.map((ends, k) => ends.map((end, c) => Math.max(-most, Math.min(most, end - this.first[k][c])) || 0));
    const wider = [low.map((v, c) => Math.min(v, this.beyond[0][c])), high.map((v, c) => Math.max(v, this.beyond[1][c]))];
    const grown = wider.flat().some((v, c) => Math.abs(v - this.beyond.flat()[c]) > 0.01 * most);
    if (!grown) return;
    this.beyond = wider;
    this.refit();
  }

  // What the camera must see.
  get reach() {
    if (this.near) return this.payload.near;
    return [[0, 0, 0], ...this.beyond].flatMap((by) => this.payload.reach.map((point) => point.map((v, c) => v + by[c])));
  }

  // How much smaller the close view is than the whole.
  closeness() {
    const spans = [0, 1, 2].map((c) => {
      const values = this.payload.near.map((p) => p[c]);
      return Math.max(...values) - Math.min(...values);
    });
    return Math.min(1, (1.6 * Math.hypot(...spans)) / this.payload.scale);
  }

  get end() { return Math.max(...this.runs.map((run) => run.end), 1e-9); }

  // Paths of many samples, as one object; none if null.
  setCloud(object) {
    this.viewer.delete_path(["Cloud"]);
    this.cloud = object;
    if (object) this.viewer.set_object(["Cloud"], object);
    this.show("cloud");
  }

  has(layer) {
    if (["grid", "sun", "earthshine", "stars"].includes(layer)) return true;
    if (layer in INSETS) return this.runs.some((run) => run.arrows.length > 0);
    if (layer === "earth") return Boolean(this.space.earth);
    return layer === "cloud" ? Boolean(this.cloud) : this.runs.some((run) => run.layers[layer]?.length > 0);
  }

  // Bodies that a camera can follow.
  get bodies() {
    return this.runs.length ? this.runs[0].data.nodes.filter(({ base }) => base) : [];
  }

  // Colours of runs that lie over each other.
  get colours() {
    return this.over && this.runs.filter(({ data }) => !data.pale).length > 1 ? this.runs.map((_, k) => RUN_COLOURS[k % RUN_COLOURS.length]) : null;
  }

  // Close up, or everything.
  look(how) {
    this.near = how === "near" && this.payload.near.length > 0;
    this.auto = how === "auto" && this.payload.shots.length > 1;
    this.build();
    this.arrange();
  }

  lay(over) {
    this.over = over;
    this.arrange();
  }

  // Lines a round distance apart, below everything: they give the scale.
  grid() {
    const [low, high] = this.payload.box, wide = Math.max(high[0] - low[0], high[1] - low[1]);
    const step = niceStep((wide || this.payload.scale || 1) / 12), half = Math.ceil((4 * wide) / step || 1) * step;
    const grid = new THREE.GridHelper(2 * half, Math.round((2 * half) / step), COLOURS.grid, COLOURS.grid);
    grid.rotateX(Math.PI / 2);
    grid.position.set(Math.round((low[0] + high[0]) / 2 / step) * step, Math.round((low[1] + high[1]) / 2 / step) * step, low[2]);
    Object.assign(grid.material, { transparent: true, opacity: 0.16, depthWrite: false, toneMapped: false });
    this.viewer.set_object(["Scale"], grid);
    this.lines = grid;
    this.show("grid");
    this.spacing = Number(step.toPrecision(3));
  }

  // Of all runs at all times.
  get greatest() {
    const of = (part) => Math.max(...this.payload.runs.map((run) => run[part].greatest));
    return { momentum: of("masses"), thrust: of("plumes"), impulse: of("grips") };
  }

  // What lengths mean, in words.
  get scale() {
    const { greatest_force: force } = this.payload, { momentum, thrust, impulse } = this.greatest;
    const parts = this.shown.grid ? [`grid ${this.spacing} m`] : [];
    const arrows = [];
    if (force > 0 && (this.shown.forces || this.shown.contacts)) arrows.push(`force ${force.toPrecision(3)} N`);
    if (impulse > 0 && this.shown.impulses) arrows.push(`impulse ${impulse.toPrecision(3)} N s`);
    if (momentum > 0 && this.shown.momenta) arrows.push(`momentum ${momentum.toPrecision(3)} N s`);
    if (arrows.length) parts.push(`longest arrow: ${arrows.join(", ")}`);
    if (thrust > 0 && this.shown.plumes) parts.push(`longest plume: ${thrust.toPrecision(3)} N`);
    const { slowed } = this.payload.runs[0].wheels;
    if (slowed > 1 && this.shown.wheels) parts.push(`wheels drawn ${slowed.toPrecision(2)} times slower`);
    return parts.join("; ");
  }

  // Several runs beside each other where most room is, or over each other; the camera sees all of it.
  arrange() {
    const [low, high] = this.payload.box, size = [0, 1, 2].map((c) => high[c] - low[c]);
    const over = this.runs.length < 2 || this.over;
    const shifts = [[0, 0, 0]];
    if (!over) shifts[0] = [size[0] * 1.05, 0, 0];
    if (!over) shifts.push([0, -size[1] * 1.12, 0]);
    const moved = (shift) => this.runs.map((_, k) => shift.map((v) => k * v));
    const points = this.reach, fit = (shift) => this.eye.fit(points, moved(shift), this.payload);
    const distances = shifts.map(fit), best = shifts[distances.indexOf(Math.min(...distances))];
    this.boxes = moved(best).map((shift) => [low, high].map((p) => p.map((v, c) => v + shift[c])));
    this.runs.forEach((run, k) => {
      run.root.position.set(...best.map((v) => k * v));
      run.tint(this.colours && this.colours[k], over && k > 0);
    });
    fit(best);
    if (this.directed) this.eye.direct(this.payload.shots, this.payload.planar, this.end);
    // fitted to the whole motion: what is followed is followed from its beginning on
    for (const run of this.runs) run.seek(0);
    this.eye.hold(this.followedPoint);
    this.seek(this.time);
  }

  // What is free has changed; a camera that a user has put somewhere stays there.
  refit() {
    if (!this.runs.length) return;
    if (this.eye.moved) this.eye.aim();
    else this.arrange();
    this.viewer.set_dirty();
  }

  // Whether the camera goes from shot to shot; runs beside each other are seen as a whole.
  get directed() { return this.auto && !this.followed && (this.over || this.runs.filter(({ data }) => !data.pale).length < 2); }

  get followedPoint() { return this.followed ? this.runs[0].rootOf(this.followed) : null; }

  // The camera goes with a body of the first run; with nothing if the name is empty.
  follow(body) {
    this.followed = this.bodies.some((one) => one.body === body) ? body : "";
    if (this.eye.moved) this.eye.hold(this.followedPoint); else this.arrange();
  }

  show(layer) {
    if (!this.shown) return;  // nothing is loaded yet, as before the studio's first motion
    this.space.show(layer, this.shown[layer]);
    if (layer in INSETS) this.insets.show(layer, this.shown[layer]);
    if (layer === "grid" && this.lines) this.lines.visible = this.shown.grid;
    if (layer === "cloud" && this.cloud) this.cloud.visible = this.shown.cloud;
    for (const run of this.runs) if (run.layers[layer]) run.show(layer, this.shown[layer]);
    this.viewer.set_dirty();
  }

  seek(time) {
    this.time = time;
    for (const run of this.runs) {
      run.seek(time);
      for (const layer of ["forces", "contacts", "impulses", "plumes", "momenta"]) if (!this.shown[layer]) run.show(layer, false);
    }
    if (this.directed && !this.eye.moved) this.eye.play(time); else this.eye.follow(this.followedPoint);
    this.space.seek(time, new THREE.Vector3().fromArray([0, 1, 2].map((c) => (this.payload.box[0][c] + this.payload.box[1][c]) / 2)));
    this.viewer.set_dirty();
  }

  // Draw now what is to be seen, and give the canvas it is on.
  render() {
    this.viewer.render();
    return this.viewer.renderer.domElement;
  }
}
