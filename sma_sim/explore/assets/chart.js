// Curves on a canvas: axes with labels and units, legends, a cursor, bands of colours.

const LEFT = 3.9, RIGHT = 1.3, TOP = 1.5, BOTTOM = 1.5; // margins in em

const STEPS = { ArrowRight: 0.01, ArrowLeft: -0.01, PageUp: 0.1, PageDown: -0.1, Home: -1, End: 1 }; // of what is shown, by key

/** Ticks at 1, 2 or 5 times a power of ten, about `wanted` of them. */
export function ticks(low, high, wanted) {
  const rough = (high - low) / Math.max(wanted, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough * 0.75) ?? 10 * power;
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
  return { values: found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

/** A number on an axis whose marks have so many digits behind the point. */
function tickText(value, digits) {
  const text = digits > 5 && Math.abs(value) < 1e-3 || Math.abs(value) >= 1e6 ? String(Number(value.toPrecision(3))) : value.toFixed(digits);
  return text.replace(/^-(0(\.0*)?)$/, '$1').replaceAll('-', '\u2212');
}

/** The least and the greatest of what curves show, a little wider. */
function extent(curves, axis, shown) {
  let low = Infinity, high = -Infinity;
  for (const curve of curves) {
    const values = curve[axis];
    for (let k = 0; k < values.length; k += 1) {
      const value = shown(curve, values[k]);
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) return [0, 1];
  const least = 1e-9 * Math.max(Math.abs(low), Math.abs(high), 1); // less is rounding, which has no shape to look at
  const room = high - low > least ? 0.06 * (high - low) : Math.max(0.05 * Math.abs(high), 1e-2);
  return [low - room, high + room];
}

const styleOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** One panel. `kind`: 'time', 'loop' or 'bands'. */
export class Chart {
  constructor(parent, kind, handlers = {}) {
    this.kind = kind;
    this.curves = [];
    this.bands = [];
    this.box = document.createElement('div');
    this.box.className = `chart ${kind}`;
    this.canvas = document.createElement('canvas');
    this.canvas.setAttribute('role', 'img');
    this.box.append(this.canvas);
    parent.append(this.box);
    this.context = this.canvas.getContext('2d');
    if (handlers.point) { this.listen(handlers); this.listenToKeys(handlers); }
  }

  /** Widths of the plot in pixels of the screen: what the server decimates to. */
  get pixels() {
    return Math.max(50, Math.round((this.canvas.clientWidth - (LEFT + RIGHT) * this.em) * devicePixelRatio));
  }

  get em() { return 0.8 * parseFloat(getComputedStyle(document.documentElement).fontSize); }

  listen({ point, zoom, whole, pick = null }) {
    const at = (event) => {
      const [left, width] = [LEFT * this.em, this.canvas.clientWidth - (LEFT + RIGHT) * this.em];
      const part = (event.offsetX - left) / width;
      return this.x[0] + Math.min(Math.max(part, 0), 1) * (this.x[1] - this.x[0]);
    };
    let start = null;
    this.canvas.addEventListener('pointerdown', (event) => { start = [at(event), event.offsetX]; });
    this.canvas.addEventListener('pointermove', (event) => {
      if (start && event.buttons) this.draw([start[0], at(event)]);
      else point(at(event));
    });
    this.canvas.addEventListener('pointerup', (event) => {
      if (start && Math.abs(event.offsetX - start[1]) > 8) zoom([start[0], at(event)].sort((a, b) => a - b));
      else (pick ?? point)(at(event));
      start = null;
    });
    this.canvas.addEventListener('dblclick', whole);
  }

  /** Keys do what the pointer does: arrows move along the curve, with Shift they mark a part, Enter takes it, Escape shows the whole. */
  listenToKeys({ point, zoom, whole, pick = null }) {
    const { canvas } = this;
    canvas.tabIndex = 0;
    canvas.setAttribute('role', 'slider');
    let begin = null;
    canvas.addEventListener('focus', () => this.say());
    canvas.addEventListener('blur', () => { if (begin !== null) { begin = null; this.draw(); } });
    canvas.addEventListener('keydown', (event) => {
      const step = STEPS[event.key], now = this.within(this.cursor ?? (this.x[0] + this.x[1]) / 2);
      if (event.ctrlKey || event.metaKey || event.altKey || (step === undefined && !['Enter', 'Escape'].includes(event.key))) return;
      event.preventDefault();
      if (step !== undefined) {
        const next = this.within(now + step * (this.x[1] - this.x[0]));
        begin = event.shiftKey ? begin ?? now : null;
        point(next);
        this.draw(begin === null ? null : [begin, next]);
        this.say();
        return;
      }
      const marked = begin === null ? null : [begin, now].sort((a, b) => a - b);
      begin = null;
      if (event.key === 'Escape') whole();
      else if (marked && marked[1] > marked[0]) zoom(marked, true);
      else pick?.(now, true);
    });
  }

  within(time) { return Math.min(Math.max(time, this.x[0]), this.x[1]); }

  /** What the curves are at the cursor, for those who do not see it. */
  say() {
    const now = this.within(this.cursor ?? this.x[0]), { canvas } = this;
    const words = this.curves.map((curve) => `${curve.label || curve.name || ''}${valueAt(curve, now)}`.trim()).filter(Boolean);
    canvas.setAttribute('aria-valuemin', String(this.x[0]));
    canvas.setAttribute('aria-valuemax', String(this.x[1]));
    canvas.setAttribute('aria-valuenow', String(now));
    canvas.setAttribute('aria-valuetext', [`${now.toPrecision(4)} s`, ...words].join(', '));
  }

  /** Show curves `{x, y, colour, label, factor, offset, held, beside}`; `range` of x and `height` of y, or null for all; `shade`: a band of y; `mark`: a part of x. */
  set({ curves = [], bands = [], label = '', xLabel = '', range = null, height = null, shade = null, mark = null }) {
    Object.assign(this, { curves, bands, label, xLabel, range, shade, mark });
    this.box.style.setProperty('--rows', String(bands.length));
    this.x = range ?? (curves.length ? extent(curves, 'x', (_, x) => x) : [0, 1]);
    this.y = height ?? extent(curves, 'y', (curve, y) => curve.factor * y + curve.offset);
    this.canvas.setAttribute('aria-label', `${label} over ${xLabel || 'time [s]'}`);
  }

  draw(marked = null) {
    const { canvas, context, em } = this;
    const ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height || !this.x) return;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = `${em}px system-ui, sans-serif`;
    const area = { left: LEFT * em, top: TOP * em, width: width - (LEFT + RIGHT) * em, height: height - (TOP + BOTTOM) * em };
    if (this.kind === 'loop') area.height -= 1.2 * em;
    const px = (x) => area.left + (x - this.x[0]) / (this.x[1] - this.x[0]) * area.width;
    const py = (y) => area.top + area.height - (y - this.y[0]) / (this.y[1] - this.y[0]) * area.height;
    this.axes(area, px, py);
    context.save();
    context.beginPath();
    context.rect(area.left, area.top, area.width, area.height);
    context.clip();
    if (this.shade) this.fill(area.left, py(this.shade[1]), area.width, py(this.shade[0]) - py(this.shade[1]), '--soft');
    if (this.bands.length) this.drawBands(area, px);
    for (const curve of this.curves) this.line(curve, px, py);
    const part = marked ?? this.mark;
    if (part) this.fill(px(part[0]), area.top, px(part[1]) - px(part[0]), area.height, '--blue');
    if (this.cursor !== undefined && this.kind !== 'loop') {
      context.strokeStyle = styleOf('--soft');
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(px(this.cursor), area.top);
      context.lineTo(px(this.cursor), area.top + area.height);
      context.stroke();
    }
    context.restore();
    this.legend(area);
  }

  fill(x, y, width, height, colour) {
    const { context } = this;
    context.fillStyle = styleOf(colour);
    context.globalAlpha = 0.2;
    context.fillRect(x, y, width, height);
    context.globalAlpha = 1;
  }

  axes(area, px, py) {
    const { context, em } = this, [ink, soft, line] = ['--ink', '--soft', '--line'].map(styleOf);
    context.lineWidth = 1;
    context.textBaseline = 'middle';
    if (!this.bands.length) {
      const wanted = area.height / (1.9 * em), few = ticks(...this.y, wanted), marks = few.values.length > 1 ? few : ticks(...this.y, 2 * wanted);
      context.textAlign = 'right';
      for (const value of marks.values) {
        context.strokeStyle = line;
        context.globalAlpha = 0.7;
        context.beginPath();
        context.moveTo(area.left, py(value));
        context.lineTo(area.left + area.width, py(value));
        context.stroke();
        context.globalAlpha = 1;
        context.fillStyle = soft;
        if (py(value) < area.top + 0.45 * em) continue; // the label of the axis stands there
        context.fillText(tickText(value, marks.digits), area.left - 0.4 * em, py(value), area.left - 0.6 * em);
      }
    }
    const marks = ticks(...this.x, area.width / (5 * em));
    context.textAlign = 'center';
    context.textBaseline = 'top';
    context.fillStyle = soft;
    marks.values.forEach((value, k) => {
      const unit = this.kind !== 'loop' && k === marks.values.length - 1 ? ' s' : '';
      const text = tickText(value, marks.digits) + unit, half = context.measureText(text).width / 2;
      context.fillText(text, Math.min(px(value), this.canvas.clientWidth - half), area.top + area.height + 0.3 * em);
    });
    if (this.kind === 'loop') {
      context.fillStyle = ink;
      context.fillText(this.xLabel, area.left + area.width / 2, area.top + area.height + 1.5 * em);
    }
    context.strokeStyle = soft;
    context.strokeRect(area.left, area.top, area.width, area.height);
  }

  line(curve, px, py) {
    const { context } = this, { x, y, factor, offset, held } = curve;
    context.strokeStyle = curve.colour || styleOf('--ink');
    context.lineWidth = (curve.beside || curve.thin ? 1.2 : 1.7) * Math.max(1, this.em / 13);
    context.setLineDash(curve.beside ? [5, 4] : []);
    context.beginPath();
    let before = 0;
    for (let k = 0; k < x.length; k += 1) {
      const at = px(x[k]), value = py(factor * y[k] + offset);
      if (k === 0) context.moveTo(at, value);
      else {
        if (held && value !== before) context.lineTo(at, before);
        context.lineTo(at, value);
      }
      before = value;
    }
    context.stroke();
    context.setLineDash([]);
  }

  drawBands(area, px) {
    const { context, bands } = this, height = area.height / bands.length;
    bands.forEach((band, row) => {
      band.begin.forEach((begin, k) => {
        const end = band.begin[k + 1] ?? band.end;
        context.fillStyle = band.colours[k];
        const inset = band.beside ? 0.28 : 0.08;
        context.fillRect(px(begin), area.top + (row + inset) * height, Math.max(px(end) - px(begin), 0.7), (1 - 2 * inset) * height);
      });
    });
  }

  legend(area) {
    const { context, em } = this;
    context.textBaseline = 'alphabetic';
    context.textAlign = 'left';
    context.fillStyle = styleOf('--ink');
    const base = area.top - 0.45 * em;
    context.fillText(this.label, 0.2 * em, base, this.canvas.clientWidth - 0.4 * em);
    if (this.bands.length) {
      context.textBaseline = 'middle';
      context.textAlign = 'right';
      this.bands.forEach((band, row) => {
        context.fillText(band.label, area.left - 0.4 * em, area.top + (row + 0.5) * area.height / this.bands.length);
      });
      return;
    }
    const named = this.curves.filter((curve) => curve.label && !curve.beside && (this.kind === 'time' || this.curves.length > 1));
    let right = area.left + area.width;
    context.textAlign = 'right';
    const free = context.measureText(this.label).width + 1.5 * em; // the label of the axis stands there
    const words = (curve, brief) => (brief ? curve.label.replace(/^\D+ (?=\d+$)/, '') : curve.label) + (this.kind === 'time' ? valueAt(curve, this.cursor) : '');
    const needed = (brief, more) => named.reduce((sum, curve) => sum + context.measureText(words(curve, brief)).width + more * em, 0);
    const brief = named.length > 3 || needed(false, 2.4) > right - free;
    const bare = brief && needed(true, 2.4) > right - free; // no room for samples of the lines: the words have their colours
    for (const curve of [...named].reverse()) {
      const text = words(curve, brief), width = context.measureText(text).width;
      if (right - width < free - (bare ? em : -1.5 * em)) { context.fillText('\u2026', right, base); break; }
      context.fillStyle = bare ? curve.colour : styleOf('--ink');
      context.fillText(text, right, base);
      right -= width + (bare ? 0.8 : 0.4) * em;
      context.fillStyle = curve.colour || styleOf('--ink');
      if (bare) continue;
      context.fillRect(right - 1.1 * em, base - 0.5 * em, 1.1 * em, 0.22 * em);
      right -= 2 * em;
    }
  }
}

/** What a curve is at a time, in words; nothing where it is not known. */
function valueAt({ x, y, factor, offset, held }, time) {
  if (time === undefined || !x.length || time < x[0] || time > x[x.length - 1]) return '';
  let low = 0, high = x.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (x[middle] <= time) low = middle; else high = middle;
  }
  const part = held || x[high] === x[low] ? (time >= x[high] ? 1 : 0) : (time - x[low]) / (x[high] - x[low]);
  const value = factor * (y[low] + part * (y[high] - y[low])) + offset;
  return ` ${Number(value.toPrecision(4))}`.replaceAll('-', '\u2212');
}
