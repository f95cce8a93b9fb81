// Time: where it stands, whether and how fast it runs, and the controls for it.
import { options } from "./format.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100, 1000, 10000, 100000];
const THUMB = 16; // px, width of the seek bar's knob; in step with page.css
const REST = 1.2; // s at the end before it starts again

export class Timeline {
  constructor({ play, scrub, clock, speed }, { onSeek, onRest }) {
    this.playButton = play;
    this.scrub = scrub;
    this.clock = clock;
    this.speedSelect = speed;
    this.onSeek = onSeek;
    this.onRest = onRest;
    this.time = 0;
    this.duration = 1e-9;
    this.speed = 1;
    this.playing = false;
    play.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    scrub.addEventListener("input", () => this.go(Number(scrub.value)));
    speed.addEventListener("change", () => { this.speed = Number(speed.value); this.onRest(); });
  }

  // A speed at which it lasts half a minute at most, if real time takes more than one.
  load(duration, able) {
    this.duration = duration;
    this.scrub.max = duration;
    const fastest = 5 * Math.max(1, duration / 20), speeds = SPEEDS.filter((speed) => speed <= fastest);
    options(this.speedSelect, speeds.map((speed) => [speed, `${speed}×`]));
    this.setSpeed(duration <= 60 ? 1 : speeds.find((speed) => duration / speed <= 30) || 1);
    this.enable(able);
    this.pause();
  }

  // It lasts longer or shorter than before; all else stays.
  stretch(duration) {
    this.duration = duration;
    this.scrub.max = duration;
  }

  setSpeed(speed) {
    if (!(speed > 0 && Number.isFinite(speed))) return;
    this.speed = speed;
    this.speedSelect.value = String(speed);
  }

  enable(able) {
    for (const control of [this.playButton, this.scrub, this.speedSelect]) control.disabled = !able;
    this.clock.hidden = !able;
  }

  seek(time) {
    this.time = Math.min(this.duration, Math.max(0, time || 0));
    this.scrub.value = this.time;
    this.scrub.setAttribute("aria-valuetext", `${this.time.toFixed(2)} s`);
    this.clock.textContent = `${this.time.toFixed(2)} / ${Number(this.duration.toPrecision(5))} s`;
    this.onSeek(this.time);
  }

  // The bar's ends stand at these places in the window, px; anywhere if they are the same. Gives where they stand.
  align(left, right) {
    const own = this.scrub.parentElement.getBoundingClientRect(), half = THUMB / 2;
    const free = right <= left;
    this.scrub.style.marginLeft = free ? "" : `${left - own.left - half}px`;
    this.scrub.style.width = free ? "" : `${right - left + THUMB}px`;
    return free ? [own.left + half, own.right - half] : [left, right];
  }

  // Stand still at a time.
  go(time) {
    this.seek(time);
    this.pause();
  }

  // So many seconds have passed.
  tick(passed) {
    if (!this.playing) return;
    const ended = this.time >= this.duration;
    this.rest = ended ? (this.rest || 0) + passed : 0;
    if (!ended) this.seek(this.time + passed * this.speed);
    else if (this.rest > REST) this.seek(0);
  }

  play() {
    if (this.playButton.disabled) return;
    this.set(true);
    if (this.time >= this.duration) this.seek(0);
  }

  pause() {
    this.set(false);
    this.onRest();
  }

  set(playing) {
    this.playing = playing;
    this.playButton.textContent = playing ? "❚❚" : "▶";
    this.playButton.setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  // Whether a key meant something.
  key(name) {
    const act = {
      " ": () => (this.playing ? this.pause() : this.play()),
      ArrowRight: () => this.go(this.time + this.duration / 250),
      ArrowLeft: () => this.go(this.time - this.duration / 250),
      Home: () => this.go(0),
      End: () => this.go(this.duration),
    }[name];
    if (act) act();
    return Boolean(act);
  }
}
