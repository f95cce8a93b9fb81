// What runs in the background: steps along the gradient, a search, a campaign. One at a time; it can be stopped.
import { amount, options } from "../format.js";
import { plotConvergence, plotHistogram } from "./plots.js";

export class Jobs {
  // ``ask`` sends a request; ``brief`` gives what the design in the hand is: values, ranges, the metric of a key (else
  // the chosen one) and its value now. ``onMargins`` hears of jobs of that kind, ``onAble`` whether a job may begin.
  constructor(root, { ask, brief, onBest, onCloud, onMargins, onAble }) {
    this.root = root;
    this.ask = ask;
    this.brief = brief;
    this.onBest = onBest;
    this.onCloud = onCloud;
    this.onMargins = onMargins;
    this.onAble = onAble;
    this.part = (name) => root.querySelector(`.${name}`);
    this.part("improve").addEventListener("click", () => this.start("improve"));
    this.part("tune").addEventListener("click", () => this.start("tune", { method: this.part("method").value }));
    this.part("plan").addEventListener("click", () => this.begin({ type: "plan" }));
    this.part("campaign").addEventListener("click", () => this.campaign());
    this.part("stop").addEventListener("click", () => this.ask({ type: "stop", job: this.id }));
    this.part("best").addEventListener("click", () => this.take(true));
    this.enable();
  }

  // ``plans``: whether the scenario has an approach to be planned.
  load(methods, plans) {
    this.part("plan").hidden = !plans;
    options(this.part("method"), methods);
    this.enable();
  }

  start(type, more = {}) {
    const { values, metric, ranges } = this.brief();
    const bounds = Object.fromEntries(ranges.map(({ path, low, high }) => [path, [low, high]]));
    this.begin({ type, values, metric: metric.key, bounds, ...more });
  }

  // Each number with a slider spreads evenly about its value.
  campaign() {
    const { values, metric, ranges } = this.brief(), share = Number(this.part("spread").value) / 100;
    const spreads = Object.fromEntries(ranges.map(({ path, value, low, high, least, greatest }) => {
      const half = share * (Math.abs(value) || high - low);
      return [path, { kind: "uniform", lower: Math.max(least, value - half), upper: Math.min(greatest, value + half) }];
    }));
    this.begin({ type: "campaign", values, metric: metric.key, spreads, samples: Number(this.part("samples").value) });
  }

  begin(request) {
    this.id = undefined;
    this.following = true;
    this.last = null;
    this.say("starting");
    this.running = true;
    this.onCloud(null);
    this.enable();
    this.ask(request);
  }

  hear(job) {
    this.id = job.id;
    this.last = job;
    this.running = job.state === "running";
    if (job.progress === undefined) this.part("progress").removeAttribute("value"); else this.part("progress").value = job.progress;
    if (job.kind === "margins") this.onMargins(job);
    const spent = job.samples ? `${job.done} of ${job.samples} samples` : job.curve?.length ? `${Math.round(job.curve.at(-1)[0])} rollouts` : "";
    this.say([this.running ? "" : job.state, job.message, spent].filter(Boolean).join(": "));
    if (job.paths) this.onCloud(job);
    if (job.best && this.following) this.take(!this.running);
    this.enable();
    this.draw();
  }

  // The design in the hand becomes the best one so far; ``settled``: as a step.
  take(settled) {
    if (this.last?.best) this.onBest(this.last.best.values, settled);
  }

  // The hand is on the numbers itself now.
  letGo() {
    this.following = false;
    this.enable();
  }

  refused(message) {
    this.running = false;
    this.say(message);
    this.enable();
  }

  say(text) {
    this.part("words").textContent = text;
  }

  draw() {
    const plot = this.part("plot"), { last } = this, { metric, now } = this.brief(last?.metric);
    plot.hidden = !last || !(last.values || last.curve)?.length;
    if (plot.hidden) return;
    if (last.kind === "campaign") plotHistogram(plot, last.values, now, metric);
    else plotConvergence(plot, last.curve, metric);
    const best = last.best ? `best ${metric.label}: ${amount(last.best.objective, metric.unit)}` : "";
    plot.setAttribute("aria-label", last.kind === "campaign" ? `distribution of ${metric.label} over ${last.done} samples` : `convergence, ${best}`);
  }

  enable(able = true) {
    this.able = able;
    for (const name of ["improve", "tune", "campaign"]) this.part(name).disabled = this.running || !able;
    this.part("plan").disabled = this.running;
    this.onAble(!this.running);
    this.part("stop").disabled = !this.running || !this.id;
    this.part("progress").hidden = !this.running;
    this.part("best").hidden = this.following || !this.last?.best;
  }
}
