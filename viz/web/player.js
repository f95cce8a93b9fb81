// The page: puts its parts together, and lets each hear of what the others do.
import { Busy } from "./busy_indicator.js";
import { Chart } from "./chart.js";
import { EventStrip } from "./events.js";
import { curvesPicture, curvesTable } from "./curve_export.js";
import { $, element, floats, options } from "./format.js";
import { Labels } from "./labels.js";
import { LAYERS, Legend } from "./legend.js";
import { Link } from "./permalink.js";
import { Magnifier } from "./error_magnifier.js";
import { SignalPicker } from "./signal_picker.js";
import { Camera, FILM, VIDEO, save, saveBlob } from "./image_export.js";
import { Portrait } from "./phase_portrait.js";
import { fixedLevel } from "./quality.js";
import { Readout } from "./readout.js";
import { Scene } from "./scene.js";
import { cloudOf } from "./shapes.js";
import { Signals } from "./signals.js";
import { chosenScheme, isLight, onScheme, scheme } from "./theme.js";
import { Timeline } from "./timeline.js";

const FILM_LEVEL = 2; // of viz/web/quality.js

export class Player {
  constructor() {
    this.scene = new Scene($("pane"), $("side"), () => this.laidOut());
    this.timeline = new Timeline(
      { play: $("play"), scrub: $("scrub"), clock: $("clock"), speed: $("speed") },
      { onSeek: (time) => this.show(time), onRest: () => this.note() },
    );
    this.events = new EventStrip($("events"), { onSeek: (time) => this.timeline.go(time) });
    this.chart = new Chart($("chart"), {
      onSeek: (time) => this.timeline.go(time),
      onChange: () => this.picked(),
    });
    this.picker = new SignalPicker($("picker"), $("signals"), () => this.picked());
    this.portrait = new Portrait($("portrait"), $("portraying"), () => this.note());
    this.magnifier = new Magnifier($("magnifier"), this.scene.eye);
    this.readout = new Readout($("readout"));
    this.labels = new Labels($("labels"));
    this.legend = new Legend($("legend"), $("layers"), (layer) => this.toggled(layer));
    this.busy = new Busy($("busy"));
    this.camera = new Camera(this.scene, this.labels, {
      seek: (time) => this.timeline.seek(time),
      words: () => [`${this.payload.title}, t = ${this.timeline.time.toFixed(2)} s`, this.scene.scale].filter(Boolean).join("; "),
    });
    this.link = new Link({ read: () => this.state(), apply: (wanted) => this.become(wanted) });
    this.listen();
    this.last = performance.now();
    requestAnimationFrame((now) => this.tick(now));
  }

  // Until there is anything to show.
  wait({ title, about }) {
    $("title").textContent = title;
    $("about").textContent = about;
    this.timeline.enable(false);
  }

  load(payload) {
    this.payload = payload;
    this.words();
    this.signals = new Signals(payload.runs);
    if (this.legend.planar !== payload.planar) this.legend.reset(payload.planar);
    if (payload.over) this.scene.over = true; // a plan lies under what was flown
    this.scene.load(payload, this.legend.shown);
    this.fill(payload.runs);
    this.offer();
    this.speak();
    this.timeline.load(this.scene.end, this.scene.runs.some((run) => run.time.length > 1));
    this.toggled("magnifier");
    this.timeline.seek(0);
    this.chart.resize();
    this.scene.refit(); // only now the words have their width, as after any change of the view
  }

  // Other motions of the same bodies: time, view and the choice of signals stay.
  renew(runs, notices) {
    const { end } = this.scene, count = this.scene.runs.length;
    this.payload = { ...this.payload, runs, notices };
    this.words();
    const others = this.scene.renew(runs);
    this.signals = new Signals(runs, this.signals);
    this.fill(runs);
    if (others) {
      this.readout.load(this.scene.runs, this.scene.colours, this.signals.full);
      this.labels.load(this.scene.runs);
    }
    $("placing").hidden = runs.length < 2;
    if (this.scene.end !== end) this.timeline.stretch(this.scene.end);
    this.magnifier.show(this.legend.shown.magnifier);
    if (runs.length !== count) this.scene.refit(); // the words take another room
    this.timeline.seek(this.timeline.time);
  }

