import { THREE } from "./three.js";

const TO_NAMES = 24, TO_SCALE = 24; // px that the scene leaves to names above it and to the scale below

const TURNING = 0.5; // of the shorter of two shots: so long the eye goes from one to the other

// The view: everything that ever moves fills what the words leave of the pane, from above where the scene is planar.
export class Eye {
  constructor(viewer, pane, side, onResize) {
    this.viewer = viewer;
    this.pane = pane;
    this.side = side;
    this.moved = false;
    this.anchor = null;
    // the viewer measures the window; the pane is only a part of it
    viewer.set_3d_pane_size = () => {
      const width = Math.max(1, pane.clientWidth), height = Math.max(1, pane.clientHeight);
      viewer.camera.aspect = width / height;
      viewer.camera.updateProjectionMatrix();
      viewer.renderer.setSize(width, height);
      onResize();
      viewer.set_dirty();
    };
    const { controls } = viewer;
    controls.addEventListener("start", () => { this.touched = true; });
    controls.addEventListener("change", () => { this.moved ||= this.touched; });
    // a wheel's turn ends before the camera has moved
    controls.addEventListener("end", () => setTimeout(() => { this.touched = false; }, 100));
  }

  // Room that the scene leaves to words, px; these stand in a column at the left, or in a row above.
  get room() {
    const parts = [...this.side.children].filter((part) => part.offsetWidth > 0);
    const beside = getComputedStyle(this.side).getPropertyValue("--stands").trim() === "beside";
    const right = Math.max(0, ...parts.map((part) => this.side.offsetLeft + part.offsetLeft + part.offsetWidth));
    const below = Math.max(0, ...parts.map((part) => this.side.offsetTop + part.offsetTop + part.offsetHeight));
    return beside ? { left: right + 4, top: TO_NAMES } : { left: 0, top: below + TO_NAMES };
  }

  // MeshCat's world has z up, Three's camera y.
  static toThree(p) { return new THREE.Vector3(p[0], p[2], -p[1]); }

  // ``towards``: from the scene to the eye.
  axes(planar, towards) {
    if (planar) return { back: new THREE.Vector3(0, 1, 1e-4).normalize(), up: new THREE.Vector3(0, 0, -1) };
    const back = Eye.toThree(towards).normalize();
    const across = new THREE.Vector3(0, 1, 0).cross(back).normalize();
    return { back, up: back.clone().cross(across) };
  }

  // Half the extents (tangents) of points seen from a distance, and the middles of those extents.
  spread(points, centre, distance, { back, across, up }) {
    const spans = [across, up].map((axis) => {
      const seen = points.map((p) => p.clone().sub(centre)).map((p) => p.dot(axis) / (distance - p.dot(back)));
      return [Math.min(...seen), Math.max(...seen)];
    });
    return spans.map(([least, most]) => ({ half: (most - least) / 2, middle: (most + least) / 2 }));
  }

  // The camera looks at the middle of what is free; tangents of half of that, across and up.
  aim() {
    const camera = this.viewer.camera, { left, top } = this.room;
    const width = Math.max(1, this.pane.clientWidth), height = Math.max(1, this.pane.clientHeight);
    const [free, tall] = [Math.max(40, width - left), Math.max(40, height - top - TO_SCALE)];
    camera.setViewOffset(width, height, -left / 2, (TO_SCALE - top) / 2, width, height);
    const half = (Math.tan((camera.fov * Math.PI) / 360) * 0.94) / height;
    return [half * free, half * tall];
  }

  // Points that must be seen, in copies of the scene moved by ``shifts``; the distance of the eye that results.
  fit(points, shifts, { planar, towards }) {
    const { camera } = this.viewer, { centre, back, distance } = this.framed(points, shifts, { planar, towards });
    camera.near = distance / 200;
    camera.far = distance * 20;
    this.moved = false;
    this.stand(centre.clone().addScaledVector(back, distance), centre);
    return distance;
  }

