// The studio: joins the player, the server and the panel's parts. Whatever changes, ``show`` says it everywhere.
import { $, digits } from "../format.js";
import { Bookmarks } from "./bookmarks.js";
import { Designs, parsed } from "./designs.js";
import { Docking } from "./docking.js";
import { Estimates } from "./estimates.js";
import { Jobs } from "./jobs.js";
import { Joints } from "./joints.js";
import { Keep } from "./save_design.js";
import { Margins } from "./margins.js";
import { Metrics } from "./metrics.js";
import { Numbers } from "./parameter_tree.js";
import { Rollouts, keyOf } from "./rollouts.js";
import { Slider, firstRange } from "./slider.js";
import { TargetHandle } from "./target_handle.js";
import { Wire } from "./connection.js";
import { STILL, chosenScheme } from "../theme.js";

export class Studio {
  constructor(player, address) {
    this.player = player;
    this.metrics = new Metrics($("metrics"), $("moremetrics"), {
      onChoose: (name) => { this.metric = name; this.slopes = {}; this.show(); },
      onFold: () => this.show(),
    });
    this.numbers = new Numbers($("numbers"), {
      onPin: (path, wanted) => this.pin(path, wanted),
      onValue: (path, value) => this.hand(() => { this.designs.set({ [path]: value }); this.designs.settle(); }),
    });
    const ask = (message) => this.wire.send({ ...message, values: this.designs.now });
    this.bookmarks = new Bookmarks($("designs"), (values) => this.rollouts.known(values)?.metrics);
    this.keep = new Keep($("keep"), ask);
    this.margins = new Margins($("margins"), {
      begin: (request) => this.jobs.begin(request), design: () => this.designs.now, time: () => player.timeline.time,
    });
    this.estimates = new Estimates($("estimates"), player.chart);
    this.jobs = new Jobs($("jobs"), {
      onMargins: (job) => this.margins.hear(job),
      onAble: (able) => this.margins.enable(able),
      ask,
      brief: (key) => this.brief(key),
      onBest: (values, settled) => { this.designs.set(values); if (settled) this.designs.settle(); },
      onCloud: (spread) => player.cloud(spread),
    });
    this.docking = new Docking($("docking"), {
      ask: (message) => this.wire.send(message),
      onPreview: (show) => { player.cloud(null); if (show) player.load(show); else if (this.worn) { this.wear(this.worn); this.show(); } },
    });
    this.joints = new Joints($("joints"), {
      onValue: (path, value) => this.hand(() => { this.begin(); this.designs.set({ [path]: value }); }),
      onSettle: () => this.designs.settle(),
      onRange: () => {},
    });
    this.handle = new TargetHandle(player.scene, $("handle"), {
      onShow: () => this.begin(),
      onValues: (values) => this.hand(() => this.designs.set(values)),
      onSettle: () => this.designs.settle(),
    });
    this.sliders = new Map();
    this.slopes = {};
    this.rollouts = new Rollouts((message) => this.wire.send(message), (values, entry) => this.arrived(values, entry));
    this.wire = new Wire(address, (message) => this.hear(message), () => { player.busy.end(); this.say("the studio's program has ended; this page keeps what it has"); });
    player.link.join({ read: () => this.state(), apply: (wanted) => this.become(wanted) });
    this.listen();
  }

  hear(message) {
    const act = {
      hello: () => this.load(message),
      rollout: () => this.rollouts.answer({ ...message, metrics: this.named(message.metrics), hello: this.hello }),
      failed: () => this.failed(message),
      compiling: () => this.compiles(message),
      gradient: () => this.sloped(message),
      job: () => this.jobs.hear(message),
      saving: () => this.keep.say(message.words),
      saved: () => this.keep.saved(message),
      command: () => this.keep.show(message.text, true),
      urdfs: () => this.docking.offer(message),
      draft: () => this.docking.show(message),
      moved: () => { // of what the address says, the scheme alone holds for the other scenario
        history.replaceState(null, "", location.pathname + location.search + (chosenScheme() && `#scheme=${chosenScheme()}`));
        location.reload();
      },
    }[message.type];
    if (["hello", "failed"].includes(message.type)) this.player.busy.end();
    if (act) act();
  }

