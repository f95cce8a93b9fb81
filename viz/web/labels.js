// Names of bodies in the scene, and of runs below them.
import { Eye } from "./camera.js";
import { element } from "./format.js";
import { boxesOf } from "./shapes.js";
import { THREE } from "./three.js";

export function called(body) {
  return body === "target" ? "object" : body;
}

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
      node.base ? [{ object: run.nodes[k], span: element("span", called(node.body), "name"), ...boxesOf(run.nodes[k]), above: node.body === "target" }] : []
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
    const put = (span, x, y, visible) => {
      const half = 4 * span.textContent.length + 8; // px, about
      span.hidden = !visible || x < 0 || x > wide;
      span.style.left = `${Math.max(half, Math.min(wide - half, x))}px`;
      span.style.top = `${Math.max(4, Math.min(tall - 24, y))}px`;
    };
    // a robot's name stands on the largest part of its base, an object's above it, and hides nothing
    for (const { object, span, main, box: { min, max }, above } of this.bodies) {
      object.updateWorldMatrix(true, false);
      object.localToWorld(main.getCenter(at)).project(camera);
      let top = at.y;
      for (let k = 0; above && k < 8; k++) {
        corner.set(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z);
        top = Math.max(top, object.localToWorld(corner).project(camera).y);
      }
      put(span, ((at.x + 1) / 2) * wide, ((1 - top) / 2) * tall - (above ? 24 : 10), names && at.z < 1 && Math.abs(at.y) < 1);
    }
    this.feet.forEach((span, k) => {
      const [low, high] = boxes[k], foot = planar ? [low[1], 0] : [(low[1] + high[1]) / 2, low[2]];
      const foot3 = Eye.toThree([(low[0] + high[0]) / 2, ...foot]).project(camera);
      put(span, ((foot3.x + 1) / 2) * wide, Math.min(tall - 24, ((1 - foot3.y) / 2) * tall), beside);
    });
  }
}
