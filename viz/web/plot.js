// One quantity over time, with a cursor; a click goes there.
class Plot {
  constructor(canvas, onSeek) {
    this.canvas = canvas;
    this.runs = [];
    this.duration = 1;
    this.which = 0;
    const go = (event) => {
      if (event.buttons !== 1 || !this.runs.length) return;
      const box = canvas.getBoundingClientRect();
      const share = (event.clientX - box.left - this.left) / (box.width - this.left - this.right);
      onSeek(Math.min(1, Math.max(0, share)) * this.duration);
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); go(event); });
    canvas.addEventListener("pointermove", go);
  }

  get left() { return 70; }
  get right() { return 8; }

  load(runs, duration) {
    this.runs = runs;
    this.duration = duration;
    this.choose(this.which);
  }

  choose(which) {
    this.which = which;
    let least = 0, greatest = 0;
    for (const run of this.runs) {
      // the last instants of a diverged run would hide all before them
      const kept = run.data.completed ? 1 : 0.8;
      for (const values of run.plots[which]) {
        const count = Math.min(values.length, Math.max(2, kept * values.length));
        for (let i = 0; i < count; i++) {
          least = Math.min(least, values[i] || 0);
          greatest = Math.max(greatest, values[i] || 0);
        }
      }
    }
    if (greatest - least < 1e-9) greatest = least + 1e-3;
    [this.least, this.greatest] = [least, greatest];
  }

  get unit() { return this.runs[0].data.plots[this.which].unit; }

  draw(time) {
    const box = this.canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
    if (box.width < this.left + 20 || !this.runs.length) return;
    this.canvas.width = Math.round(box.width * ratio);
    this.canvas.height = Math.round(box.height * ratio);
    const pen = this.canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const top = 8, bottom = box.height - 16, right = box.width - this.right, room = 0.03 * (bottom - top);
    const x = (t) => this.left + (t / this.duration) * (right - this.left);
    const y = (value) => {
      const share = (value - this.least) / (this.greatest - this.least);
      return bottom - Math.min(1.05, Math.max(-0.05, share)) * (bottom - top - room);
    };
    this.frame(pen, x, y, bottom, right);
    this.lines(pen, x, y);
    pen.setLineDash([]);
    pen.strokeStyle = "#ffffff";
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(x(time), top - 6);
    pen.lineTo(x(time), bottom);
    pen.stroke();
  }

  lines(pen, x, y) {
    this.runs.forEach((run, r) => run.plots[this.which].forEach((values, k) => {
      pen.strokeStyle = curveColour(run.data.plots[this.which].curves[k].colour);
      pen.lineWidth = 1.5;
      pen.setLineDash(r === 0 ? [] : [5, 3]);
      pen.beginPath();
      for (let i = 0; i < values.length; i++) pen.lineTo(x(run.fineTime[i]), y(values[i]));
      pen.stroke();
    }));
  }

  frame(pen, x, y, bottom, right) {
    pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    pen.fillStyle = "#9aa8b8";
    pen.strokeStyle = "#2c3947";
    pen.lineWidth = 1;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const small = 0.25 * (this.greatest - this.least);
    const marks = [this.least, 0, this.greatest].filter((value) => value === 0 || Math.abs(value) > small);
    for (const value of new Set(marks)) {
      pen.beginPath();
      pen.moveTo(this.left, y(value));
      pen.lineTo(right, y(value));
      pen.stroke();
      pen.fillText(value ? amount(value, this.unit) : "0", this.left - 6, y(value));
    }
    pen.textBaseline = "top";
    const step = niceStep(this.duration / 8);
    for (let t = 0; t <= this.duration * 1.0001; t += step) {
      pen.textAlign = t === 0 ? "left" : t > this.duration * 0.97 ? "right" : "center";
      pen.fillText(`${Number(t.toPrecision(6))} s`, x(t), bottom + 4);
    }
  }
}

function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= least * 0.999);
}

// A value with its unit, in three digits.
function amount(value, unit) {
  if (unit === "mm") return millimetres(value / 1e3);
  const size = Math.abs(value);
  return `${size >= 1e-3 && size < 1e4 ? Number(value.toPrecision(3)) : size ? value.toExponential(1) : 0} ${unit}`;
}

function millimetres(metres) {
  const mm = metres * 1e3;
  if (mm >= 1000) return `${(mm / 1e3).toPrecision(3)} m`;
  if (mm >= 1) return `${mm.toPrecision(3)} mm`;
  return mm >= 5e-4 || mm === 0 ? `${mm.toFixed(3)} mm` : "< 0.001 mm";
}
