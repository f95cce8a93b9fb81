// A viewer where the browser cannot draw in three dimensions: a sentence stands for the scene, all else works.
import { element } from "./format.js";
import { isSoftware } from "./materials.js";
import { THREE } from "./three.js";

export function viewerIn(pane) {
  try {
    const renderer = new THREE.WebGLRenderer({ antialias: !isSoftware() || location.hash.includes("fine=1"), powerPreference: "high-performance" });
    Object.assign(renderer, { outputEncoding: THREE.sRGBEncoding, toneMapping: THREE.ACESFilmicToneMapping, toneMappingExposure: 0.72 });
    Object.assign(renderer.shadowMap, { enabled: true, type: THREE.PCFShadowMap });
    pane.append(renderer.domElement);
    return new MeshCat.Viewer(pane, true, renderer);
  } catch (fault) {
    const words = `This browser cannot draw in three dimensions (${fault.message.replace(/\.+$/, "")}). Time, curves and numbers work without.`;
    pane.replaceChildren(element("p", words, "fault"));
    document.body.classList.add("blind");
    return new BlindViewer();
  }
}

class BlindViewer {
  constructor() {
    this.camera = new THREE.PerspectiveCamera();
    this.gui = { domElement: { style: {} } };
    this.renderer = { setSize() {}, setPixelRatio() {} };
    const target = new THREE.Vector3(), { camera } = this;
    this.controls = {
      target,
      addEventListener() {},
      update() { camera.lookAt(target); camera.updateMatrixWorld(); },
    };
  }

  hide_background() {}

  set_property() {}

  set_object() {}

  delete_path() {}

  set_dirty() {}

  render() {}
}
