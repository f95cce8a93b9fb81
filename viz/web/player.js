// Play, pause, scrub, compare.
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100, 1000, 10000, 100000];

class Player {
  constructor() {
    this.viewer = new MeshCat.Viewer($("pane"));
    this.viewer.gui.domElement.style.display = "none";
    this.viewer.hide_background();
    this.eye = new Eye(this.viewer, $("pane"), () => this.refill());
    this.plot = new Plot($("plot"), (time) => { this.pause(); this.seek(time); });
    this.magnifier = new Magnifier($("magnifier"), this.eye);
    this.readout = new Readout();
    this.curves = new Curves();
    this.labels = new Labels();
    this.runs = [];
    this.shown = Object.fromEntries(LAYERS.map(([name]) => [name, !HIDDEN_AT_FIRST.includes(name)]));
    this.time = 0;
    this.playing = false;
    $("legend").open = window.innerWidth > NARROW && window.innerHeight > 480;
    this.light();
    this.listen();
    this.last = performance.now();
    requestAnimationFrame((now) => this.tick(now));
  }

  light() {
    for (const name of ["PointLightNegativeX", "PointLightPositiveX", "FillLight", "SpotLight"]) {
      this.viewer.set_property(["Lights", name], "visible", false);
    }
    this.viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.55);
    for (const name of ["Grid", "Axes"]) this.viewer.set_property([name], "visible", false);
    const key = new THREE.DirectionalLight(0xffffff, 0.42), rim = new THREE.DirectionalLight(0xbfd8ff, 0.2);
    key.position.set(-3, -4, 9);
    rim.position.set(6, 3, 2);
    this.viewer.set_object(["Lights", "Key"], key);
    this.viewer.set_object(["Lights", "Rim"], rim);
  }

  load(payload) {
    this.payload = payload;
    keepMeshes(payload.meshes);
    this.near = false;
    this.build();
    this.duration = Math.max(...this.runs.map((run) => run.end), 1e-9);
    this.plot.load(this.runs, this.duration);
    this.magnifier.load(this.runs);
    this.enable(this.runs.some((run) => run.time.length > 1));
    this.pause();
    $("look").value = "all";
    this.words();
    this.grid();
    this.arrange();
    for (const [name] of LAYERS) this.toggle(name, this.shown[name]);
    this.seek(0);
  }

  // Objects of all runs; paths, arrows and marks are thin where the camera is close.
  build() {
    for (const [k] of this.runs.entries()) this.viewer.delete_path([`run${k}`]);
    this.runs = this.payload.runs.map((data, k) => {
      const run = new Run(data, this.payload.scale, this.near ? this.closeness() : 1);
      this.viewer.set_object([`run${k}`], run.root);
      return run;
    });
  }

  // How much smaller the close view is than the whole.
  closeness() {
    const spans = [0, 1, 2].map((c) => {
      const values = this.payload.near.map((p) => p[c]);
      return Math.max(...values) - Math.min(...values);
    });
    return Math.min(1, (1.6 * Math.hypot(...spans)) / this.payload.scale);
  }

  look(near) {
    this.near = near && this.payload.near.length > 0;
    $("look").value = this.near ? "near" : "all";
    this.build();
    this.speak();
    this.arrange();
    for (const [name] of LAYERS) this.toggle(name, this.shown[name]);
  }

  words() {
    const { title, about, notices } = this.payload;
    document.title = $("title").textContent = title;
    $("about").textContent = $("about").title = about;
    $("notice").hidden = notices.length === 0;
    $("notice").replaceChildren(...notices.map((text) => element("div", text)));
    $("scrub").max = this.duration;
    $("placing").hidden = this.runs.length < 2;
    $("looking").hidden = this.payload.near.length === 0;
    const fastest = Math.max(1, this.duration / 20);
    const speeds = SPEEDS.filter((speed) => speed <= 5 * fastest);
    $("speed").replaceChildren(...speeds.map((speed) => {
      const option = element("option", `${speed}×`);
      option.value = speed;
      return option;
    }));
    this.speed = this.duration <= 60 ? 1 : speeds.find((speed) => this.duration / speed <= 30) || 1;
    $("speed").value = this.speed;
    const present = { names: true, magnifier: this.magnifier.useful };
    layerBoxes(
      (name) => present[name] ?? this.runs.some((run) => run.layers[name].length > 0), this.shown,
      (name, visible) => this.toggle(name, visible),
    );
    this.speak();
    this.quantities();
  }

  // Words that follow the runs' objects.
  speak() {
    this.readout.load(this.runs);
    this.labels.load(this.runs);
    this.plot.runs = this.curves.runs = this.runs;
    if (this.curves.which !== undefined) this.curves.load(this.runs, this.curves.which);
    this.magnifier.load(this.runs);
  }

  // What can be plotted.
  quantities() {
    const plots = this.runs[0].data.plots, drawn = plots.flatMap(({ curves }, k) => (curves.length ? [k] : []));
    const which = drawn.includes(this.plot.which) ? this.plot.which : drawn[0];
    $("plotted").hidden = $("plot").hidden = which === undefined;
    $("quantity").replaceChildren(...drawn.map((k) => {
      const option = element("option", `${plots[k].title} [${plots[k].unit}]`);
      option.value = k;
      return option;
    }));
    if (which !== undefined) this.choose(which);
  }

  choose(which) {
    $("quantity").value = which;
    this.plot.choose(which);
    this.curves.load(this.runs, which);
  }

  // A scene that has not been simulated yet cannot be played.
  enable(able) {
    for (const id of ["play", "scrub", "speed"]) $(id).disabled = !able;
    $("clock").hidden = !able;
  }

  // Lines a round distance apart, below everything: they give the scale.
  grid() {
    const [low, high] = this.payload.box, wide = Math.max(high[0] - low[0], high[1] - low[1]);
    const step = niceStep((wide || this.payload.scale || 1) / 12), half = Math.ceil((4 * wide) / step || 1) * step;
    const grid = new THREE.GridHelper(2 * half, Math.round((2 * half) / step), COLOURS.grid, COLOURS.grid);
    grid.rotateX(Math.PI / 2);
    grid.position.set(Math.round((low[0] + high[0]) / 2 / step) * step, Math.round((low[1] + high[1]) / 2 / step) * step, low[2]);
    grid.material.transparent = true;
    grid.material.opacity = 0.16;
    grid.material.depthWrite = false;
    this.viewer.set_object(["Scale"], grid);
    this.spacing = `grid ${Number(step.toPrecision(3))} m`;
    const force = this.payload.greatest_force;
    $("scale").textContent = force > 0 ? `${this.spacing}; longest arrow ${force.toPrecision(3)} N` : this.spacing;
  }

  // Several runs beside each other where most room is, or over each other.
  arrange() {
    const [low, high] = this.payload.box, size = [0, 1, 2].map((c) => high[c] - low[c]);
    const over = this.runs.length < 2 || $("arrange").value === "over";
    const shifts = [[0, 0, 0]];
    if (!over) shifts[0] = [size[0] * 1.05, 0, 0];
    if (!over) shifts.push([0, -size[1] * 1.12, 0]);
    const moved = (shift) => this.runs.map((_, k) => shift.map((v) => k * v));
    const points = this.near ? this.payload.near : this.payload.reach;
    const fit = (shift) => this.eye.fit(points, moved(shift), this.payload.planar);
    const best = shifts.map((shift) => [fit(shift), shift]).sort((a, b) => a[0] - b[0])[0][1];
    this.boxes = moved(best).map((shift) => [low, high].map((p) => p.map((v, c) => v + shift[c])));
    this.runs.forEach((run, k) => {
      run.root.position.set(...best.map((v) => k * v));
      run.fade(over && k > 0);
    });
    fit(best);
  }

  toggle(name, visible) {
    this.shown[name] = visible;
    for (const run of this.runs) if (run.layers[name]) run.show(name, visible);
    if (name === "magnifier") this.magnifier.show(visible);
    this.seek(this.time);
  }

  seek(time) {
    this.time = Math.min(this.duration, Math.max(0, time));
    for (const run of this.runs) {
      run.seek(this.time);
      if (!this.shown.forces) run.show("forces", false);
    }
    $("scrub").value = this.time;
    $("clock").textContent = `${this.time.toFixed(2)} / ${Number(this.duration.toPrecision(5))} s`;
    this.readout.seek(this.time);
    this.curves.seek(this.time);
    document.body.dataset.time = this.time.toFixed(3);
    this.plot.draw(this.time);
    this.magnifier.draw(this.time);
    this.viewer.set_dirty();
  }

  placeLabels() {
    if (!this.boxes) return;
    const beside = this.runs.length > 1 && $("arrange").value === "beside";
    const shown = { names: this.shown.names, beside };
    this.labels.place(this.viewer.camera, $("pane"), this.boxes, this.payload.planar, shown);
  }

  // A pane of another size is filled anew.
  resized() {
    const size = `${$("pane").clientWidth} ${$("pane").clientHeight}`;
    if (size === this.size) return;
    this.size = size;
    this.viewer.set_3d_pane_size();
  }

  refill() {
    if (!this.runs.length) return;
    this.arrange();
    this.plot.draw(this.time);
  }

  tick(now) {
    requestAnimationFrame((next) => this.tick(next));
    this.resized();
    const passed = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    if (this.playing && this.runs.length) {
      const next = this.time + passed * this.speed;
      // rest a little at the end before starting again
      if (this.time >= this.duration) this.rest = (this.rest || 0) + passed;
      if (this.time < this.duration || this.rest > 1.2) this.seek(this.time >= this.duration ? 0 : next);
      if (this.time < this.duration) this.rest = 0;
    }
    this.placeLabels();
  }

  play() {
    if ($("play").disabled) return;
    this.playing = true;
    if (this.time >= this.duration) this.seek(0);
    this.playButton();
  }

  pause() {
    this.playing = false;
    this.playButton();
  }

  playButton() {
    $("play").textContent = this.playing ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", this.playing ? "Pause" : "Play");
  }

  listen() {
    $("play").addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    $("scrub").addEventListener("input", () => { this.pause(); this.seek(Number($("scrub").value)); });
    $("speed").addEventListener("change", () => { this.speed = Number($("speed").value); });
    $("arrange").addEventListener("change", () => { this.arrange(); this.seek(this.time); });
    $("look").addEventListener("change", () => this.look($("look").value === "near"));
    $("quantity").addEventListener("change", () => { this.choose(Number($("quantity").value)); this.seek(this.time); });
    $("about").addEventListener("click", () => $("about").classList.toggle("whole"));
    $("reset").addEventListener("click", () => { this.arrange(); this.seek(this.time); });
    this.viewer.controls.addEventListener("change", () => this.magnifier.draw(this.time));
    window.addEventListener("hashchange", () => this.hash());
    window.addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    if (["SELECT", "INPUT", "BUTTON"].includes(event.target.tagName) && event.key !== "Home" && event.key !== "End") return;
    const step = this.duration / 250;
    const act = {
      " ": () => (this.playing ? this.pause() : this.play()),
      ArrowRight: () => { this.pause(); this.seek(this.time + step); },
      ArrowLeft: () => { this.pause(); this.seek(this.time - step); },
      Home: () => this.seek(0),
      End: () => { this.pause(); this.seek(this.duration); },
    }[event.key];
    if (act) { event.preventDefault(); act(); }
  }

  // #t=3 stands still at 3 s; #t=3&play=1&speed=2&arrange=over&look=near also does what it says
  hash() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    if (wanted.has("speed")) $("speed").value = this.speed = Number(wanted.get("speed")) || 1;
    if (["beside", "over"].includes(wanted.get("arrange"))) { $("arrange").value = wanted.get("arrange"); this.arrange(); }
    if (wanted.has("look")) this.look(wanted.get("look") === "near");
    if (!wanted.has("t")) return wanted.get("play") === "0" ? this.pause() : undefined;
    this.seek(Number(wanted.get("t")) || 0);
    return wanted.get("play") === "1" ? this.play() : this.pause();
  }
}
