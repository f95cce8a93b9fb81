// A viewer where the browser cannot draw in three dimensions: a sentence stands for the scene, all else works.
import { element } from "./format.js";
import { isSoftware } from "./materials.js";
import { fixedLevel } from "./quality.js";
import { THREE } from "./three.js";

export function viewerIn(pane) {
  try {
    const renderer = new THREE.WebGLRenderer({ antialias: !isSoftware() || fixedLevel(location.hash) === 0, powerPreference: "high-performance" });
    Object.assign(renderer, { outputEncoding: THREE.sRGBEncoding, toneMapping: THREE.ACESFilmicToneMapping, toneMappingExposure: 0.72 });
    Object.assign(renderer.shadowMap, { enabled: true, type: THREE.PCFShadowMap });
    renderer.debug.checkShaderErrors = false; // to ask for them waits until each program is compiled
    // the nearest first, whatever its program is: pixels behind it are then not lit in vain
    renderer.setOpaqueSort((a, b) => a.groupOrder - b.groupOrder || a.renderOrder - b.renderOrder || a.z - b.z);
    pane.append(renderer.domElement);
    return new MeshCat.Viewer(pane, true, renderer);
  } catch (fault) {
    const words = `This browser cannot draw in three dimensions (${fault.message.replace(/\.+$/, "")}). Time, curves and numbers work without.`;
    pane.replaceChildren(element("p", words, "fault"));
    document.body.classList.add("blind");
    return /** @type {any} */ (blindViewer());
  }
}

function blindViewer() {
  const camera = new THREE.PerspectiveCamera(), target = new THREE.Vector3(), nothing = () => {};
  return {
    camera, gui: { domElement: { style: {} } }, renderer: { setSize: nothing, setPixelRatio: nothing },
    controls: { target, addEventListener: nothing, update: () => { camera.lookAt(target); camera.updateMatrixWorld(); } },
    ...Object.fromEntries(["hide_background", "set_property", "set_object", "delete_path", "set_dirty", "render"].map((name) => [name, nothing])),
  };
}