  // The parts about signals, layers and events.
  fill([{ events }]) {
    this.magnifier.load(this.scene.runs);
    this.legend.load((layer) => this.present(layer));
    this.picker.load(this.signals);
    this.portrait.load(this.signals);
    this.chart.load(this.signals, this.scene.end, events);
    this.events.load(events, this.scene.end);
  }

  // A campaign: ``paths`` of its tips, of that ``shape`` (samples, times, tips, 3), and ``bands`` of signals; none if null.
  cloud(spread) {
    this.scene.setCloud(spread?.shape.every((count) => count > 0) ? cloudOf(floats(spread.paths), spread.shape) : null);
    this.legend.load((layer) => this.present(layer));
    this.chart.band(spread);
  }

  // Open or close the numbers beside the scene.
  panel(open) {
    $("panel").hidden = !open;
    $("paneling").setAttribute("aria-expanded", String(open));
    this.laidOut();
  }

  // Whether there is anything of a layer to show.
  present(layer) {
    return { names: true, magnifier: this.magnifier.useful }[layer] ?? this.scene.has(layer);
  }

  words() {
    const { title, about, notices } = this.payload;
    document.title = $("title").textContent = title;
    $("about").textContent = $("about").title = about;
    $("notice").hidden = notices.length === 0;
    $("notice").replaceChildren(...notices.map((text) => element("div", text)));
  }

  // Choices of the view that this result has.
  offer() {
    $("placing").hidden = this.payload.runs.length < 2;
    $("looking").hidden = this.payload.near.length === 0;
    const looks = [["all", "all"], ["near", "close up"]];
    options($("look"), this.payload.shots.length > 1 ? [["auto", "auto"], ...looks] : looks);
    $("bending").hidden = !this.payload.runs.some((run) => run.bent);
    this.enlarge($("enlarged").value);
    const { bodies } = this.scene;
    $("following").hidden = bodies.length === 0 || this.scene.end < 1e-6;
    options($("follow"), [["", "nothing"], ...bodies.map(({ body, label }) => [body, label])]);
    this.controls();
  }

  // The controls say what the scene does.
  controls() {
    $("arrange").value = this.scene.over ? "over" : "beside";
    $("look").value = this.scene.near ? "near" : this.scene.auto ? "auto" : "all";
    $("follow").value = this.scene.followed;
    $("scale").textContent = this.scene.scale;
  }

  // Words that follow the runs' objects.
  speak() {
    this.readout.load(this.scene.runs, this.scene.colours, this.signals.full);
    this.labels.load(this.scene.runs);
    this.magnifier.load(this.scene.runs);
    this.controls();
  }

  // A change of the view by the user.
  view(change) {
    change();
    this.speak();
    this.timeline.seek(this.timeline.time); // writes the words: what they leave to the scene is known only now
    this.scene.refit();
    this.note();
  }

  // Deflections of flexible links by a factor.
  enlarge(factor) {
    $("enlarged").value = factor;
    for (const run of this.scene.runs) run.enlarge($("enlarged").value);
  }

  toggled(layer) {
    this.magnifier.show(this.legend.shown.magnifier);
    this.scene.show(layer);
    this.scene.refit();
    this.controls();
    this.timeline.seek(this.timeline.time);
    this.note();
  }

  // Signals and tips by the names of the result, or short.
  name(full) {
    this.signals.full = full;
    $("fullnames").setAttribute("aria-pressed", String(full));
    this.picker.load(this.signals);
    this.speak();
    this.picked();
  }

  picked() {
    this.picker.update();
    this.chart.choose();
    this.laidOut();
    this.note();
  }

  show(time) {
    this.scene.seek(time);
    if (this.staged) return;
    this.readout.seek(time, this.events.at(time));
    this.chart.seek(time);
    this.magnifier.draw(time);
    this.portrait.seek(time);
    document.body.dataset.time = time.toFixed(3);
  }

  // A scene that has not been simulated yet is not worth a link.
  note() {
    if (!this.timeline?.playButton.disabled) this.link?.note();
  }

  // After a change of size: the seek bar stands under the chart's time axis.
  laidOut() {
    if (!this.payload) return;
    this.chart.resize();
    const [left, right] = this.chart.seen ? this.chart.span : [0, 0];
    this.events.align(...this.timeline.align(left, right));
    this.magnifier.draw(this.timeline.time);
  }

