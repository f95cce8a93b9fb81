// One run in the scene: bodies, ghosts, paths, forces, at any time.
import { floats, locate } from "./format.js";
import { paint } from "./materials.js";
import { COLOURS, arrow, ball, boxesOf, dye, flywheel, ghostOf, overlay, plume, setPose, surfaces, tipColour, triad } from "./shapes.js";
import { THREE } from "./three.js";
import { grow, tube, tubeGeometry } from "./tubes.js";

const FLASH_S = 1, IMPULSE_S = 0.4; // of simulated time
const PALE = "#dfe6ee"; // the design before

export class Run {
  // ``sizes``: of the scene, of arrows a newton, of thrust a newton, and a newton second, all in metres; ``closeness`` shrinks what marks.
  constructor(data, sizes, closeness) {
    this.read(data);
    this.scale = sizes.scene * closeness;
    this.metresPerNewton = sizes.newton * closeness;
    this.metresPerThrust = sizes.thrust * closeness;
    this.metresPerImpulse = sizes.impulse * closeness;
    this.metresPerNewtonSecond = sizes.newtonSecond * closeness;
    this.root = new THREE.Group();
    this.layers = {
      ghosts: [], reference: [], traces: [], forces: [], contacts: [], impulses: [], plumes: [], wheels: [], mates: [], frames: [], centres: [], momenta: [],
    };
    this.vector = new THREE.Vector3();
    this.from = new THREE.Vector3();
    this.turn = new THREE.Quaternion();
    // bodies, where each began, and their axes
    this.ghosts = [];
    this.nodes = this.data.nodes.map((node, k) => {
      const group = new THREE.Group();
      for (const mesh of surfaces(node.solids, this.scale)) group.add(mesh);
      this.root.add(group);
      if (node.base) {
        const ghost = this.put("ghosts", ghostOf(node, this.scale), 2);
        setPose(ghost, this.poses.subarray(7 * k, 7 * k + 7));
        this.ghosts.push([ghost, k]);
        const axes = triad(0.06 * this.scale);
        this.layers.frames.push(axes);
        group.add(axes);
      }
      return group;
    });
    // paths of references, tips and the object
    const thin = 0.0011 * this.scale, thick = 0.0021 * this.scale;
    this.growing = [];
    this.paths = [];
    this.data.references.forEach((_, k) => {
      this.path("reference", () => floats(this.data.references[k]), thin, overlay(COLOURS.reference, 0.75), 10);
    });
    const tips = this.data.tip_names.length;
    this.tipBalls = this.data.tip_names.map((_, k) => {
      const colour = tipColour(k);
      this.grow(() => this.column(this.tips, tips, k), thick, colour, 12);
      return this.put("mates", ball(0.0052 * this.scale, colour, 21));
    });
    if (this.data.target) {
      this.grow(() => floats(this.data.target), thick, COLOURS.target, 11);
    }
    // forces of grips and contacts, impulses, and flashes of captures
    const grips = this.data.grasp_tips;
    this.arrows = grips.map(() => this.put("forces", arrow(0.0028 * this.scale, COLOURS.force)));
    this.mateBalls = grips.map(() => this.put("mates", ball(0.0072 * this.scale, COLOURS.mate, 20)));
    this.flashes = grips.map((tip) => this.tipBalls[tip].add(ball(0.0052 * this.scale, COLOURS.mate, 19)).children.at(-1));
    const struck = this.data.grips.impulses.length > 0 ? grips : [];
    this.impulseArrows = struck.map(() => this.put("impulses", arrow(0.0028 * this.scale, COLOURS.impulse)));
    const touches = Array.from({ length: this.data.contacts.count });
    this.contactArrows = touches.map(() => this.put("contacts", arrow(0.0028 * this.scale, COLOURS.contact)));
    // centres of mass of bodies and, last, of all together; momenta at them
    const { count: masses } = this.data.masses;
    this.centreBalls = Array.from({ length: masses }, (_, k) => (
      this.put("centres", ball(0.006 * this.scale, k === masses - 1 ? "#ffffff" : COLOURS.centre, 22))
    ));
    this.momentumArrows = this.centreBalls.map(() => this.put("momenta", arrow(0.0028 * this.scale, COLOURS.momentum)));
    // reaction wheels are seen through their base, each beside its middle along its axis
    const { nodes, axes } = this.data.wheels, radius = 0.026 * this.scale, up = new THREE.Vector3(0, 0, 1);
    this.wheels = axes.map((axis, k) => {
      const base = this.nodes[nodes[k]], shown = flywheel(radius), along = new THREE.Vector3(...axis);
      boxesOf(base).box.getCenter(shown.position).addScaledVector(along, 2.2 * radius);
      shown.quaternion.setFromUnitVectors(up, along);
      this.layers.wheels.push(shown);
      base.add(shown);
      return shown.children[0];
    });
    this.plumes = Array.from({ length: data.plumes.count }, () => this.put("plumes", plume(COLOURS.plume)));
    if (data.pale) this.fade();
  }

