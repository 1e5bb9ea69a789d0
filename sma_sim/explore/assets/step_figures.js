// Figures that grow while a step goes on: the normalized RMSE by model, the cost by iteration.

import { ticks } from './chart.js';
import { element } from './controls.js';

const styleOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** A canvas of a figure, with its description for those who do not see it. */
export function figure(id, caption) {
  return element('figure', { className: 'growing' }, Object.assign(element('canvas', { id }), { role: 'img' }), element('figcaption', { textContent: caption }));
}

/** Say in words what the pointer is at: `words(part)` with its place from left to right, 0 to 1, within the axes. */
export function listen(canvas, words) {
  const said = element('output', { className: 'note' });
  canvas.after(said);
  canvas.addEventListener('pointermove', (event) => { said.textContent = words(partOf(canvas, event.offsetX)); });
  canvas.addEventListener('pointerleave', () => { said.textContent = ''; });
}

const emOf = () => 0.8 * parseFloat(getComputedStyle(document.documentElement).fontSize);
const partOf = (canvas, x) => (x - 4 * emOf()) / (canvas.clientWidth - 5.5 * emOf());

function prepared(canvas, label) {
  const ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width || !height) return null;
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  canvas.setAttribute('aria-label', label);
  const context = canvas.getContext('2d'), em = emOf();
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = `${em}px system-ui, sans-serif`;
  return { context, em, area: { left: 4 * em, top: 1.8 * em, width: width - 5.5 * em, height: height - 4.6 * em } };
}

/** Marks on a logarithmic axis between two values: 1, 2, 5 times powers of ten. */
function logMarks(low, high) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power += 1) {
    for (const k of [1, 2, 5]) if (k * 10 ** power >= low && k * 10 ** power <= high) found.push(k * 10 ** power);
  }
  return found.length > 1 ? found : ticks(low, high, 3).values;
}

function axes({ context, em, area }, [low, high], label, below) {
  const py = (value) => area.top + area.height * (1 - Math.log(value / low) / Math.log(high / low));
  context.fillStyle = styleOf('--ink');
  context.textAlign = 'left';
  context.textBaseline = 'alphabetic';
  context.fillText(label, 0.2 * em, area.top - 0.7 * em);
  context.textAlign = 'center';
  context.fillText(below, area.left + area.width / 2, area.top + area.height + 2.6 * em);
  context.textBaseline = 'middle';
  context.textAlign = 'right';
  context.lineWidth = 1;
  for (const value of logMarks(low, high)) {
    context.strokeStyle = styleOf('--line');
    context.beginPath();
    context.moveTo(area.left, py(value));
    context.lineTo(area.left + area.width, py(value));
    context.stroke();
    context.fillStyle = styleOf('--soft');
    context.fillText(String(Number(value.toPrecision(2))), area.left - 0.4 * em, py(value));
  }
  context.strokeStyle = styleOf('--soft');
  context.strokeRect(area.left, area.top, area.width, area.height);
  return py;
}

/**
 * The normalized RMSE of the models that a diagnosis has fitted, in their order: `{role, effects, error}`.
 * Candidates are dots, those that were accepted are joined by a line.
 */
export function drawErrors(canvas, models) {
  const known = models.filter((one) => one.error > 0);
  const words = known.filter((one) => one.role !== 'candidate').map((one) => `${one.effects.join(' and ') || 'model as it is'} ${one.error.toPrecision(3)}`);
  const space = prepared(canvas, `Normalized RMSE by model: ${words.join(', ')}`);
  if (!space || !known.length) return;
  const { context, em, area } = space;
  const errors = known.map((one) => one.error);
  const range = [Math.min(0.8, ...errors) * 0.9, Math.max(1.5, ...errors) * 1.6];
  const py = axes(space, range, 'normalized RMSE (1: as large as the noise)', 'models in the order in which they were fitted');
  const px = (k) => area.left + area.width * (k + 0.7) / (known.length + 0.8);
  context.strokeStyle = styleOf('--good');
  context.setLineDash([6, 4]);
  context.beginPath();
  context.moveTo(area.left, py(1));
  context.lineTo(area.left + area.width, py(1));
  context.stroke();
  context.setLineDash([]);
  context.strokeStyle = context.fillStyle = styleOf('--blue');
  context.lineWidth = 2;
  context.beginPath();
  let level = null;
  known.forEach((one, k) => {
    if (one.role === 'candidate') return;
    if (level === null) context.moveTo(px(k), py(one.error));
    else { context.lineTo(px(k), level); context.lineTo(px(k), py(one.error)); }
    level = py(one.error);
  });
  if (level !== null) context.lineTo(px(known.length - 1), level);
  context.stroke();
  known.forEach((one, k) => mark(space, one, px(k), py));
}

/** The model of the figure that is nearest to a place in it, in words. */
export function errorAt(models, part) {
  const known = models.filter((one) => one.error > 0);
  const one = known[Math.min(Math.max(Math.round(part * (known.length + 0.8) - 0.7), 0), known.length - 1)];
  if (!one) return '';
  return `${one.role === 'candidate' ? 'candidate ' : ''}${one.effects.join(' + ') || 'model as it is'} (${one.model}): ${one.error.toPrecision(3)} in the fitted runs`;
}

function mark({ context, em, area }, one, x, py) {
  const candidate = one.role === 'candidate', y = py(one.error);
  context.fillStyle = styleOf(candidate ? '--soft' : '--blue');
  context.beginPath();
  context.arc(x, y, (candidate ? 0.22 : 0.4) * em, 0, 7);
  context.fill();
  if (candidate) return;
  const words = one.effects.length ? `+ ${one.effects[one.effects.length - 1]}` : one.model;
  context.fillStyle = styleOf('--ink');
  const half = context.measureText(words).width / 2;
  context.textAlign = 'center';
  context.textBaseline = 'bottom';
  context.lineWidth = 0.35 * em;
  context.strokeStyle = styleOf('--ground');
  const where = [Math.min(Math.max(x, area.left + half + 2), area.left + area.width - half - 2), Math.max(y - 0.6 * em, area.top + em)];
  context.strokeText(words, ...where);
  context.fillText(words, ...where);
}

/** The cost of a calibration by iteration, one line for each starting point. */
export function drawCost(canvas, iterations) {
  const known = iterations.filter((one) => one.cost > 0);
  const space = prepared(canvas, `Cost by iteration: ${known.length ? known[known.length - 1].cost.toPrecision(3) : 'none yet'}`);
  if (!space || !known.length) return;
  const { context, area } = space, costs = known.map((one) => one.cost);
  const py = axes(space, [Math.min(...costs) * 0.9, Math.max(...costs) * 1.1 + 1e-12], 'cost (half the squared error over noise)', 'iteration');
  const most = Math.max(1, ...known.map((one) => one.iteration)), px = (k) => area.left + area.width * (0.02 + 0.96 * k / most);
  const colours = ['--blue', '--wrong', '--good', '--soft'], labels = [...new Set(known.map((one) => one.label))];
  labels.forEach((label, k) => {
    context.strokeStyle = context.fillStyle = styleOf(colours[k % colours.length]);
    context.lineWidth = 2;
    context.beginPath();
    for (const one of known.filter((each) => each.label === label)) context.lineTo(px(one.iteration), py(one.cost));
    context.stroke();
    for (const one of known.filter((each) => each.label === label)) {
      context.beginPath();
      context.arc(px(one.iteration), py(one.cost), 2.5, 0, 7);
      context.fill();
    }
  });
}