  // Values of metrics by their keys.
  named(values) {
    return Object.fromEntries(this.hello.metrics.map(({ key }, k) => [key, values[k]]));
  }

  // What there is to change. A second one tells of another structure: sliders stay where their numbers do.
  load(hello) {
    this.hello = hello;
    const own = Object.fromEntries(hello.numbers.map(({ path, value }) => [path, value]));
    const first = !this.designs;
    if (first) this.designs = new Designs(own, () => this.show()); else this.designs.own = { ...own, ...this.designs.own };
    this.wear(hello);
    if (!first) return;
    for (const path of hello.suggested) this.pinned(path);
    $("paneling").hidden = false;
    this.player.panel(true);
    if (!STILL.matches) this.player.timeline.play();
    this.player.link.follow();
    this.lay();
    document.body.dataset.studio = "true";
  }

  // The page shows this structure: its bodies and its numbers.
  wear(hello) {
    const first = !this.worn;
    this.worn = hello;
    this.drawn = null;
    this.player.cloud(null);
    this.byPath = new Map(hello.numbers.map((number) => [number.path, number]));
    if (!hello.metrics.some(({ key }) => key === this.metric)) this.metric = hello.metrics[0]?.key;
    for (const path of this.sliders.keys()) if (!this.byPath.get(path)?.free) this.sliders.delete(path);
    this.metrics.load(hello.metrics, this.metric);
    this.numbers.load(hello.numbers);
    this.joints.load(hello.numbers);
    this.bookmarks.load(this.designs);
    this.jobs.load(hello.methods, hello.plans);
    this.keep.load(hello);
    const shown = new URLSearchParams(first ? [] : this.player.state().filter(([, value]) => value));
    this.player.load(hello.show);
    this.player.scene.over = true; // the design before lies under the one in the hand
    this.player.become(shown);
    this.handle.load((path) => this.byPath.get(path), hello.show);
  }

  // Sliders.
  pinned(path, range) {
    const number = this.byPath.get(path);
    if (!number?.free || !number.slider || this.sliders.has(path)) return;
    this.sliders.set(path, new Slider(number, range || firstRange(number), {
      onValue: (name, value) => this.hand(() => this.designs.set({ [name]: value })),
      onSettle: () => this.designs.settle(),
      onRange: () => this.player.note(),
      onRemove: (name) => this.pin(name, false),
    }));
  }

  // The user's own change: a search that is under way no longer leads the design.
  hand(change) {
    this.jobs.letGo();
    change();
  }

  // The scene as it begins is seen, where what is changed is how it begins.
  begin() {
    this.player.timeline.pause();
    this.player.timeline.seek(0);
  }

  brief(key = this.metric) {
    const metric = this.worn.metrics.find((one) => one.key === key), { designs } = this;
    const ranges = [...this.sliders].map(([path, { range, least, greatest }]) => ({ path, value: designs.value(path), ...range, least, greatest }));
    return { values: designs.now, metric, ranges, now: this.rollouts.known(designs.now)?.metrics?.[key] };
  }

  pin(path, wanted) {
    if (wanted) this.pinned(path); else this.sliders.delete(path);
    this.lay();
  }

  lay() {
    $("sliders").replaceChildren(...[...this.sliders.values()].map(({ whole }) => whole));
    $("nosliders").hidden = this.sliders.size > 0;
    this.show();
  }

