// Ways to keep the design: files beside the scenario, written by the server, and the command that runs it again.
import { $, button } from "../format.js";

const SAVES = {
  scenario: "scenario file", result: "result folder", page: "HTML page", gif: "GIF drawing", mp4: "MP4 drawing", csv: "CSV of all curves",
};

export class Keep {
  // ``ask`` sends a request with the design's values.
  constructor(root, ask) {
    this.root = root;
    this.ask = ask;
    this.name = root.querySelector("input");
    this.words = root.querySelector(".words");
    this.command = root.querySelector("textarea");
    root.querySelector(".command").addEventListener("click", () => ask({ type: "command" }));
  }

  load({ saves, scenario, folder }) {
    this.name.value ||= `${scenario}-studio`.replace(/[^\w.-]+/g, "_");
    this.root.querySelector(".folder").textContent = `Files go to ${folder}.`;
    this.root.querySelector(".saves").replaceChildren(...saves.map((what) => (
      button(SAVES[what] || what, `Save as ${SAVES[what] || what}`, () => this.save(what))
    )), ...["picture", "film", "video", "plot"].map((own) => this.own(own)));
  }

  // What the page saves by itself, by the button that does so elsewhere on it.
  own(id) {
    const text = { picture: "PNG of the view", film: "GIF of the view", video: "video of the view", plot: "PNG of the curves" }[id], made = button(text, `Save a ${text}`, () => $(id).click());
    made.dataset.saves = id;
    return made;
  }

  save(what) {
    const name = this.name.value.trim(), fits = /^[\w.-]+$/.test(name);
    this.name.setCustomValidity(fits ? "" : "letters, digits, _ - and . are allowed");
    this.name.reportValidity();
    if (!fits) return;
    this.say(`saving the ${SAVES[what] || what}`);
    this.ask({ type: "save", what, name });
  }

  saved({ path, command }) {
    this.say(`saved: ${path}`);
    if (command) this.show(command);
  }

  // The command stands there to be read, and is in the clipboard where the browser lets it.
  async show(text, copy = false) {
    this.command.hidden = false;
    this.command.value = text;
    if (!copy) return;
    this.command.select();
    const copied = await navigator.clipboard?.writeText(text).then(() => true, () => false);
    this.say(copied ? "copied" : "select and copy:");
  }

  say(text) {
    this.words.textContent = text;
  }
}