  read(data) {
    this.data = data;
    this.time = floats(data.time);
    this.bent = Object.fromEntries([["1", floats(data.poses)], ...Object.entries(data.bent || {}).map(([k, poses]) => [k, floats(poses)])]);
    this.enlarge(this.factor || "1");
    this.tips = floats(data.tips);
    this.forces = floats(data.forces);
    this.mates = floats(data.mates);
    this.held = floats(data.grips.held);
    this.impulses = data.grips.impulses; // of impacts at each grasp
    this.touching = floats(data.contacts.forces);
    this.touched = floats(data.contacts.points);
    this.thrusts = floats(data.plumes.forces);
    this.nozzles = floats(data.plumes.points);
    this.angles = floats(data.wheels.angles); // of reaction wheels about their axes, rad
    this.fineTime = floats(data.fine_time);
    this.errors = data.errors.map((values) => values && floats(values)); // null: a tip that nothing leads
    this.centres = floats(data.masses.centres);
    this.momenta = floats(data.masses.momenta);
  }

  // Deflections of flexible links by a factor, of those that there are.
  enlarge(factor) {
    this.factor = factor;
    this.poses = this.bent[factor] || this.bent["1"];
  }

  // Another motion of the same bodies.
  renew(data) {
    this.read(data);
    for (const { mesh, points, radius } of this.paths) {
      mesh.geometry.dispose();
      mesh.geometry = tubeGeometry(points(), radius);
    }
    this.ghosts.forEach(([ghost, k]) => setPose(ghost, this.poses.subarray(7 * k, 7 * k + 7)));
  }

  // The design before: its bodies and paths, pale, and nothing else of it.
  fade() {
    for (const objects of Object.values(this.layers)) for (const object of objects) object.removeFromParent();
    for (const key of Object.keys(this.layers)) this.layers[key] = [];
    this.layers.before = [...this.nodes, ...this.growing];
    this.root.add(...this.growing);
  }

  put(layer, object, order) {
    if (order !== undefined) object.renderOrder = order;
    this.layers[layer].push(object);
    this.root.add(object);
    return object;
  }

  // A path that grows with time.
  grow(points, radius, colour, order) {
    const path = this.path("traces", points, radius, overlay(colour, 1), order);
    path.userData.colour = colour;
    this.growing.push(path);
  }

  // ``points`` gives those of the run's present data.
  path(layer, points, radius, material, order) {
    const mesh = this.put(layer, tube(points(), radius, material), order);
    this.paths.push({ mesh, points, radius });
    return mesh;
  }

  column(values, count, k) {
    const n = values.length / (3 * count), found = new Float32Array(3 * n);
    for (let i = 0; i < n; i++) for (let c = 0; c < 3; c++) found[3 * i + c] = values[3 * (i * count + k) + c];
    return found;
  }

  get end() {
    return this.time[this.time.length - 1];
  }

  // Size of a tip's error at a time, m.
  error(k, time) {
    const values = this.errors[k], [i, share] = locate(this.fineTime, time);
    return Math.hypot(...this.between(values, 1, 0, i, share, this.vector).toArray());
  }

  // Where a body's root is at a time, in the scene.
  rootOf(body) {
    const k = this.data.nodes.findIndex((node) => node.base && node.body === body);
    return k < 0 ? null : this.nodes[k].position.clone().add(this.root.position);
  }

  between(values, count, k, i, share, into) {
    const a = 3 * (i * count + k), b = share > 0 ? a + 3 * count : a;
    return into.set(...[0, 1, 2].map((c) => values[a + c] + share * (values[b + c] - values[a + c])));
  }

