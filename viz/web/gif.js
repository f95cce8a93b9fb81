// Writes a GIF: colours chosen by median cut, only what has changed in each picture, LZW.
const GIF_COLOURS = 255; // the one left over stands for "as before"

// Six bits a channel: what a colour is called in the tables below.
function colourKey(pixels, at) {
  return ((pixels[at] >> 2) << 12) | ((pixels[at + 1] >> 2) << 6) | (pixels[at + 2] >> 2);
}

class Palette {
  // ``samples``: pixels (RGBA) of some of the pictures.
  constructor(samples) {
    const counts = new Uint32Array(1 << 18);
    for (const pixels of samples) for (let i = 0; i < pixels.length; i += 4) counts[colourKey(pixels, i)]++;
    const keys = [];
    counts.forEach((count, key) => { if (count) keys.push(key); });
    this.colours = this.cut(keys, counts).map((box) => this.mean(box, counts));
    this.nearest = new Int16Array(1 << 18).fill(-1);
  }

  static channel(key, c) { return (key >> (12 - 6 * c)) & 63; }

  // Boxes of colours: the one that spreads most, weighted by what it holds, is cut at its median.
  cut(keys, counts) {
    const boxes = [this.box(keys, counts)];
    while (boxes.length < GIF_COLOURS) {
      const at = boxes.reduce((best, box, k) => (box.weight > boxes[best].weight ? k : best), 0);
      const { keys: held, channel, weight } = boxes[at];
      if (!weight) break;
      held.sort((a, b) => Palette.channel(a, channel) - Palette.channel(b, channel));
      const half = held.reduce((sum, key) => sum + counts[key], 0) / 2;
      let k = 0;
      for (let sum = 0; k < held.length - 1 && sum < half; k++) sum += counts[held[k]];
      k = Math.max(1, k);
      boxes.splice(at, 1, this.box(held.slice(0, k), counts), this.box(held.slice(k), counts));
    }
    return boxes.map((box) => box.keys);
  }

  box(keys, counts) {
    const spans = [0, 1, 2].map((c) => {
      let least = 63, most = 0;
      for (const key of keys) {
        least = Math.min(least, Palette.channel(key, c));
        most = Math.max(most, Palette.channel(key, c));
      }
      return most - least;
    });
    const span = Math.max(...spans), total = keys.reduce((sum, key) => sum + counts[key], 0);
    // small things in strong colours, such as arrows, count for more than their pixels
    return { keys, channel: spans.indexOf(span), weight: span * span * Math.cbrt(total) };
  }

  mean(keys, counts) {
    const total = keys.reduce((sum, key) => sum + counts[key], 0) || 1;
    return [0, 1, 2].map((c) => {
      const level = keys.reduce((sum, key) => sum + counts[key] * Palette.channel(key, c), 0) / total;
      return Math.round((level * 255) / 63);
    });
  }

  index(pixels, at) {
    const key = colourKey(pixels, at);
    if (this.nearest[key] < 0) {
      let best = Infinity;
      this.colours.forEach((colour, k) => {
        const far = colour.reduce((sum, level, c) => sum + (level - pixels[at + c]) ** 2, 0);
        if (far < best) [best, this.nearest[key]] = [far, k];
      });
    }
    return this.nearest[key];
  }
}

class Gif {
  // Delay between pictures in hundredths of a second.
  constructor(width, height, palette, delay) {
    Object.assign(this, { width, height, palette, delay });
    this.parts = [];
    this.before = null;
    const table = new Uint8Array(3 * 256);
    palette.colours.forEach((colour, k) => table.set(colour, 3 * k));
    this.put([..."GIF89a"].map((c) => c.charCodeAt(0)));
    this.put([...this.word(width), ...this.word(height), 0xf7, 0, 0]);
    this.put(table);
    this.put([0x21, 0xff, 11, ...[..."NETSCAPE2.0"].map((c) => c.charCodeAt(0)), 3, 1, 0, 0, 0]); // for ever
  }

  put(values) { this.parts.push(Uint8Array.from(values)); }

  word(value) { return [value & 255, value >> 8]; }

  // One picture: pixels (RGBA) of the whole.
  add(pixels) {
    const indices = new Uint8Array(this.width * this.height), sent = new Uint8Array(indices.length);
    for (let i = 0; i < indices.length; i++) {
      indices[i] = this.palette.index(pixels, 4 * i);
      sent[i] = this.before && this.before[i] === indices[i] ? GIF_COLOURS : indices[i];
    }
    this.before = indices;
    this.put([0x21, 0xf9, 4, 0x05, ...this.word(this.delay), GIF_COLOURS, 0]);
    this.put([0x2c, 0, 0, 0, 0, ...this.word(this.width), ...this.word(this.height), 0, 8]);
    const packed = lzw(sent);
    for (let i = 0; i < packed.length; i += 255) {
      const block = packed.subarray(i, i + 255);
      this.put([block.length]);
      this.parts.push(block);
    }
    this.put([0]);
  }

  finish() {
    this.put([0x3b]);
    return new Blob(this.parts, { type: "image/gif" });
  }
}

// LZW with codes of 9 to 12 bits, as GIF has it for 256 colours.
function lzw(indices) {
  const CLEAR = 256, END = 257, MOST = 4096;
  const out = new Uint8Array(indices.length * 2 + 16), next = new Uint16Array(MOST * 256);
  let size = 9, free = 258, bits = 0, held = 0, length = 0;
  const emit = (code) => {
    held |= code << bits;
    for (bits += size; bits >= 8; bits -= 8) {
      out[length++] = held & 255;
      held >>>= 8;
    }
  };
  emit(CLEAR);
  let code = indices[0];
  for (let i = 1; i < indices.length; i++) {
    const at = code * 256 + indices[i];
    if (next[at]) {
      code = next[at];
      continue;
    }
    emit(code);
    if (free < MOST) {
      next[at] = free;
      // the reader is one entry behind: its codes grow one later
      if (free === 1 << size && size < 12) size++;
      free++;
    } else {
      emit(CLEAR);
      next.fill(0);
      [size, free] = [9, 258];
    }
    code = indices[i];
  }
  emit(code);
  // the end stands where the reader's codes may have grown once more
  if (free === 1 << size && size < 12) size++;
  emit(END);
  if (bits > 0) out[length++] = held & 255;
  return out.subarray(0, length);
}
