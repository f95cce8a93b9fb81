// What is shown in the scene: a box for each layer.
import { element, mark } from "./format.js";
import { AXIS_COLOURS, COLOURS } from "./shapes.js";

export const LAYERS = [
  ["names", "names", "#ffffff", "text"], ["traces", "paths of tips and object", COLOURS.target, "line"],
  ["reference", "reference paths of tips", COLOURS.reference, "thin"],
  ["forces", "grip forces on the object", COLOURS.force, "arrow"],
  ["contacts", "contact forces", COLOURS.contact, "arrow"],
  ["impulses", "impulses of rigid captures", COLOURS.impulse, "arrow"], ["plumes", "plumes of thrusters", COLOURS.plume, "box"],
  ["wheels", "reaction wheels", COLOURS.wheel, "ring"],
  ["mates", "tips; ringed while captured", COLOURS.mate, "ring"],
  ["cloud", "tips of a campaign's samples", "#cfd8e3", "thin"], ["before", "previous design, or the plan", "#dfe6ee", "box"],
  ["ghosts", "initial poses of bodies", "#b9c3ce", "box"], ["magnifier", "tip errors, enlarged", "#8fa3b8", "ring"],
  ["centres", "centres of mass; white: total", COLOURS.centre, "ring"],
  ["momenta", "linear momenta", COLOURS.momentum, "arrow"],
  ["frames", "axes x, y, z: red, green, blue", AXIS_COLOURS[0], "line"],
  ["graspview", "grasp camera", COLOURS.mate, "box"], ["tipview", "tip camera", COLOURS.mate, "box"],
  ["grid", "grid", COLOURS.grid, "thin"], ["sun", "sunlight and shadows", "#fff4e6", "ring"], ["earthshine", "earthshine", "#8fb4e8", "ring"],
  ["stars", "stars", "#ffffff", "ring"], ["earth", "Earth", "#4f8fd0", "ring"],
];
const HIDDEN_AT_FIRST = ["ghosts", "centres", "momenta", "frames", "graspview", "tipview"];
const HIDDEN_IN_SPACE = [...HIDDEN_AT_FIRST, "grid"]; // a scene in three dimensions has no floor

export class Legend {
  constructor(root, form, onToggle) {
    this.root = root;
    this.form = form;
    this.onToggle = onToggle;
    this.reset(true);
  }

  reset(planar = this.planar) {
    this.planar = planar;
    this.hidden = planar ? HIDDEN_AT_FIRST : HIDDEN_IN_SPACE;
    this.shown = Object.fromEntries(LAYERS.map(([name]) => [name, !this.hidden.includes(name)]));
  }

  // Boxes for the layers that are there.
  load(present) {
    const there = LAYERS.filter(([name]) => present(name)), names = there.map(([name]) => name).join();
    if (names === this.names) { // what has the focus keeps it
      this.form.querySelectorAll("input").forEach((box, k) => { box.checked = this.shown[there[k][0]]; });
      return;
    }
    this.names = names;
    const boxes = there.map(([name, text, colour, shape]) => {
      const label = element("label"), box = element("input");
      box.type = "checkbox";
      box.checked = this.shown[name];
      box.addEventListener("change", () => {
        this.shown[name] = box.checked;
        this.onToggle(name);
      });
      label.append(box, mark(colour, shape), text);
      return label;
    });
    this.form.replaceChildren(...boxes);
    this.root.hidden = boxes.length === 0;
  }

  // Names of the layers that differ from the beginning, and back.
  get text() {
    return LAYERS.map(([name]) => name).filter((name) => this.shown[name] === this.hidden.includes(name)).join(" ");
  }

  set text(text) {
    this.reset();
    for (const name of text.split(" ")) if (name in this.shown) this.shown[name] = !this.shown[name];
  }
}