  // The whole page says what the design in the hand is, and what is known of it.
  show() {
    const { designs, rollouts } = this, known = rollouts.known(designs.now), before = rollouts.known(designs.before?.values);
    rollouts.want(designs.now, [designs.before?.values, ...designs.kept.map(({ values }) => values)]);
    if (known?.run && known.hello !== this.worn) this.wear(known.hello);
    for (const [path, slider] of this.sliders) slider.update(designs.value(path), this.player.signals?.full);
    this.handle.update((path) => designs.value(path));
    this.joints.show((path) => designs.value(path), this.player.signals?.full);
    this.numbers.update((path) => designs.value(path), (path) => this.sliders.has(path));
    if (known?.run) this.metrics.show(known.metrics, before?.metrics);
    if (known) this.draw(known, before);
    $("undo").disabled = !designs.canUndo;
    $("redo").disabled = !designs.canRedo;
    $("restore").disabled = Object.keys(designs.now).length === 0;
    this.bookmarks.show(this.metrics.seen, (path) => this.byPath.get(path)?.unit, this.player.signals?.full);
    this.jobs.enable(this.sliders.size > 0);
    if (!this.jobs.running) this.margins.show();
    this.status();
    this.slope();
    this.player.note();
  }

  draw(known, before) {
    if (!known.run) return; // the motion before stays
    const other = before?.run && before.hello === known.hello ? before.run : undefined; // of the same bodies
    const pair = [known.run, other, this.designs.before?.name];
    if (pair.every((one, k) => one === this.drawn?.[k])) return;
    this.drawn = pair;
    const { nodes } = known.hello.show.runs[0];
    const runs = [{ nodes, ...known.run, label: "this design" }];
    if (other) runs.push({ nodes, ...other, label: this.designs.before.name, pale: true });
    this.player.renew(runs, known.warnings);
    this.estimates.show(this.player.signals);
    document.body.dataset.drawn = String(Number(document.body.dataset.drawn || 0) + 1);
  }

  status() {
    const known = this.rollouts.known(this.designs?.now);
    if (known?.message) this.say(`This design has no result: ${known.message} The previous motion remains.`);
    else if (known) {
      const { seconds: { rollout } } = known, lasted = rollout < 1 ? `${digits(1e3 * rollout)} ms` : `${digits(rollout)} s`;
      this.say(known.words || `simulated in ${lasted}`);
    } else this.say("simulating", true);
  }

  say(text, busy = false) {
    $("status").textContent = text;
    $("status").classList.toggle("busy", busy);
  }

  // While the hand moves, each answer is shown, although it is no longer the newest.
  arrived(values, entry) {
    if (keyOf(values) === keyOf(this.designs.now) || !this.designs.moving) { this.show(); return; }
    const before = this.designs.before?.values, other = this.rollouts.known(before);
    if (!entry.run || entry.hello !== this.worn || keyOf(values) === keyOf(before)) return;
    this.draw(entry, other);
    this.metrics.show(entry.metrics, other?.metrics);
  }

  // Gradients are compiled while all else goes on.
  compiles({ what, why }) {
    if (what === "gradients") {
      this.pieces = why.match(/\d+ of \d+ pieces/)?.[0];
      if (this.worn) this.point();
    } else if (why) this.say(why, true); else this.status();
  }

  failed(message) {
    const act = {
      set: () => this.rollouts.answer(message),
      save: () => this.keep.say(message.message),
      command: () => this.keep.say(message.message),
      ...Object.fromEntries(["urdfs", "draft", "open"].map((what) => [what, () => this.docking.say(message.message)])),
    }[message.what] || (() => (this.jobs.running ? this.jobs.refused(message.message) : this.say(message.message)));
    act();
  }

  // Asks for the metric's slopes once the hand rests.
  slope() {
    clearTimeout(this.resting);
    const { designs } = this, paths = [...this.sliders.keys()], asked = `${this.metric} ${keyOf(designs.now)}`;
    if (this.slopes.of !== asked) this.slopes = { of: asked, d: {} };
    this.point();
    if (!this.metric || designs.moving || !this.rollouts.known(designs.now)?.run || paths.every((path) => path in this.slopes.d)) return;
    this.resting = setTimeout(() => {
      this.asked = asked;
      this.wire.send({ type: "gradient", seq: this.rollouts.seq, metric: this.metric, paths, values: designs.now });
      this.point();
    }, 120);
  }

