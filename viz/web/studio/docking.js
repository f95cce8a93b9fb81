// A docking of one's own: URDFs, tip and mating frame are chosen and the object is placed; the draft is seen, then opened.
import { $, options } from "../format.js";

const FILES = ["robot", "target"], LINKS = { tip: "tips", frame: "frames" };
const LARGEST = 2e5; // bytes of a URDF: the server ends connections with messages of 256 kB
const REST_MS = 400; // after the last change a draft is asked for

export class Docking {
  // ``ask`` sends a request; ``onPreview`` gets what is to be shown in the scene, null for the design in the hand again.
  constructor(root, { ask, onPreview }) {
    this.root = root;
    this.ask = ask;
    this.onPreview = onPreview;
    this.yaml = $("yaml");
    this.field = (name) => root.querySelector(`[name=${name}]`);
    root.addEventListener("toggle", () => this.open(root.open));
    root.addEventListener("input", ({ target }) => { if (target.type !== "file") this.change(target.name); });
    for (const kind of FILES) root.querySelector(`[data-file=${kind}]`).addEventListener("change", (event) => this.upload(kind, event.target));
    root.querySelector(".open").addEventListener("click", () => { this.say("building the closed loop"); this.ask({ type: "open", ...this.chosen }); });
  }

  open(wanted) {
    this.yaml.hidden = true;
    if (wanted) this.ask({ type: "urdfs" }); else this.onPreview(null);
  }

  // The server's URDFs; one that was uploaded is chosen.
  offer({ files, uploaded }) {
    for (const kind of FILES) {
      const field = this.field(kind), { value } = field;
      options(field, [["", "choose a URDF"], ...files.map((name) => [name, name])]);
      field.value = uploaded && kind === this.uploading ? uploaded : value;
    }
    if (uploaded) this.change(this.uploading);
  }

  async upload(kind, { files: [file] }) {
    if (!file) return;
    if (file.size > LARGEST) { this.say(`${file.name} has ${Math.round(file.size / 1e3)} kB, allowed: ${LARGEST / 1e3} kB; start the studio in its folder instead`); return; }
    this.uploading = kind;
    this.ask({ type: "urdfs", name: file.name, text: await file.text() });
  }

  get chosen() {
    return Object.fromEntries([...this.root.querySelectorAll("[name]")].map((field) => [field.name, field.value.trim()]));
  }

  // Links and places belong to the files they were chosen for.
  change(name) {
    if (name === "robot") this.field("tip").value = "";
    if (name === "target") for (const own of ["frame", "point", "position", "velocity", "spin_deg"]) this.field(own).value = "";
    clearTimeout(this.resting);
    this.root.querySelector(".open").disabled = true;
    const { robot, target } = this.chosen;
    if (!robot || !target) return;
    this.say("drafting");
    this.resting = setTimeout(() => this.ask({ type: "draft", ...this.chosen }), REST_MS);
  }

  show(draft) {
    for (const [name, all] of Object.entries(LINKS)) {
      const field = this.field(name), { value } = field;
      options(field, [["", `proposed: ${draft.chosen[name]}`], ...draft[all].map((link) => [link, link])]);
      field.value = value;
    }
    for (const [name, values] of Object.entries(draft.place)) this.field(name).placeholder = values.join(", ");
    this.yaml.querySelector("pre").textContent = draft.text;
    this.yaml.querySelector("h2").textContent = draft.file;
    this.yaml.hidden = false;
    this.say(draft.warnings.join(" ") || "drafted: open it to simulate, tune and plan it");
    this.root.querySelector(".open").disabled = false;
    this.onPreview(draft.show);
  }

  say(text) {
    this.root.querySelector(".words").textContent = text;
  }
}
