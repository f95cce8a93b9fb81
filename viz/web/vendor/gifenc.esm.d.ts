// gifenc brings no types: what picture.js uses of it.
type Palette = number[][];
export function quantize(rgba: Uint8ClampedArray, colours: number, how?: { format?: "rgb565" | "rgb444" }): Palette;
export function nearestColorIndex(palette: Palette, pixel: number[]): number;
export function GIFEncoder(): {
  writeFrame(index: Uint8Array, width: number, height: number, how: {
    palette?: Palette, delay?: number, transparent?: boolean, transparentIndex?: number, dispose?: number,
  }): void;
  finish(): void;
  bytes(): Uint8Array<ArrayBuffer>;
};
