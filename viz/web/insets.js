// Small views in the scene's corner: of a grasp from near, and along a tip.
import { element } from "./format.js";
import { THREE } from "./three.js";

const WIDE = 0.24, TALL = 0.3, LEAST = 450; // shares of the pane; px below which there is no room
export const INSETS = { graspview: "grasp", tipview: "tip" };

export class Insets {
  constructor(viewer, pane) {
    this.viewer = viewer;
    this.pane = pane;
    this.shown = {};
    this.camera = new THREE.PerspectiveCamera(38, 1);
    this.frames = Object.entries(INSETS).map(([name, text]) => [name, element("div", text, "inset")]);
    for (const [, frame] of this.frames) {
      frame.hidden = true;
      pane.after(frame);
    }
  }

  show(name, visible) { this.shown[name] = visible; }

  // After the scene itself; the shadows are those that it has.
  draw(run, { scale, towards, planar }) {
    const { clientWidth: wide, clientHeight: tall } = this.pane, { renderer, scene } = this.viewer;
    const [width, height] = [Math.min(WIDE * wide, 300), Math.min(TALL * tall, 220)], left = wide - width - 10;
    let top = 10;
    for (const [name, frame] of this.frames) {
      frame.hidden = !(wide > LEAST && this.shown[name] && run?.arrows.length);
      if (frame.hidden) continue;
      for (const [side, value] of Object.entries({ left, top, width, height })) frame.style[side] = `${value}px`;
      this[name](run, scale, new THREE.Vector3(...(planar ? [0.3, -0.6, 1] : towards)).normalize());
      this.camera.aspect = width / height;
      [this.camera.near, this.camera.far] = [0.002 * scale, 20 * scale];
      this.camera.updateProjectionMatrix();
      renderer.setViewport(left, tall - top - height, width, height);
      renderer.setScissor(left, tall - top - height, width, height);
      renderer.setScissorTest(true);
      renderer.shadowMap.autoUpdate = false;
      renderer.render(scene, this.camera);
      renderer.shadowMap.autoUpdate = true;
      renderer.setScissorTest(false);
      renderer.setViewport(0, 0, wide, tall);
      top += height + 10;
    }
  }

  // The grasp whose tip is nearest to its mating frame.
  nearest({ data, mateBalls, tipBalls, nodes }) {
    const tips = data.grasp_tips.map((tip) => tipBalls[tip].position), off = tips.map((tip, k) => tip.distanceTo(mateBalls[k].position));
    const k = off.indexOf(Math.min(...off));
    return { mate: mateBalls[k].position, tip: tips[k], node: nodes[data.tip_nodes[data.grasp_tips[k]]] };
  }

  graspview(run, scale, towards) {
    const { mate } = this.nearest(run);
    this.stand(run, mate.clone().addScaledVector(towards, 0.26 * scale), mate);
  }

  // From behind the tip, along its last link.
  tipview(run, scale, towards) {
    const { tip, node } = this.nearest(run), back = node.position.clone().sub(tip);
    if (back.length() < 1e-3 * scale) back.copy(towards);
    this.stand(run, tip.clone().addScaledVector(back.normalize(), 0.12 * scale).addScaledVector(towards, 0.06 * scale), tip);
  }

  // Points of the run's own frame.
  stand(run, eye, at) {
    this.camera.position.copy(run.root.localToWorld(eye.clone()));
    this.camera.lookAt(run.root.localToWorld(at.clone()));
    this.camera.updateMatrixWorld();
  }
}
