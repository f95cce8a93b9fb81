// What the page shows, in its address: behind "#", so that a link shows the same and nothing is sent to anybody.
export class Link {
  // A part's ``read`` gives what it shows as pairs of name and text; its ``apply`` shows such pairs again.
  constructor(part) {
    this.parts = [part];
    // the address may have been written anew since, by what was noted before
    window.addEventListener("hashchange", (event) => this.follow(event.newURL));
  }

  join(part) {
    this.parts.push(part);
  }

  follow(address = location.href) {
    clearTimeout(this.timer);
    const wanted = new URLSearchParams(new URL(address).hash.slice(1));
    for (const { apply } of this.parts) apply(wanted);
  }

  // Soon, and once for many changes: browsers refuse to note too many.
  note() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.write(), 250);
  }

  write() {
    const text = new URLSearchParams(this.parts.flatMap(({ read }) => read()).filter(([, value]) => value !== "" && value !== null)).toString();
    try {
      // '/', ':' and ';' may stand in a fragment as they are
      history.replaceState(null, "", `#${text.replace(/%2F/g, "/").replace(/%3A/g, ":").replace(/%3B/g, ";")}`);
    } catch {
      // a page within a page, as in a report, has no address of its own
    }
  }
}
