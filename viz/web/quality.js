// How much is drawn: where pictures come too slowly the finest things go first, and where nothing moves all come back.

// Each without one more thing. ``ratio``: pixels a CSS pixel; ``shadows``: edge of their map; ``soft``: their edges; ``mirrors``: metals
// reflect; ``creases``: foil is crinkled; ``gloss``: light is computed for each pixel, and else for each vertex; ``share``: of the plumes' particles. What each costs is measured in benchmarks/page_frames.py.
export const LEVELS = [
  { ratio: 1, shadows: 2048, soft: true, mirrors: true, creases: true, gloss: true, share: 1 },
  { ratio: 1, shadows: 2048, soft: true, mirrors: false, creases: true, gloss: true, share: 0.7 },
  { ratio: 1, shadows: 1024, soft: false, mirrors: false, creases: true, gloss: true, share: 0.5 },
  { ratio: 1, shadows: 1024, soft: false, mirrors: false, creases: false, gloss: false, share: 0.4 },
  { ratio: 0.75, shadows: 512, soft: false, mirrors: false, creases: false, gloss: false, share: 0.3 },
  { ratio: 0.5, shadows: 0, soft: false, mirrors: false, creases: false, gloss: false, share: 0.2 },
];
const SLOW_MS = 45, WINDOW = 10, REST_MS = 500; // 45 ms: more than 20 pictures a second
const FAST_MS = SLOW_MS / 2, AGAIN_MS = 1000; // so fast, a finer level is tried again, as after the page has opened; later each time that one was too slow

// The level that an address asks for by ``quality=``; -1 where it asks for none, and what is drawn adapts itself.
export function fixedLevel(hash) {
  const level = Number(new URLSearchParams(hash.slice(1)).get("quality") || NaN);
  return level in LEVELS ? level : -1;
}

export class Quality {
  // ``apply`` hears the level; ``software``: whether a processor draws, which cannot keep up with the finest levels.
  constructor(apply, software) {
    this.apply = apply;
    this.finest = this.level = software ? 2 : 0; // of what moves
    this.again = AGAIN_MS;
    this.changed = 0; // when the level did, ms
    this.fixed = fixedLevel(location.hash); // or the level of a recording, which waits for each of its pictures
    this.applied = this.fixed >= 0 ? this.fixed : this.level;
    this.times = [];
    this.moved = performance.now(); // a page opens at the level at which it will move
  }

  // A frame begins, ``now`` [ms]; ``moving``: whether the next will differ.
  tick(now, moving) {
    if (this.fixed >= 0) { this.set(this.fixed); return; }
    if (!moving) {
      this.times = [];
      if (now - this.moved > REST_MS) this.set(0);
      return;
    }
    this.moved = now;
    this.set(this.level);
    this.times.push(now);
    if (this.times.length <= WINDOW) return;
    // the median bears a hitch
    const gaps = this.times.slice(1).map((t, k) => t - this.times[k]).sort((a, b) => a - b), gap = gaps[gaps.length >> 1];
    this.times = [];
    const change = gap > SLOW_MS ? 1 : gap < FAST_MS && now - this.changed > this.again ? -1 : 0;
    const level = Math.min(LEVELS.length - 1, Math.max(this.finest, this.level + change));
    if (level === this.level) return;
    if (level > this.level) this.again *= 2;
    [this.level, this.changed] = [level, now];
  }

  // Something has moved once, and may do so again soon.
  stir() {
    this.moved = performance.now();
    this.set(this.level);
  }

  set(level) {
    if (level === this.applied) return;
    this.applied = level;
    this.apply(LEVELS[level]);
  }
}
