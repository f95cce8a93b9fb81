// What is known of designs: each is rolled out once, one at a time, the newest that is wanted first.
const KEPT_ROLLOUTS = 60; // of each: some hundred kB

export class Rollouts {
  // ``ask``: sends a request for a design's values; ``onKnown`` hears of each answer.
  constructor(ask, onKnown) {
    this.ask = ask;
    this.onKnown = onKnown;
    this.forget();
    this.seq = 0;
  }

  forget() {
    this.entries = new Map();
    this.flying = null;
    this.wanted = null;
    this.others = [];
  }

  // ``{run, metrics, ...}``, ``{message}`` for one that failed, or nothing yet.
  known(values) {
    return values && this.entries.get(keyOf(values));
  }

  // The design in the hand: it replaces whatever waits; ``others`` are rolled out when nothing else is to be done.
  want(values, others = []) {
    this.wanted = values;
    this.others = others;
    this.go();
  }

  get busy() { return this.flying !== null; }

  go() {
    if (this.flying) return;
    const values = [this.wanted, ...this.others].find((one) => one && !this.known(one));
    if (!values) return;
    this.seq += 1;
    this.flying = { seq: this.seq, values };
    this.ask({ type: "set", seq: this.seq, values });
  }

  // An answer: a rollout, or why there is none.
  answer({ seq, ...entry }) {
    if (seq !== this.flying?.seq) return;
    const { values } = this.flying;
    this.flying = null;
    this.keep(values, entry);
    this.go(); // the server works while the page draws
    this.onKnown(values, entry);
  }

  keep(values, entry) {
    this.entries.delete(keyOf(values));
    this.entries.set(keyOf(values), entry);
    if (this.entries.size > KEPT_ROLLOUTS) this.entries.delete(this.entries.keys().next().value);
  }
}

// The same text for the same design, in whatever order its numbers were changed.
export function keyOf(values) {
  return JSON.stringify(Object.entries(values).sort(([a], [b]) => (a < b ? -1 : 1)));
}