  tick(now) {
    if (this.staged) return; // each picture is asked for
    requestAnimationFrame((next) => this.tick(next));
    const pane = $("pane"), size = `${pane.clientWidth} ${pane.clientHeight}`;
    if (size !== this.size) {
      this.size = size;
      this.scene.viewer.set_3d_pane_size();
      this.scene.redraw();
    }
    const passed = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    if (!this.payload || !this.scene.runs.length) return;
    if (!this.filming) this.timeline.tick(passed);
    this.scene.quality.tick(now, this.timeline.playing || this.scene.eye.touched);
    this.place();
  }

  place() {
    const beside = this.scene.runs.length > 1 && !this.scene.over;
    const shown = { names: this.legend.shown.names, beside };
    this.labels.place(this.scene.viewer.camera, this.scene.pane, this.scene.boxes, this.payload.planar, shown);
  }

  // ``write``: the camera's way to do so, so many pixels wide at most; the button that was pressed stops it.
  async film(asked, width, write) {
    if (this.filming) { this.filming = false; return; }
    const { time, duration, speed } = this.timeline, name = asked.textContent;
    this.filming = true;
    this.timeline.pause();
    const { quality, viewer } = this.scene, { fixed } = quality;
    quality.fixed = Math.max(FILM_LEVEL, quality.level); // a film is drawn as what moves
    quality.tick(0, false);
    viewer.renderer.setPixelRatio?.(Math.min(1, width / $("pane").clientWidth));
    asked.textContent = `stop ${name}`;
    try {
      await write(this.fileName, {
        duration, speed, tell: (text) => { this.place(); this.busy.say(text); }, going: () => this.filming,
      });
    } finally {
      this.filming = false;
      [quality.fixed, quality.applied] = [fixed, -1];
      quality.stir();
      asked.textContent = name;
      this.busy.end();
      this.timeline.seek(time);
    }
  }

  // Nothing but the scene is shown, drawn as finely as a level says.
  stage(level) {
    document.body.classList.add("film");
    this.filming = this.staged = true;
    this.scene.viewer.renderer.domElement.remove(); // its pictures are taken, not shown
    this.scene.viewer.animate = () => {};
    this.timeline.pause();
    this.scene.quality.fixed = level;
    this.scene.quality.tick(0, false);
    this.scene.viewer.set_3d_pane_size();
    this.scene.refit();
  }

  get fileName() {
    return this.payload.title.replace(/[^\w.-]+/g, "_").slice(0, 60) || "view";
  }

  listen() {
    $("arrange").addEventListener("change", () => this.view(() => this.scene.lay($("arrange").value === "over")));
    $("look").addEventListener("change", () => this.view(() => this.scene.look($("look").value)));
    $("enlarged").addEventListener("change", () => this.view(() => this.enlarge($("enlarged").value)));
    $("follow").addEventListener("change", () => this.view(() => this.scene.follow($("follow").value)));
    $("reset").addEventListener("click", () => this.view(() => this.scene.arrange()));
    $("picture").addEventListener("click", () => this.camera.savePicture(this.fileName));
    $("film").addEventListener("click", () => this.film($("film"), FILM.width, (...how) => this.camera.saveFilm(...how)));
    $("video").addEventListener("click", () => this.film($("video"), VIDEO.width, (...how) => this.camera.saveVideo(...how)));
    $("video").hidden = !window.MediaRecorder;
    $("nearer").addEventListener("click", () => this.chart.zoom(1.5));
    $("farther").addEventListener("click", () => this.chart.zoom(1 / 1.5));
    $("earlier").addEventListener("click", () => this.chart.pan(-0.25));
    $("later").addEventListener("click", () => this.chart.pan(0.25));
    $("table").addEventListener("click", () => saveBlob(new Blob([curvesTable(this.chart)], { type: "text/csv" }), `${this.fileName}.csv`));
    $("fullnames").addEventListener("click", () => this.name(!this.signals.full));
    $("plot").addEventListener("click", () => save(curvesPicture(this.chart), `${this.fileName}-curves.png`));
    $("paneling").addEventListener("click", () => this.panel($("panel").hidden));
    $("about").addEventListener("click", () => $("about").classList.toggle("whole"));
    $("more").addEventListener("click", () => this.more(!$("looks").classList.contains("open")));
    $("looks").addEventListener("keydown", (event) => { if (event.key === "Escape") this.more(false); });
    $("legend").addEventListener("toggle", () => this.scene.refit());
    this.scene.viewer.controls.addEventListener("change", () => {
      this.magnifier.draw(this.timeline.time);
      if (this.scene.eye.moved && !this.timeline.playing) this.note();
    });
    window.addEventListener("resize", () => this.laidOut());
    const schemed = () => { $("scheme").textContent = isLight() ? "dark" : "light"; if (this.payload) this.picked(); };
    onScheme(schemed);
    schemed();
    $("scheme").addEventListener("click", () => { scheme(isLight() ? "dark" : "light"); this.note(); });
    window.addEventListener("keydown", (event) => this.key(event));
  }

