// The structure as it moves: wires in the colour of their mode, all else in the colour of the text.

export class Drawing {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.shown = [];
  }

  /** Frames of one or two versions, as unpacked; `colours` by mode. */
  set({ content, numbers }, colours) {
    this.shown = [content.shown, content.beside].filter(Boolean).map((one) => ({
      ...one, time: numbers(one.time), points: numbers(one.points), modes: one.modes.map(numbers),
    }));
    this.colours = colours;
    let box = [Infinity, -Infinity, Infinity, -Infinity];
    for (const one of this.shown) {
      for (const [x, y] of allPoints(one)) box = [Math.min(box[0], x), Math.max(box[1], x), Math.min(box[2], y), Math.max(box[3], y)];
    }
    this.bounds = box;
    this.canvas.setAttribute('aria-label', 'The structure at the chosen time, wires coloured by their mode');
  }

  /** Draw at a time [s]. */
  draw(time) {
    const { canvas, context } = this, ratio = devicePixelRatio;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const part = width / Math.max(this.shown.length, 1);
    this.shown.forEach((one, k) => { if (one.count) this.pose(one, time, k * part, part, height); });
  }

  pose(one, time, left, width, height) {
    const [x0, x1, y0, y1] = this.bounds, { context } = this;
    const upright = x1 - x0 > y1 - y0 && height > 0.7 * width; // a long structure stands where there is room
    const across = upright ? y1 - y0 : x1 - x0, along = upright ? x1 - x0 : y1 - y0;
    const scale = 0.82 * Math.min(width / (across || 1), height / (along || 1));
    const place = (x, y) => {
      const [u, v] = upright ? [y - (y0 + y1) / 2, x - (x0 + x1) / 2] : [x - (x0 + x1) / 2, y - (y0 + y1) / 2];
      return [left + width / 2 + scale * (upright ? -u : u), height / 2 - scale * v];
    };
    let k = one.time.findIndex((t) => t >= time);
    if (k < 0) k = one.count - 1;
    const stride = one.points.length / one.count;
    let at = k * stride;
    const sizes = [...one.wires, ...one.bodies], ink = getComputedStyle(document.documentElement).getPropertyValue('--body');
    const lines = sizes.map((count, n) => {
      const line = { x: one.points.subarray(at, at + count), y: one.points.subarray(at + count, at + 2 * count), wire: n < one.wires.length ? n : -1 };
      at += 2 * count;
      return line;
    });
    for (const line of lines.sort((a, b) => b.wire < 0 ? 1 : -1)) {
      context.strokeStyle = line.wire < 0 ? ink : this.colours[one.modes[line.wire]?.[k]] ?? ink;
      context.lineWidth = line.wire < 0 ? 5 : 3;
      context.lineCap = 'round';
      context.beginPath();
      line.x.forEach((x, n) => context.lineTo(...place(x, line.y[n])));
      context.stroke();
    }
  }
}

function* allPoints(one) {
  const stride = one.count ? one.points.length / one.count : 0;
  for (let k = 0; k < one.count; k += 1) {
    let at = k * stride;
    for (const count of [...one.wires, ...one.bodies]) {
      for (let n = 0; n < count; n += 1) yield [one.points[at + n], one.points[at + count + n]];
      at += 2 * count;
    }
  }
}
