// Arrows and rings at the target's initial place: dragged, they move and turn it along and about the world's axes.
import { AXIS_COLOURS, overlay } from "../shapes.js";
import { THREE } from "../three.js";

const SIZE = 0.13; // length of an arrow, as a share of the scene's
const FINE = 1e-4; // m and deg: places to which a dragged number is rounded
const POSITION = "target.base.position", ROTATION = "target.base.rotation_deg";

export class TargetHandle {
  // ``toggle``: its button; ``hooks`` hear of the handle's appearance, of values by path and of a drag's end.
  constructor(scene, toggle, hooks) {
    this.scene = scene;
    this.toggle = toggle;
    this.hooks = hooks;
    this.shown = false;
    this.parts = [];
    this.value = /** @type {(path: string) => any} */ (() => 0);
    this.caster = new THREE.Raycaster();
    toggle.addEventListener("click", () => this.show(!this.shown));
    const { pane } = scene, listen = (kind, act) => pane.addEventListener(kind, act, { capture: true });
    listen("pointerdown", (event) => this.grasp(event));
    listen("pointermove", (event) => this.drag(event));
    for (const kind of ["pointerup", "pointercancel"]) listen(kind, (event) => this.release(event));
  }

  // ``number`` gives what the server says of a path; a place or attitude that a grasp determines has no handle.
  load(number, { planar, scale }) {
    const closes = number("target.base.close_grasp")?.value, axes = [0, 1, 2];
    const moves = number(`${POSITION}.0`) && !closes ? axes.slice(0, planar ? 2 : 3) : [];
    const turns = number(`${ROTATION}.2`) && !(closes && number("target.base.align")?.value) ? axes.slice(planar ? 2 : 0) : [];
    this.toggle.hidden = moves.length + turns.length === 0 || Boolean(closes);
    this.group = new THREE.Group();
    this.parts = [...moves.map((axis) => arrowAlong(axis, SIZE * scale)), ...turns.map((axis) => ringAbout(axis, SIZE * scale))];
    if (this.parts.length) this.group.add(...this.parts);
    this.scene.viewer.set_object(["Handle"], this.group);
    this.show(this.shown && !this.toggle.hidden);
  }

  show(wanted) {
    this.shown = wanted;
    this.toggle.setAttribute("aria-pressed", String(wanted));
    if (this.group) this.group.visible = wanted;
    if (wanted) this.hooks.onShow();
    this.scene.viewer.set_dirty();
  }

  // ``value`` gives a number of the design by its path.
  update(value) {
    this.value = value;
    if (!this.group) return;
    this.group.position.fromArray([0, 1, 2].map((axis) => value(`${POSITION}.${axis}`) || 0));
    this.scene.viewer.set_dirty();
  }

  // The pointer's ray, world axes of the scenario (z up).
  ray({ clientX, clientY }) {
    const box = this.scene.pane.getBoundingClientRect(), { camera } = this.scene.viewer;
    const at = new THREE.Vector2((2 * (clientX - box.left)) / box.width - 1, 1 - (2 * (clientY - box.top)) / box.height);
    camera.updateMatrixWorld();
    this.caster.setFromCamera(at, camera);
    this.group.updateWorldMatrix(true, true);
    return this.caster.ray.clone().applyMatrix4(this.group.parent.matrixWorld.clone().invert());
  }

  grasp(event) {
    if (!this.shown || !this.parts.length || event.button) return;
    const ray = this.ray(event), [hit] = this.caster.intersectObjects(this.parts, true);
    if (!hit) return;
    const { axis, turns } = hit.object.userData;
    this.dragged = { axis, turns, centre: this.group.position.clone(), angles: [0, 1, 2].map((k) => this.value(`${ROTATION}.${k}`) || 0) };
    this.dragged.from = this.along(ray);
    this.scene.pane.setPointerCapture(event.pointerId);
    this.hooks.onShow();
    this.stop(event);
  }

  // Place of the ray along the dragged axis, m, or its angle about it, rad; NaN where it is parallel.
  along({ origin, direction }) {
    const { axis, turns, centre } = this.dragged, unit = new THREE.Vector3().setComponent(axis, 1), to = origin.clone().sub(centre);
    if (turns) { // where it meets the ring's plane
      const point = to.addScaledVector(direction, -to.dot(unit) / direction.dot(unit)).toArray();
      return Math.atan2(point[(axis + 2) % 3], point[(axis + 1) % 3]);
    }
    const across = direction.dot(unit); // nearest point of the axis to the ray
    return (to.dot(unit) - across * to.dot(direction)) / (1 - across * across);
  }

  drag(event) {
    if (!this.dragged) return;
    this.stop(event);
    const { axis, turns, centre, angles, from } = this.dragged, by = this.along(this.ray(event)) - from;
    if (!Number.isFinite(by)) return;
    const rounded = (value) => Number((Math.round(value / FINE) * FINE).toFixed(4));
    if (!turns) { this.hooks.onValues({ [`${POSITION}.${axis}`]: rounded(centre.getComponent(axis) + by) }); return; }
    const turned = turnedBy(angles, axis, by), path = (k) => `${ROTATION}.${k}`;
    const changed = [0, 1, 2].filter((k) => Math.abs(turned[k] - angles[k]) > FINE || (this.value(path(k)) || 0) !== angles[k]);
    this.hooks.onValues(Object.fromEntries(changed.map((k) => [path(k), rounded(turned[k])])));
  }

  release(event) {
    if (!this.dragged) return;
    this.stop(event);
    this.dragged = null;
    this.hooks.onSettle();
  }

  // The camera does not hear of what the handle is dragged by.
  stop(event) {
    event.stopPropagation();
    event.preventDefault();
  }
}

// Roll, pitch and yaw [deg] after a turn about an axis of the world; as in URDF, R = Rz(yaw) Ry(pitch) Rx(roll).
function turnedBy(angles, axis, turn) {
  const [roll, pitch, yaw] = angles.map((angle) => (angle * Math.PI) / 180);
  if (axis === 2) return [angles[0], angles[1], angles[2] + (turn * 180) / Math.PI];
  const before = new THREE.Quaternion().setFromEuler(new THREE.Euler(roll, pitch, yaw, "ZYX"));
  const after = new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3().setComponent(axis, 1), turn).multiply(before);
  const { x, y, z } = new THREE.Euler().setFromQuaternion(after, "ZYX");
  return [x, y, z].map((angle) => (angle * 180) / Math.PI);
}

function painted(geometry, axis, turns) {
  const made = new THREE.Mesh(geometry, overlay(AXIS_COLOURS[axis], 1));
  made.renderOrder = 50;
  made.userData = { axis, turns };
  return made;
}

function arrowAlong(axis, length) {
  const arrow = new THREE.Group(), shaft = painted(new THREE.CylinderGeometry(0.03 * length, 0.03 * length, 0.8 * length, 12), axis, false);
  const tip = painted(new THREE.ConeGeometry(0.09 * length, 0.25 * length, 16), axis, false);
  shaft.position.y = 0.4 * length;
  tip.position.y = 0.9 * length;
  arrow.add(shaft, tip);
  arrow.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3().setComponent(axis, 1));
  return arrow;
}

function ringAbout(axis, length) {
  const ring = painted(new THREE.TorusGeometry(0.7 * length, 0.035 * length, 10, 64), axis, true);
  ring.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), new THREE.Vector3().setComponent(axis, 1));
  return ring;
}
