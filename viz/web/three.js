// Three.js, as MeshCat brings it.
export const { THREE } = MeshCat;
