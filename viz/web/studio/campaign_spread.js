// A campaign without its server: how a metric is distributed, bands of a signal over time, tips as a cloud.
import { floats, options } from "../format.js";
import { plotHistogram } from "./plots.js";

export class Spread {
  constructor(root, player) {
    this.spreads = [];
    this.root = root;
    this.player = player;
    this.sets = root.querySelector(".gains");
    this.metrics = root.querySelector(".metric");
    this.plot = root.querySelector(".plot");
    this.words = root.querySelector("p");
    this.sets.addEventListener("change", () => this.choose());
    this.metrics.addEventListener("change", () => this.draw());
  }

  // ``spreads``: one for each set of gains; nothing where the page is about no campaign.
  load(spreads = []) {
    this.spreads = spreads;
    this.root.hidden = spreads.length === 0;
    options(this.sets, spreads.map(({ name }, k) => [k, name]));
    this.sets.parentElement.hidden = spreads.length < 2;
    this.choose();
  }

  choose() {
    const spread = this.spreads[Number(this.sets.value)], kept = this.metrics.value;
    this.player.cloud(spread || null);
    if (!spread) return;
    options(this.metrics, spread.metrics.map(({ key, label }) => [key, label]));
    if (spread.metrics.some(({ key }) => key === kept)) this.metrics.value = kept;
    this.draw();
  }

  draw() {
    const spread = this.spreads[Number(this.sets.value)], metric = spread?.metrics.find(({ key }) => key === this.metrics.value);
    if (!metric || !this.plot.clientWidth) return; // the panel is closed
    const values = [...floats(metric.values)], lost = values.filter((value) => !Number.isFinite(value)).length;
    plotHistogram(this.plot, values, undefined, metric);
    const words = `${metric.label} of ${values.length} samples${lost ? `, ${lost} of them without a value` : ""}`;
    this.plot.setAttribute("aria-label", `distribution: ${words}`);
    this.words.textContent = `${words}.${spread.drawn ? ` Bands of curves and paths of tips: ${spread.drawn} samples.` : ""}`;
  }
}