  seek(time) {
    const [i, share] = locate(this.time, time), count = this.nodes.length;
    this.nodes.forEach((node, k) => {
      const a = 7 * (i * count + k), b = share > 0 ? a + 7 * count : a;
      this.place(node, a, b, share);
    });
    for (const trace of this.growing) grow(trace, i);
    const tips = this.tipBalls.length, grips = this.arrows.length, masses = this.centreBalls.length;
    this.tipBalls.forEach((dot, k) => this.between(this.tips, tips, k, i, share, dot.position));
    this.mateBalls.forEach((dot, k) => {
      this.between(this.mates, grips, k, i, share, dot.position);
      // where nothing is held yet, smaller than a tip: no ring around one that passes
      dot.scale.setScalar(this.held[i * grips + k] ? 1 : 0.5);
      this.flash(this.flashes[k], this.data.grips.captures[k], time);
    });
    this.arrows.forEach((shown, k) => {
      this.between(this.tips, tips, this.data.grasp_tips[k], i, share, this.from);
      this.between(this.forces, grips, k, i, share, this.vector).multiplyScalar(this.metresPerNewton);
      this.point(shown);
    });
    this.impulseArrows.forEach((shown, k) => {
      this.between(this.tips, tips, this.data.grasp_tips[k], i, share, this.from);
      const last = this.impulses[k].filter(([at]) => time >= at && time < at + IMPULSE_S).at(-1) || [0, 0, 0, 0];
      this.vector.fromArray(last, 1).multiplyScalar(this.metresPerImpulse);
      this.point(shown);
    });
    const touches = this.contactArrows.length;
    this.contactArrows.forEach((shown, k) => {
      this.between(this.touched, touches, k, i, share, this.from);
      this.between(this.touching, touches, k, i, share, this.vector).multiplyScalar(this.metresPerNewton);
      this.point(shown);
    });
    const wheels = this.wheels.length;
    this.wheels.forEach((rotor, k) => {
      const a = i * wheels + k, angle = this.angles[a];
      rotor.rotation.z = angle + (share > 0 ? share * (this.angles[a + wheels] - angle) : 0);
    });
    const nozzles = this.plumes.length;
    this.plumes.forEach((shown, k) => {
      this.between(this.nozzles, nozzles, k, i, share, this.from);
      this.between(this.thrusts, nozzles, k, i, share, this.vector).multiplyScalar(this.metresPerThrust);
      shown.fire(this.from, this.vector, 0.001 * this.scale, time);
    });
    this.centreBalls.forEach((dot, k) => {
      this.between(this.centres, masses, k, i, share, dot.position);
      this.from.copy(dot.position);
      this.between(this.momenta, masses, k, i, share, this.vector).multiplyScalar(this.metresPerNewtonSecond);
      this.point(this.momentumArrows[k]);
    });
  }

  // A disc that grows and fades for a second after a capture.
  flash(disc, captures, time) {
    const passed = Math.min(...captures.map((at) => (time >= at ? time - at : Infinity)));
    disc.visible = passed < FLASH_S;
    if (!disc.visible) return;
    disc.scale.setScalar(1 + (5 * passed) / FLASH_S);
    disc.material.opacity = 0.8 * (1 - passed / FLASH_S);
  }

  // What a diverged run does in its last instants would leave the picture.
  point(shown) {
    shown.point(this.from, this.vector.clampLength(0, 0.4 * this.scale));
  }

  place(node, a, b, share) {
    const p = this.poses;
    node.position.set(...[0, 1, 2].map((c) => p[a + c] + share * (p[b + c] - p[a + c])));
    node.quaternion.fromArray(p, a + 3);
    if (share > 0) node.quaternion.slerp(this.turn.fromArray(p, b + 3), share);
  }

  show(layer, visible) {
    // an arrow too short to draw hides itself at the next seek
    for (const object of this.layers[layer]) object.visible = visible;
  }

  // Over another run: in a colour of its own, and where ``faint`` half transparent; as it is without a colour.
  tint(colour, faint) {
    if (this.data.pale) [colour, faint] = [PALE, true];
    const side = this.data.pale ? 1 : -1;
    for (const node of this.nodes) {
      for (const mesh of node.children.filter((child) => child.userData.opacity !== undefined)) {
        const { opacity, side: own } = mesh.userData;
        dye(mesh, colour);
        mesh.material.opacity = (this.data.pale ? 0.3 : faint ? 0.55 : 1) * opacity;
        mesh.material.transparent = faint || opacity < 1;
        mesh.material.side = this.data.pale ? THREE.FrontSide : own; // what is transparent on both sides is drawn twice
        // two runs of one planar scene lie in the same planes: the faint one is drawn over the other, the pale one under it
        Object.assign(mesh.material, { polygonOffset: faint, polygonOffsetFactor: side, polygonOffsetUnits: 8 * side });
      }
    }
    for (const trace of this.growing) trace.material.color.copy(paint(colour || trace.userData.colour));
  }
}

// Least and greatest place of any body of some runs at any time.
export function extentOf(runs) {
  const low = [Infinity, Infinity, Infinity], high = low.map((v) => -v);
  for (const { poses } of runs) {
    for (let i = 0; i < poses.length; i += 7) {
      for (let c = 0; c < 3; c++) {
        low[c] = Math.min(low[c], poses[i + c]);
        high[c] = Math.max(high[c], poses[i + c]);
      }
    }
  }
  return [low, high];
}
