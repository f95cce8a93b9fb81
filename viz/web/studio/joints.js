// Sliders of all joints' initial positions; unlike the others they are not varied by searches and campaigns.
import { Slider, firstRange } from "./slider.js";

export class Joints {
  // ``hooks``: those of sliders.
  constructor(root, hooks) {
    this.root = root;
    this.hooks = hooks;
    this.list = root.querySelector(".list");
    this.sliders = [];
    /** @type {(path: string) => any} */
    this.value = () => undefined;
    this.full = false;
    root.addEventListener("toggle", () => this.update());
  }

  // ``numbers``: all of the scenario.
  load(numbers) {
    const joints = numbers.filter(({ joint, free }) => joint && free), listed = joints.map(({ path }) => path).join();
    this.root.hidden = joints.length === 0;
    if (listed === this.listed) return; // ranges that the user chose stay
    this.listed = listed;
    this.sliders = joints.map((number) => new Slider(number, firstRange(number), this.hooks));
    this.list.replaceChildren(...this.sliders.map(({ whole }) => whole));
  }

  // ``value`` gives a number by its path; ``full``: whether sliders are called by their paths.
  show(value, full) {
    [this.value, this.full] = [value, full];
    this.update();
  }

  update() {
    if (this.root.open) for (const slider of this.sliders) slider.update(this.value(slider.number.path), this.full);
  }
}