  // The same as what is looked at, the way back to the eye, and its distance.
  framed(points, shifts, { planar, towards }) {
    const { camera } = this.viewer, { back, up } = this.axes(planar, towards);
    const frame = { back, up, across: up.clone().cross(back).normalize() };
    camera.fov = planar ? 14 : 26;
    const [wide, tall] = this.aim();
    const all = shifts.flatMap((shift) => points.map((p) => Eye.toThree(p.map((v, c) => v + shift[c]))));
    const box = new THREE.Box3().setFromPoints(all), centre = box.getCenter(new THREE.Vector3());
    const radius = Math.max(1e-6, box.getSize(new THREE.Vector3()).length() / 2);
    let distance = (2 * radius) / Math.min(tall, wide);
    for (let k = 0; k < 12; k++) {
      const [x, y] = this.spread(all, centre, distance, frame);
      centre.addScaledVector(frame.across, x.middle * distance).addScaledVector(frame.up, y.middle * distance);
      distance = Math.max(1.05 * radius, distance * Math.max(x.half / wide, y.half / tall));
    }
    return { centre, back, distance };
  }

  // Shots over time: the eye goes from one to the next within a share of the shorter one, and rests between.
  direct(shots, planar, end) {
    this.shots = shots.map(({ time, points, towards }) => ({ time, ...this.framed(points, [[0, 0, 0]], { planar, towards }) }));
    this.shots.forEach((one, k) => { one.lasts = (this.shots[k + 1]?.time ?? end) - one.time; });
  }

  play(time) {
    const { shots } = this, k = Math.max(0, shots.findLastIndex((one) => one.time <= time)), shot = shots[k];
    const centre = shot.centre.clone(), back = shot.back.clone(), smooth = (t) => t * t * (3 - 2 * t);
    let { distance } = shot;
    const towards = (other, share) => {
      centre.lerp(other.centre, share);
      back.lerp(other.back, share).normalize();
      distance *= (other.distance / distance) ** share;
    };
    // it moves while it is the farther one of two shots: from near it stands still
    const next = shots[k + 1], before = shots[k - 1], within = (other) => TURNING * Math.min(shot.lasts, other.lasts);
    if (next && next.distance <= shot.distance) towards(next, smooth(Math.max(0, 1 - (next.time - time) / within(next))));
    if (before && before.distance < shot.distance) towards(before, smooth(Math.max(0, 1 - (time - shot.time) / within(before))));
    const { camera } = this.viewer, most = Math.max(...shots.map((one) => one.distance));
    [camera.near, camera.far] = [distance / 200, 20 * most];
    this.stand(centre.clone().addScaledVector(back, distance), centre);
  }

  stand(position, target) {
    this.viewer.camera.position.copy(position);
    this.viewer.controls.target.copy(target);
    this.viewer.controls.update();
    this.viewer.set_dirty();
  }

  // Follow a point of the world (null: none): the camera moves as it does from now on.
  hold(point) {
    this.anchor = point ? Eye.toThree(point.toArray()) : null;
  }

  follow(point) {
    if (!point || !this.anchor) return;
    const now = Eye.toThree(point.toArray()), moved = now.clone().sub(this.anchor);
    this.anchor = now;
    this.viewer.camera.position.add(moved);
    this.viewer.controls.target.add(moved);
    this.viewer.controls.update();
  }

  // From what is looked at to the eye: distance, and angles from above and around (rad).
  get arm() {
    return new THREE.Spherical().setFromVector3(this.viewer.camera.position.clone().sub(this.viewer.controls.target));
  }

  set arm(arm) {
    const target = this.viewer.controls.target.clone();
    this.moved = true;
    this.stand(new THREE.Vector3().setFromSpherical(arm).add(target), target);
  }

  // Where a user has put it: what is looked at, beside what is followed, and the arm; null if no user has.
  get pose() {
    if (!this.moved) return null;
    const { radius, phi, theta } = this.arm, from = this.anchor || new THREE.Vector3();
    return [...this.viewer.controls.target.clone().sub(from).toArray(), radius, phi, theta];
  }

  set pose([x, y, z, ...arm]) {
    this.viewer.controls.target.set(x, y, z).add(this.anchor || new THREE.Vector3());
    this.arm = new THREE.Spherical(...arm);
  }

  // Go round what is looked at (rad), or nearer to it.
  turn(across, up, nearer = 1) {
    const arm = this.arm;
    arm.theta += across;
    arm.phi = Math.min(Math.PI - 0.01, Math.max(1e-4, arm.phi + up));
    arm.radius /= nearer;
    this.arm = arm;
  }

  // Whether a key meant something.
  key(name) {
    const step = 0.1, act = {
      ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step],
      "+": [0, 0, 1.15], "-": [0, 0, 1 / 1.15],
    }[name];
    if (act) this.turn(...act);
    return Boolean(act);
  }
}
