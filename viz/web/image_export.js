// The view as files: one picture (PNG), or the motion (GIF). Encoded here; nothing is asked of any network.
import { element } from "./format.js";
import { GIFEncoder, nearestColorIndex, quantize } from "./vendor/gifenc.esm.js";

export const VIDEO = { width: 1280, kinds: ["video/mp4;codecs=avc1", "video/mp4", "video/webm;codecs=vp9", "video/webm"], bitsPerSecond: 6e6 };
// px, 1/s, s, pictures that the colours are chosen by; where pictures come slowly there are fewer, at least so many, so that all is done in so long [ms]
export const FILM = { width: 640, perSecond: 12.5, longest: 10, samples: 6, least: 24, within: 12000 };
const AS_BEFORE = 255; // the last of a GIF's 256 colours: a pixel that has not changed

// Parts of a text, divided by ``; ``, in as many lines as they need; ``fits``: whether a text fits into a line.
export function inLines(words, fits) {
  return words.split("; ").reduce((lines, part) => {
    const joined = lines.length ? `${lines.at(-1)}; ${part}` : part;
    return lines.length && fits(joined) ? [...lines.slice(0, -1), joined] : [...lines, part];
  }, []);
}

export class Camera {
  // ``write``: says what is seen, in words, onto a picture; ``seek``: goes to a time.
  constructor(scene, labels, { seek, words }) {
    this.scene = scene;
    this.labels = labels;
    this.seek = seek;
    this.words = words;
    this.canvas = element("canvas");
  }

