"""The animation played by three.js in a browser; skipped without the package ``three`` of node_modules."""

import http.server
import json
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr

pytest.importorskip("pygltflib")
THREE = Path(__file__).parents[2] / "node_modules" / "three"
Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # glTF's y axis to our z axis
PAGE = """<!doctype html>
<script type="importmap">
{"imports": {"three": "./three/build/three.module.js", "three/addons/": "./three/examples/jsm/"}}
</script>
<script type="module">
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
const file = await new GLTFLoader().loadAsync('scene.glb');
const mixer = new THREE.AnimationMixer(file.scene);
mixer.clipAction(file.animations[0]).setLoop(THREE.LoopOnce).play();
// world matrices, by columns, of all nodes at some times
window.play = times => times.map(time => {
  mixer.setTime(time);
  file.scene.updateMatrixWorld(true);
  const poses = {};
  file.scene.traverse(node => { poses[node.userData.name ?? node.name] = [...node.matrixWorld.elements]; });
  return poses;
});
</script>
"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.mark.browser
@pytest.mark.skipif(not THREE.is_dir(), reason="npm install was not run")
def test_three_js_plays_the_motion(tmp_path):
    """Poses of all links at the samples are those of Pinocchio."""
    from viz.recording.browser import chromium

    changes = {"simulation.duration": 1.0, "simulation.output_step": 0.25}
    result = sr.simulate(sr.load_scene("servicer", changes), backend="interpreted")
    sr.export(result, tmp_path / "scene.glb")
    (tmp_path / "three").symlink_to(THREE)
    (tmp_path / "index.html").write_text(PAGE, encoding="utf-8")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    times = result.array("time")
    # LoopOnce ends at the last sample: a little earlier, by less than single precision shows
    asked = [*np.minimum(times, times[-1] - 1e-7), times[1:3].mean()]
    try:
        with chromium() as browser:
            if browser is None:
                pytest.skip("no Chromium on this computer")
            browser.call("Page.navigate", url=f"http://127.0.0.1:{server.server_address[1]}/index.html")
            browser.wait_for("typeof window.play === 'function'")
            *samples, between = json.loads(
                browser.evaluate(f"JSON.stringify(window.play({json.dumps(asked)}))")
            )
    finally:
        server.shutdown()
        server.server_close()
    scene = result.scene()
    model = scene.model
    data = model.createData()
    links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    for q, poses in zip(result.array("q"), samples, strict=True):
        pin.framesForwardKinematics(model, data, q)
        for name in links:
            expected = data.oMf[model.getFrameId(name, pin.FrameType.BODY)]
            matrix = np.array(poses[name]).reshape(4, 4).T
            np.testing.assert_allclose(Z_UP @ matrix[:3, 3], expected.translation, atol=1e-5)
            np.testing.assert_allclose(Z_UP @ matrix[:3, :3], expected.rotation, atol=1e-5)
    for body in scene.bodies:  # between two samples positions are interpolated
        middle, *ends = (
            np.array(poses[model.frames[body.root_frame].name])[12:15]
            for poses in (between, samples[1], samples[2])
        )
        np.testing.assert_allclose(middle, np.mean(ends, axis=0), atol=1e-6)