  more(open) {
    $("looks").classList.toggle("open", open);
    $("more").setAttribute("aria-expanded", String(open));
    if (!open) $("more").focus();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.("#panel")) return;
    const { tagName } = event.target, ends = ["Home", "End"].includes(event.key);
    if (event.target === $("pane")) {
      if (this.scene.eye.key(event.key)) { event.preventDefault(); return; }
    } else if (tagName === "INPUT" ? event.target.type !== "range" || !ends : !ends && ["SELECT", "BUTTON", "SUMMARY"].includes(tagName)) {
      return;
    }
    if (!this.timeline.playButton.disabled && this.timeline.key(event.key)) event.preventDefault();
  }

  // What is shown, as pairs for the page's address.
  state() {
    const { scene, timeline } = this, pose = scene.eye.pose;
    return [
      ["t", timeline.time.toFixed(3)], ["play", timeline.playing ? "1" : ""], ["quality", scene.quality.fixed < 0 ? "" : String(scene.quality.fixed)],
      ["speed", timeline.speed === 1 ? "" : String(timeline.speed)],
      ["arrange", scene.over ? "over" : ""], ["look", scene.near ? "near" : scene.auto || !this.payload?.shots?.length ? "" : "all"], ["follow", scene.followed],
      ["bending", $("enlarged").value === "1" ? "" : $("enlarged").value],
      ["signals", this.signals.text], ["scheme", chosenScheme()], ["names", this.signals.full ? "full" : ""], ["phase", this.portrait.text], ["layers", this.legend.text],
      ["eye", pose && pose.map((value) => Number(value.toPrecision(6))).join(" ")],
    ];
  }

  // Shows what pairs say; what they do not name stays. Without a time it goes on as it was.
  become(wanted) {
    const { scene, timeline } = this;
    if (!this.payload?.runs.length) return;
    if (wanted.has("speed")) timeline.setSpeed(Number(wanted.get("speed")));
    if (wanted.has("layers")) {
      this.legend.text = wanted.get("layers");
      scene.shown = this.legend.shown;
      this.legend.load((layer) => this.present(layer));
      for (const [layer] of LAYERS) scene.show(layer);
      this.magnifier.show(this.legend.shown.magnifier);
    }
    if (wanted.has("quality")) scene.quality.fixed = fixedLevel(`#${wanted}`);
    if (wanted.has("arrange")) scene.lay(wanted.get("arrange") === "over");
    if (wanted.has("look")) scene.look(wanted.get("look") || "auto");
    if (wanted.has("bending")) this.enlarge(wanted.get("bending") || "1");
    if (wanted.has("signals")) { this.signals.text = wanted.get("signals"); this.picked(); }
    if (wanted.has("scheme")) scheme(wanted.get("scheme"));
    if (wanted.get("names") === "full") this.name(true);
    if (wanted.has("phase")) this.portrait.text = wanted.get("phase");
    if (wanted.has("t")) timeline.seek(Number(wanted.get("t")));
    if (wanted.has("follow")) scene.follow(wanted.get("follow"));
    const pose = (wanted.get("eye") || "").split(" ").map(Number);
    if (pose.length === 6 && pose.every(Number.isFinite)) scene.eye.pose = pose;
    this.speak();
    timeline.seek(timeline.time);
    scene.refit();
    if (wanted.get("play") === "1") timeline.play();
    else if (wanted.has("t") || wanted.get("play") === "0") timeline.pause();
  }
}
