// Names of bodies in the scene, and of runs below them.
import { Eye } from "./camera.js";
import { element } from "./format.js";
import { boxesOf } from "./shapes.js";
import { THREE } from "./three.js";

const TALL = 20; // px of a name

// Names as people read them: without the robot where all have the same one, and in words ("servicer/left_tip": "left tip").
export function shortNames(names) {
  const heads = new Set(names.map((name) => name.split("/", 2)).map(([head, rest]) => (rest === undefined ? "" : head)));
  const one = heads.size === 1 && !heads.has("");
  return names.map((name) => (one ? name.slice(name.indexOf("/") + 1) : name).replace(/[/_]/g, " "));
}

export class Labels {
  constructor(root) {
    this.root = root;
    this.bodies = this.feet = [];
  }

  load(runs) {
    runs = runs.filter(({ data }) => !data.pale);
    this.bodies = runs.flatMap((run) => run.data.nodes.flatMap((node, k) => (
      node.base ? [{ object: run.nodes[k], span: element("span", node.label, "name"), ...boxesOf(run.nodes[k]) }] : []
    )));
    this.feet = runs.length > 1 ? runs.map((run) => element("span", run.data.label)) : [];
    this.root.replaceChildren(...this.bodies.map(({ span }) => span), ...this.feet);
  }

  // Names as the page shows them, onto a picture of the pane, in letters so many px high.
  draw(pen, letters) {
    pen.font = `${letters}px system-ui, 'DejaVu Sans', sans-serif`;
    [pen.textAlign, pen.textBaseline] = ["center", "middle"];
    for (const span of [...this.bodies.map((body) => body.span), ...this.feet]) {
      if (span.hidden) continue;
      const x = parseFloat(span.style.left), y = parseFloat(span.style.top) + 9;
      const wide = pen.measureText(span.textContent).width + letters, tall = 1.5 * letters;
      pen.fillStyle = "#0009";
      pen.fillRect(x - wide / 2, y - tall / 2, wide, tall);
      pen.fillStyle = "#e8edf3";
      pen.fillText(span.textContent, x, y);
    }
    [pen.textAlign, pen.textBaseline] = ["left", "alphabetic"];
  }

  place(camera, pane, boxes, planar, { names, beside }) {
    const wide = pane.clientWidth, tall = pane.clientHeight, at = new THREE.Vector3(), corner = new THREE.Vector3();
    const taken = [];
    camera.updateWorldMatrix(true, false); // where the camera has jumped nothing has been drawn yet
    const put = (span, x, y, visible) => {
      const half = 4 * span.textContent.length + 8; // px, about
      const left = Math.max(half, Math.min(wide - half, x));
      let top = Math.max(4, Math.min(tall - TALL - 4, y));
      // a name that would lie over another one moves below it, or above where there is no room
      const over = () => taken.find((one) => Math.abs(one.left - left) < one.half + half && Math.abs(one.top - top) < TALL);
      for (let other = visible && over(), k = 0; other && k < 8; other = over(), k++) top = other.top + (other.top + 2 * TALL + 4 < tall ? TALL : -TALL);
      if (visible) taken.push({ left, top, half });
      span.hidden = !visible;
      span.style.left = `${left}px`;
      span.style.top = `${top}px`;
    };
    // a name stands on the largest part of its body, above a body that is smaller than the name; it stays in the window
    for (const { object, span, main, box: { min, max } } of this.bodies) {
      object.updateWorldMatrix(true, false);
      const [low, high] = [[1e9, 1e9], [-1e9, -1e9]];
      for (let k = 0; k < 8; k++) {
        corner.set(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z);
        const { x, y } = object.localToWorld(corner).project(camera);
        [low[0], low[1], high[0], high[1]] = [Math.min(low[0], x), Math.min(low[1], y), Math.max(high[0], x), Math.max(high[1], y)];
      }
      object.localToWorld(main.getCenter(at)).project(camera);
      const seen = at.z < 1 && low[0] < 1 && high[0] > -1 && low[1] < 1 && high[1] > -1, small = ((high[1] - low[1]) / 2) * tall < 2 * TALL;
      put(span, ((at.x + 1) / 2) * wide, small ? ((1 - high[1]) / 2) * tall - TALL - 4 : ((1 - at.y) / 2) * tall - TALL / 2, names && seen);
    }
    this.feet.forEach((span, k) => {
      const [low, high] = boxes[k], foot = planar ? [low[1], 0] : [(low[1] + high[1]) / 2, low[2]];
      const foot3 = Eye.toThree([(low[0] + high[0]) / 2, ...foot]).project(camera);
      put(span, ((foot3.x + 1) / 2) * wide, Math.min(tall - 24, ((1 - foot3.y) / 2) * tall), beside);
    });
  }
}