  // What the pane shows now, as a canvas ``width`` wide; the next picture is drawn on the same one.
  take(width) {
    const drawn = this.scene.render(), { clientWidth, clientHeight } = this.scene.pane, { canvas } = this;
    const ratio = width / clientWidth, size = [Math.round(width), Math.round(clientHeight * ratio)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const pen = canvas.getContext("2d", { willReadFrequently: true });
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.drawImage(drawn, 0, 0, clientWidth, clientHeight);
    const letters = Math.max(12, clientWidth / 95) / Math.min(1, ratio); // px of the pane: never smaller in the picture than on the page
    this.labels.draw(pen, letters);
    pen.font = `${letters}px system-ui, 'DejaVu Sans', sans-serif`;
    pen.textBaseline = "bottom";
    // from the bottom up, on a shade: the Earth may be behind it
    const lines = inLines(this.words(), (text) => pen.measureText(text).width <= clientWidth - 24).reverse();
    lines.forEach((text, k) => {
      const bottom = clientHeight - 8 - 1.5 * letters * k;
      pen.fillStyle = "#0009";
      pen.fillRect(12 - letters / 2, bottom - 1.3 * letters, pen.measureText(text).width + letters, 1.5 * letters);
      pen.fillStyle = "#e8edf3";
      pen.fillText(text, 12, bottom);
    });
    return canvas;
  }

  savePicture(name) {
    const canvas = this.take(this.scene.pane.clientWidth * (window.devicePixelRatio || 1));
    save(canvas.toDataURL("image/png"), `${name}.png`);
  }

  // The whole motion at a speed, at most ten seconds; ``tell`` hears how far it is, ``going`` says whether to go on.
  async saveFilm(name, { duration, speed, tell, going }) {
    const lasts = Math.min(FILM.longest, duration / speed), wanted = Math.max(2, Math.round(lasts * FILM.perSecond) + 1);
    const width = Math.min(FILM.width, this.scene.pane.clientWidth);
    const frame = (share) => {
      this.seek(share * duration);
      const canvas = this.take(width);
      return canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    };
    // one palette for all: what has not changed is not written again, and does not flicker
    frame(0); // shaders are compiled
    const begin = performance.now(), shown = Array.from({ length: FILM.samples }, (_, k) => frame(k / (FILM.samples - 1))), [{ data: { length } }] = shown;
    const each = (1.6 * (performance.now() - begin)) / FILM.samples; // ms, its encoding included
    const count = Math.min(wanted, Math.max(Math.min(wanted, FILM.least), Math.round(FILM.within / each)));
    const pixels = new Uint8ClampedArray(length * shown.length);
    shown.forEach(({ data }, k) => pixels.set(data, k * length));
    const palette = quantize(pixels, AS_BEFORE), table = Array.from({ length: 256 }, (_, k) => palette[k] || [0, 0, 0]), gif = GIFEncoder();
    const known = new Int16Array(1 << 21).fill(-1);
    let before = new Uint8Array();
    for (let k = 0; k < count; k++) {
      const { data, width: wide, height } = frame(k / (count - 1)), now = indexed(data, palette, known);
      const changed = now.map((colour, i) => (colour === before[i] ? AS_BEFORE : colour));
      gif.writeFrame(changed, wide, height, {
        palette: k ? undefined : table, delay: (1000 * lasts) / (count - 1), transparent: true, transparentIndex: AS_BEFORE, dispose: 1,
      });
      before = now;
      tell(`writing the GIF: ${Math.round((100 * (k + 1)) / count)} %`);
      await new Promise((resume) => setTimeout(resume, 0));
      if (!going()) return;
    }
    gif.finish();
    saveBlob(new Blob([gif.bytes()], { type: "image/gif" }), `${name}.gif`);
  }

  // The same as a video, as this browser writes it, recorded while it plays: a slow computer leaves out pictures.
  async saveVideo(name, { duration, speed, tell, going }) {
    const kind = VIDEO.kinds.find((one) => MediaRecorder.isTypeSupported(one)), lasts = Math.min(FILM.longest, duration / speed);
    const width = 2 * Math.floor(Math.min(VIDEO.width, this.scene.pane.clientWidth) / 2), canvas = element("canvas");
    const show = (share) => {
      this.seek(share * duration);
      const picture = this.take(width);
      canvas.getContext("2d").drawImage(picture, 0, 0);
      return picture;
    };
    [canvas.width, canvas.height] = [width, 2 * (show(0).height >> 1)]; // encoders want even numbers
    show(0);
    const recorder = new MediaRecorder(canvas.captureStream(), { mimeType: kind, videoBitsPerSecond: VIDEO.bitsPerSecond }), parts = [];
    const ended = new Promise((resume) => { recorder.onstop = resume; });
    recorder.ondataavailable = ({ data }) => parts.push(data);
    recorder.start();
    const begin = performance.now();
    for (let share = 0; share < 1 && going();) {
      await new Promise((resume) => requestAnimationFrame(resume));
      share = Math.min(1, (performance.now() - begin) / 1000 / lasts);
      show(share);
      tell(`recording: ${Math.round(100 * share)} %`);
    }
    await new Promise((resume) => setTimeout(resume, 500)); // the last picture stays a moment
    recorder.stop();
    await ended;
    if (going()) saveBlob(new Blob(parts, { type: kind }), `${name}.${kind.includes("mp4") ? "mp4" : "webm"}`);
  }
}

// Number of the nearest colour of a palette for each pixel. Colours that agree in seven bits a channel share it, through all
// pictures: gifenc's own five or six bits draw rings into the sky.
function indexed(pixels, palette, known) {
  const found = new Uint8Array(pixels.length / 4);
  for (let i = 0; i < found.length; i++) {
    const colour = [pixels[4 * i], pixels[4 * i + 1], pixels[4 * i + 2]], key = (colour[0] >> 1 << 14) | (colour[1] >> 1 << 7) | (colour[2] >> 1);
    if (known[key] < 0) known[key] = nearestColorIndex(palette, colour);
    found[i] = known[key];
  }
  return found;
}

export function saveBlob(blob, name) {
  const address = URL.createObjectURL(blob);
  save(address, name);
  setTimeout(() => URL.revokeObjectURL(address), 60000);
}

export function save(address, name) {
  const link = element("a");
  [link.href, link.download] = [address, name];
  link.click();
}
