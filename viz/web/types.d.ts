// What other scripts of the page bring.
declare const MeshCat: { Viewer: new (pane: HTMLElement, animate?: boolean, renderer?: any) => any; THREE: typeof import("three") };
declare const uPlot: typeof import("uplot");
