// Tip errors over time, with a cursor; a click goes there.
class Plot {
  constructor(canvas, onSeek) {
    this.canvas = canvas;
    this.runs = [];
    this.duration = 1;
    const go = (event) => {
      if (event.buttons !== 1) return;
      const box = canvas.getBoundingClientRect();
      const share = (event.clientX - box.left - this.left) / (box.width - this.left - this.right);
      onSeek(Math.min(1, Math.max(0, share)) * this.duration);
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); go(event); });
    canvas.addEventListener("pointermove", go);
  }

  get left() { return 62; }
  get right() { return 8; }

  load(runs, duration) {
    this.runs = runs;
    this.duration = duration;
    let greatest = 0;
    for (const run of runs) {
      // the last instants of a diverged run would hide all before them
      const kept = run.data.completed ? 1 : 0.8;
      for (const values of run.errors) {
        for (let i = 0; i < Math.max(2, kept * values.length); i++) greatest = Math.max(greatest, values[i] || 0);
      }
    }
    this.greatest = greatest > 1e-6 ? greatest : 1e-6;
  }

  draw(time) {
    const box = this.canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
    if (box.width < this.left + 20) return;
    this.canvas.width = Math.round(box.width * ratio);
    this.canvas.height = Math.round(box.height * ratio);
    const pen = this.canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const top = 8, bottom = box.height - 16, right = box.width - this.right;
    const x = (t) => this.left + (t / this.duration) * (right - this.left);
    const y = (e) => bottom - Math.min(1.05, e / this.greatest) * (bottom - top);
    this.frame(pen, x, y, bottom, right);
    this.runs.forEach((run, r) => run.errors.forEach((values, k) => {
      pen.strokeStyle = TIP_COLOURS[k % TIP_COLOURS.length];
      pen.lineWidth = 1.5;
      pen.setLineDash(r === 0 ? [] : [5, 3]);
      pen.beginPath();
      for (let i = 0; i < values.length; i++) pen.lineTo(x(run.errorTime[i]), y(values[i]));
      pen.stroke();
    }));
    pen.setLineDash([]);
    pen.strokeStyle = "#ffffff";
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(x(time), top - 6);
    pen.lineTo(x(time), bottom);
    pen.stroke();
  }

  frame(pen, x, y, bottom, right) {
    pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    pen.fillStyle = "#9aa8b8";
    pen.strokeStyle = "#2c3947";
    pen.lineWidth = 1;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const value of [0, this.greatest]) {
      pen.beginPath();
      pen.moveTo(this.left, y(value));
      pen.lineTo(right, y(value));
      pen.stroke();
      pen.fillText(value ? millimetres(value) : "0", this.left - 6, y(value));
    }
    pen.fillText("tip error", this.left - 6, (y(0) + y(this.greatest)) / 2);
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

function millimetres(metres) {
  const mm = metres * 1e3;
  if (mm >= 1000) return `${(mm / 1e3).toPrecision(3)} m`;
  if (mm >= 1) return `${mm.toPrecision(3)} mm`;
  return mm >= 5e-4 || mm === 0 ? `${mm.toFixed(3)} mm` : "< 0.001 mm";
}