  sloped({ metric, d, status }) {
    if (this.asked !== this.slopes.of || metric !== this.metric) return;
    Object.assign(this.slopes.d, d);
    this.slopes.status = status;
    this.point();
  }

  point() {
    const metric = this.worn.metrics.find(({ key }) => key === this.metric), { d } = this.slopes;
    const largest = Math.max(0, ...[...this.sliders.keys()].map((path) => this.effect(path)));
    for (const [path, slider] of this.sliders) slider.point(d[path], metric, largest);
    $("slopes-notice").textContent = this.slopesNotice;
    $("slopes-notice").hidden = !this.slopesNotice;
    $("sort").disabled = !(largest > 0);
  }

  // Text about the accuracy of the slopes, empty if they are exact.
  get slopesNotice() {
    const { slopes: { status }, pieces } = this;
    if (status === "differences") return `Sensitivities (change for +10 %) are finite differences of rollouts until exact gradients are compiled${pieces ? ` (${pieces})` : ""}.`;
    if (!status) return this.asked && this.asked === this.slopes.of ? "Sensitivities (change for +10 %) are being computed." : "";
    return status === "exact" ? "" : `Sensitivities (change for +10 %) may be inaccurate: ${status.replace(/^inaccurate: /, "")}.`;
  }

  // How much the metric changes, as the slider's arrow says it.
  effect(path) {
    return Math.abs((this.slopes.d[path] || 0) * (Math.abs(this.designs.value(path)) / 10 || 1));
  }

  sort() {
    this.sliders = new Map([...this.sliders].sort(([a], [b]) => this.effect(b) - this.effect(a)));
    this.lay();
  }

  listen() {
    $("sort").addEventListener("click", () => this.sort());
    $("undo").addEventListener("click", () => this.step(-1));
    $("fullnames").addEventListener("click", () => { this.show(); this.estimates.draw(); });
    $("redo").addEventListener("click", () => this.step(1));
    $("restore").addEventListener("click", () => this.hand(() => this.designs.take({})));
    window.addEventListener("keydown", (event) => this.key(event));
  }

  // What a search has led to so far counts as a step of its own.
  step(steps) {
    this.hand(() => { this.designs.settle(); this.designs.go(steps); });
  }

  key(event) {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || !this.designs) return;
    if (["search", "text"].includes(event.target.type)) return; // these undo their own letters
    const name = event.key.toLowerCase(), steps = name === "y" || (name === "z" && event.shiftKey) ? 1 : name === "z" ? -1 : 0;
    if (!steps) return;
    event.preventDefault();
    this.step(steps);
  }

  // For the page's address.
  state() {
    if (!this.designs) return [];
    const pins = [...this.sliders].map(([path, { range }]) => [path, range.low, range.high, range.log ? "log" : "lin"].join(":"));
    return [
      ["set", JSON.stringify(this.designs.now)], ["pins", pins.join(";")], ["metric", this.metric],
      ...this.designs.kept.map(({ name, values }) => ["design", JSON.stringify({ name, values })]),
    ];
  }

  become(wanted) {
    if (!this.designs) return;
    if (wanted.has("pins")) {
      this.sliders.clear();
      for (const pin of wanted.get("pins").split(";").filter(Boolean)) {
        const [path, low, high, kind] = pin.split(":");
        const range = { low: Number(low), high: Number(high), log: kind === "log" };
        this.pinned(path, range.low < range.high ? range : undefined);
      }
    }
    if (this.hello.metrics.some(({ key }) => key === wanted.get("metric"))) this.metrics.choose(this.metric = wanted.get("metric"));
    for (const { name, values } of wanted.getAll("design").map(parsed)) {
      const taken = this.designs.kept.some((one) => one.name === name);
      if (typeof name === "string" && !taken) this.designs.keep(name, Designs.plain(values));
    }
    if (wanted.has("set")) this.designs.take(Designs.plain(parsed(wanted.get("set"))));
    this.lay();
  }
}
