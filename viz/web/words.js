// Everything the page says: layers, readout, curves, names in the scene, what is being done.
const LAYERS = [
  ["names", "names", "#ffffff", "text"], ["traces", "paths of tips and object", COLOURS.target, "line"],
  ["reference", "reference paths of tips", COLOURS.reference, "thin"],
  ["forces", "grip forces on the object", COLOURS.force, "arrow"],
  ["mates", "tips in their mating points", COLOURS.mate, "ring"],
  ["ghosts", "where bodies began", "#b9c3ce", "box"], ["magnifier", "tip errors, enlarged", "#5b6c7e", "ring"],
  ["frames", "axes x, y, z: red, green, blue", AXIS_COLOURS[0], "line"],
];
const HIDDEN_AT_FIRST = ["frames"];
const $ = (id) => document.getElementById(id);

function element(tag, text, name) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (name) made.className = name;
  return made;
}

function mark(colour, shape = "line") {
  const made = element("i", shape === "text" ? "a" : undefined, shape);
  made.style.color = colour;
  return made;
}

function called(body) {
  return body === "target" ? "object" : body;
}

// Boxes that show and hide layers; small panes begin with them folded away.
function layerBoxes(present, shown, onToggle) {
  const boxes = LAYERS.filter(([name]) => present(name)).map(([name, text, colour, shape]) => {
    const label = element("label"), box = element("input");
    box.type = "checkbox";
    box.checked = shown[name];
    box.addEventListener("change", () => onToggle(name, box.checked));
    label.append(box, mark(colour, shape), text);
    return label;
  });
  $("layers").replaceChildren(...boxes);
  $("legend").hidden = boxes.length === 0;
}

// Time, and the size of each tip's error.
class Readout {
  load(runs) {
    this.clock = element("div", "", "time");
    this.values = [];
    const rows = [this.clock];
    runs.forEach((run, r) => {
      if (runs.length > 1) rows.push(element("div", `${run.data.label}${r ? " (dashed)" : ""}`, "run"));
      run.data.tip_names.forEach((name, k) => {
        const row = element("div", undefined, "tip"), value = element("b");
        row.append(mark(TIP_COLOURS[k % TIP_COLOURS.length]), `${name} error `, value);
        rows.push(row);
        this.values.push([value, run, k]);
      });
    });
    $("readout").replaceChildren(...rows);
  }

  seek(time) {
    this.clock.textContent = `t = ${time.toFixed(2)} s`;
    for (const [value, run, k] of this.values) {
      const past = time > run.end + 1e-9;
      value.textContent = past ? `diverged after ${run.end.toPrecision(3)} s` : amount(run.value(0, k, time), "mm");
    }
  }
}

// What the plot shows, named and in numbers.
class Curves {
  constructor() {
    this.values = [];
  }

  load(runs, which) {
    [this.runs, this.which] = [runs, which];
    this.values = [];
    const plot = runs[0].data.plots[which], shown = [];
    runs.forEach((run, r) => {
      if (runs.length > 1) shown.push(element("span", `${run.data.label}${r ? " (dashed)" : ""}:`, "run"));
      run.data.plots[which].curves.forEach((curve, k) => {
        const one = element("span"), value = element("b");
        one.append(mark(curveColour(curve.colour)), `${curve.name} `, value);
        this.values.push([value, run, k]);
        shown.push(one);
      });
    });
    this.unit = plot.unit;
    $("curves").replaceChildren(...shown);
  }

  seek(time) {
    for (const [value, run, k] of this.values) value.textContent = amount(run.value(this.which, k, Math.min(time, run.end)), this.unit);
  }
}

// Names of bodies in the scene, and of runs below them.
class Labels {
  load(runs) {
    this.bodies = runs.flatMap((run) => run.data.nodes.flatMap((node, k) => (
      node.base ? [{ object: run.nodes[k], span: element("span", called(node.body), "name"), above: this.radius(node) }] : []
    )));
    this.feet = runs.length > 1 ? runs.map((run) => element("span", run.data.label)) : [];
    $("labels").replaceChildren(...this.bodies.map(({ span }) => span), ...this.feet);
  }

  // An object's name stands above it and hides nothing; a robot's stands on its base.
  radius(node) {
    if (node.body !== "target" || !node.solids.length) return 0;
    return Math.max(...node.solids.map(({ kind, size }) => (
      kind === "box" ? Math.hypot(...size) / 2 : kind === "mesh" ? 0 : Math.max(...size)
    )));
  }

  place(camera, pane, boxes, planar, { names, beside }) {
    const wide = pane.clientWidth, tall = pane.clientHeight, at = new THREE.Vector3();
    const put = (span, x, y, visible) => {
      span.hidden = !visible || x < 0 || x > wide;
      span.style.left = `${x}px`;
      span.style.top = `${Math.max(4, Math.min(tall - 24, y))}px`;
    };
    for (const { object, span, above } of this.bodies) {
      object.getWorldPosition(at);
      const perMetre = tall / (2 * at.distanceTo(camera.position) * Math.tan((camera.fov * Math.PI) / 360));
      at.project(camera);
      const lift = above ? above * perMetre + 20 : 10;
      put(span, ((at.x + 1) / 2) * wide, ((1 - at.y) / 2) * tall - lift, names && at.z < 1 && Math.abs(at.y) < 1);
    }
    this.feet.forEach((span, k) => {
      const [low, high] = boxes[k], foot = planar ? [low[1], 0] : [(low[1] + high[1]) / 2, low[2]];
      const foot3 = Eye.toThree([(low[0] + high[0]) / 2, ...foot]).project(camera);
      put(span, ((foot3.x + 1) / 2) * wide, Math.min(tall - 24, ((1 - foot3.y) / 2) * tall), beside);
    });
  }
}

// What a program is doing, for how long already, and how far it is where it says so.
class Busy {
  constructor() {
    setInterval(() => this.count(), 200);
  }

  say(text) {
    if (this.since === undefined) this.since = performance.now();
    const part = /(\d+) ?%/.exec(text), bar = $("busy").querySelector("progress");
    bar.hidden = !part;
    if (part) bar.value = Number(part[1]);
    $("busy").querySelector("span").textContent = text;
    $("busy").hidden = false;
    this.count();
  }

  count() {
    if (this.since !== undefined) $("busy").querySelector("output").textContent = `${((performance.now() - this.since) / 1000).toFixed(0)} s`;
  }

  end(text) {
    this.since = undefined;
    $("busy").hidden = true;
    if (text) $("about").textContent = text;
  }
}
