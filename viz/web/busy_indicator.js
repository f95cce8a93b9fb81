// What a program is doing, for how long already, and how far it is where it says so.
export class Busy {
  constructor(root) {
    this.root = root;
    this.since = 0; // the page itself takes a while to open
    setInterval(() => this.count(), 200);
  }

  say(text) {
    if (this.since === undefined) this.since = performance.now();
    const part = /(\d+) ?%/.exec(text), bar = this.root.querySelector("progress");
    bar.hidden = !part;
    if (part) bar.value = Number(part[1]);
    this.root.querySelector("span").textContent = text;
    this.root.hidden = false;
    this.count();
  }

  count() {
    if (this.since !== undefined) this.root.querySelector("output").textContent = `${((performance.now() - this.since) / 1000).toFixed(0)} s`;
  }

  end() {
    this.since = undefined;
    this.root.hidden = true;
  }
}
