// One run in the scene: bodies, ghosts, paths, forces, at any time.
class Run {
  constructor(data, scale, closeness) {
    this.data = data;
    this.time = floats(data.time);
    this.poses = floats(data.poses);
    this.tips = floats(data.tips);
    this.forces = floats(data.forces);
    this.mates = floats(data.mates);
    this.fineTime = floats(data.fine_time);
    this.plots = data.plots.map((plot) => plot.curves.map((curve) => floats(curve.values)));
    this.errors = data.errors.map(floats);
    this.scale = scale * closeness;
    this.metresPerNewton = data.metres_per_newton * closeness;
    this.root = new THREE.Group();
    this.layers = { ghosts: [], reference: [], traces: [], forces: [], mates: [], frames: [] };
    this.vector = new THREE.Vector3();
    this.from = new THREE.Vector3();
    this.turn = new THREE.Quaternion();
    this.addBodies();
    this.addPaths();
    this.addGrips();
  }

  put(layer, object, order) {
    if (order !== undefined) object.renderOrder = order;
    this.layers[layer].push(object);
    this.root.add(object);
    return object;
  }

  addBodies() {
    this.nodes = this.data.nodes.map((node, k) => {
      const group = new THREE.Group();
      for (const solid of node.solids) group.add(solidMesh(solid));
      this.root.add(group);
      if (node.base) {
        this.put("ghosts", ghostOf(node, this.poses.slice(7 * k, 7 * k + 7)));
        const axes = triad(0.06 * this.scale);
        this.layers.frames.push(axes);
        group.add(axes);
      }
      return group;
    });
  }

  addPaths() {
    const thin = 0.0011 * this.scale, thick = 0.0021 * this.scale;
    this.growing = [];
    this.data.references.forEach((path) => {
      this.put("reference", tube(floats(path), thin, overlay(COLOURS.reference, 0.75)), 10);
    });
    const count = this.data.tip_names.length;
    this.tipBalls = this.data.tip_names.map((_, k) => {
      const points = this.column(this.tips, count, k), colour = TIP_COLOURS[k % TIP_COLOURS.length];
      this.growing.push(this.put("traces", tube(points, thick, overlay(colour, 1)), 12));
      return this.put("mates", ball(0.0052 * this.scale, colour, 21));
    });
    if (this.data.target) {
      this.growing.push(this.put("traces", tube(floats(this.data.target), thick, overlay(COLOURS.target, 1)), 11));
    }
  }

  addGrips() {
    const grips = this.data.grasp_tips;
    this.arrows = grips.map(() => this.put("forces", arrow(0.0028 * this.scale)));
    this.mateBalls = grips.map(() => this.put("mates", ball(0.0072 * this.scale, COLOURS.mate, 20)));
  }

  column(values, count, k) {
    const n = values.length / (3 * count), found = new Float32Array(3 * n);
    for (let i = 0; i < n; i++) for (let c = 0; c < 3; c++) found[3 * i + c] = values[3 * (i * count + k) + c];
    return found;
  }

  get end() {
    return this.time[this.time.length - 1];
  }

  // Sample before a time and the share of the way to the next one.
  locate(times, time) {
    let low = 0, high = times.length - 1;
    if (time >= times[high]) return [high, 0];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle; else high = middle;
    }
    return [low, Math.max(0, (time - times[low]) / (times[high] - times[low]))];
  }

  between(values, count, k, i, share, into) {
    const a = 3 * (i * count + k), b = share > 0 ? a + 3 * count : a;
    return into.set(...[0, 1, 2].map((c) => values[a + c] + share * (values[b + c] - values[a + c])));
  }

  seek(time) {
    const [i, share] = this.locate(this.time, time), count = this.nodes.length;
    this.nodes.forEach((node, k) => {
      const a = 7 * (i * count + k), b = share > 0 ? a + 7 * count : a;
      this.place(node, a, b, share);
    });
    for (const trace of this.growing) trace.geometry.setDrawRange(0, i * trace.perSegment);
    const tips = this.tipBalls.length, grips = this.arrows.length;
    this.tipBalls.forEach((dot, k) => this.between(this.tips, tips, k, i, share, dot.position));
    this.mateBalls.forEach((dot, k) => this.between(this.mates, grips, k, i, share, dot.position));
    this.arrows.forEach((shown, k) => {
      this.between(this.tips, tips, this.data.grasp_tips[k], i, share, this.from);
      this.between(this.forces, grips, k, i, share, this.vector).multiplyScalar(this.metresPerNewton);
      // what a diverged run does in its last instants would leave the picture
      shown.point(this.from, this.vector.clampLength(0, 0.4 * this.scale));
    });
  }

  place(node, a, b, share) {
    const p = this.poses;
    node.position.set(...[0, 1, 2].map((c) => p[a + c] + share * (p[b + c] - p[a + c])));
    node.quaternion.fromArray(p, a + 3);
    if (share > 0) node.quaternion.slerp(this.turn.fromArray(p, b + 3), share);
  }

  // Value of a curve at a time.
  value(plot, k, time) {
    const [i, share] = this.locate(this.fineTime, time), values = this.plots[plot][k];
    return share > 0 ? values[i] + share * (values[i + 1] - values[i]) : values[i];
  }

  show(layer, visible) {
    // a force too small to draw hides itself at the next seek
    for (const object of this.layers[layer]) object.visible = visible;
  }

  fade(faint) {
    for (const node of this.nodes) {
      for (const mesh of node.children.filter((child) => child.userData.opacity !== undefined)) {
        const own = mesh.userData.opacity;
        mesh.material.opacity = faint ? 0.4 * own : own;
        mesh.material.transparent = faint || own < 1;
      }
    }
  }
}
