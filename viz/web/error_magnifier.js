// Where the tips are around their references, enlarged: errors are too small to see in the scene.
import { locate, niceStep } from "./format.js";
import { tipColour } from "./shapes.js";
import { THREE } from "./three.js";

export class Magnifier {
  constructor(figure, eye) {
    this.figure = figure;
    this.canvas = figure.querySelector("canvas");
    this.caption = figure.querySelector("figcaption");
    this.eye = eye;
    this.runs = [];
  }

  load(runs) {
    this.runs = runs.map((run) => ({ run, errors: run.errors }));
    let greatest = 0;
    for (const { run, errors } of this.runs) {
      const kept = run.data.completed ? 1 : 0.8;
      for (const values of errors.filter(Boolean)) {
        for (let i = 0; i + 2 < kept * values.length; i += 3) {
          greatest = Math.max(greatest, Math.hypot(values[i], values[i + 1], values[i + 2]) || 0);
        }
      }
    }
    this.greatest = greatest;
    this.useful = greatest > 1e-6; // m
    this.ring = this.useful ? niceStep(greatest / 2.2) : 1;
  }

  show(visible) {
    this.figure.hidden = !(visible && this.useful);
  }

  // How much larger than in the scene, at the distance of what the camera looks at.
  times(radius) {
    const { camera, controls } = this.eye.viewer, distance = camera.position.distanceTo(controls.target);
    const perMetre = this.eye.pane.clientHeight / (2 * distance * Math.tan((camera.fov * Math.PI) / 360));
    const times = radius / this.greatest / perMetre;
    return times >= 1.5 ? Number(times.toPrecision(times < 10 ? 1 : 2)) : 0;
  }

  draw(time) {
    const size = this.canvas.clientWidth;
    // small windows leave no room for it
    if (this.figure.hidden || size < 40) return;
    const ratio = window.devicePixelRatio || 1, radius = size / 2 - 8;
    this.canvas.width = this.canvas.height = Math.round(size * ratio);
    const pen = this.canvas.getContext("2d"), metre = radius / this.greatest;
    pen.scale(ratio, ratio);
    pen.translate(size / 2, size / 2);
    pen.strokeStyle = "#5b6c7e";
    pen.lineWidth = 1;
    for (let k = 1; k * this.ring * metre <= radius * 1.001; k++) {
      pen.beginPath();
      pen.arc(0, 0, k * this.ring * metre, 0, 2 * Math.PI);
      pen.stroke();
    }
    pen.beginPath();
    pen.moveTo(-5, 0);
    pen.lineTo(5, 0);
    pen.moveTo(0, -5);
    pen.lineTo(0, 5);
    pen.strokeStyle = "#ffffff";
    pen.stroke();
    const across = new THREE.Vector3(), up = new THREE.Vector3();
    this.eye.viewer.camera.matrixWorld.extractBasis(across, up, new THREE.Vector3());
    const error = new THREE.Vector3();
    this.runs.forEach(({ run, errors }, r) => {
      const [last] = locate(run.fineTime, time);
      errors.forEach((values, k) => {
        if (!values) return;
        // an error is reference minus position: the tip lies on the other side
        const at = (i) => {
          error.set(-values[3 * i], -values[3 * i + 2], values[3 * i + 1]);
          return [error.dot(across) * metre, -error.dot(up) * metre];
        };
        this.trail(pen, at, last, tipColour(k), r > 0);
      });
    });
    const times = this.times(radius);
    const ring = `${Number((this.ring * 1e3).toPrecision(2))} mm`;
    this.caption.textContent = `tip errors${times ? ` \u00d7${times}` : ""}; rings ${ring}`;
    this.figure.title = `Tips around their references${times ? `, ${times} times enlarged` : ""}; rings every ${ring}`;
  }

  trail(pen, at, last, colour, dashed) {
    pen.strokeStyle = pen.fillStyle = colour;
    pen.lineWidth = 1.5;
    pen.setLineDash(dashed ? [5, 3] : []);
    pen.beginPath();
    for (let i = 0; i <= last; i++) pen.lineTo(...at(i));
    pen.stroke();
    pen.setLineDash([]);
    pen.beginPath();
    pen.arc(...at(last), 4, 0, 2 * Math.PI);
    pen.fill();
  }
}
