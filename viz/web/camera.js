const NARROW = 900; // px: from this width on, the words at the left stand beside the scene, not over it

// The view: everything that ever moves fills the pane, from above where the scene is planar.
class Eye {
  constructor(viewer, pane, onResize) {
    this.viewer = viewer;
    this.pane = pane;
    // the viewer measures the window; the pane is only a part of it
    viewer.set_3d_pane_size = () => {
      const width = Math.max(1, pane.clientWidth), height = Math.max(1, pane.clientHeight);
      viewer.camera.aspect = width / height;
      viewer.camera.updateProjectionMatrix();
      viewer.renderer.setSize(width, height);
      onResize();
      viewer.set_dirty();
    };
  }

  // Width at the left that the scene leaves to words, px.
  get margin() {
    const side = $("side");
    return this.pane.clientWidth > NARROW ? side.offsetLeft + side.offsetWidth + 4 : 0;
  }

  // MeshCat's world has z up, Three's camera y.
  static toThree(p) { return new THREE.Vector3(p[0], p[2], -p[1]); }

  axes(planar) {
    if (planar) return { back: new THREE.Vector3(0, 1, 1e-4).normalize(), up: new THREE.Vector3(0, 0, -1) };
    const back = Eye.toThree([0.55, -0.95, 0.55]).normalize();
    const across = new THREE.Vector3(0, 1, 0).cross(back).normalize();
    return { back, up: back.clone().cross(across) };
  }

  // Half the extents (tangents) of points seen from a distance, and the middles of those extents.
  spread(points, centre, distance, { back, across, up }) {
    const spans = [across, up].map((axis) => {
      const seen = points.map((p) => p.clone().sub(centre)).map((p) => p.dot(axis) / (distance - p.dot(back)));
      return [Math.min(...seen), Math.max(...seen)];
    });
    return spans.map(([least, most]) => ({ half: (most - least) / 2, middle: (most + least) / 2 }));
  }

  // Points that must be seen, in copies of the scene moved by ``shifts``; the distance of the eye that results.
  fit(points, shifts, planar) {
    const camera = this.viewer.camera, frame = this.axes(planar);
    frame.across = frame.up.clone().cross(frame.back).normalize();
    camera.fov = planar ? 14 : 26;
    const tall = Math.tan((camera.fov * Math.PI) / 360) * 0.94;
    const width = this.pane.clientWidth, height = Math.max(1, this.pane.clientHeight), margin = this.margin;
    const wide = (tall * (width - margin)) / height;
    camera.setViewOffset(width, height, -margin / 2, 0, width, height);
    const all = shifts.flatMap((shift) => points.map((p) => Eye.toThree(p.map((v, c) => v + shift[c]))));
    const box = new THREE.Box3().setFromPoints(all), centre = box.getCenter(new THREE.Vector3());
    const radius = Math.max(1e-6, box.getSize(new THREE.Vector3()).length() / 2);
    let distance = (2 * radius) / Math.min(tall, wide);
    for (let k = 0; k < 12; k++) {
      const [x, y] = this.spread(all, centre, distance, frame);
      centre.addScaledVector(frame.across, x.middle * distance).addScaledVector(frame.up, y.middle * distance);
      distance = Math.max(1.05 * radius, distance * Math.max(x.half / wide, y.half / tall));
    }
    camera.near = distance / 200;
    camera.far = distance * 20;
    camera.position.copy(centre).addScaledVector(frame.back, distance);
    this.viewer.controls.target.copy(centre);
    this.viewer.controls.update();
    this.viewer.set_dirty();
    return distance;
  }
}
