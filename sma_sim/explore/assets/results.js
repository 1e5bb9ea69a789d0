// What came out of a step, as tables, figures and sentences.

import { element } from './controls.js';
import { drawCost, drawErrors, errorAt, figure, listen } from './figures.js';

export const digits = (value, count = 4) => (value === null || value === undefined ? '\u2013' : String(Number(value.toPrecision(count))).replace('-', '\u2212'));

export function table(head, rows, caption = '') {
  const found = element('table', {}, ...(caption ? [element('caption', { textContent: caption })] : []),
    element('thead', {}, element('tr', {}, ...head.map((one) => element('th', { scope: 'col' }, one)))),
    element('tbody', {}, ...rows.map((row) => element('tr', {}, ...row.map((cell, k) => element(k ? 'td' : 'th', k ? {} : { scope: 'row' }, cell))))));
  return element('div', { className: 'scroll results', tabIndex: 0, role: 'group', ariaLabel: caption || 'table' }, found);
}

/** The same with all of its digits, so that a column of them is even. */
const even = (value, count = 4) => (value === null || value === undefined || value >= 10 ** count ? digits(value, count) : value.toPrecision(count));

/** An error over noise as a cell: coloured by size, and readable without colour. */
export function errorCell(value) {
  const cell = element('span', { className: `error ${value === null || value === undefined ? '' : value < 1.2 ? 'small-error' : value < 3 ? 'some-error' : 'large-error'}`, textContent: even(value) });
  if (value !== null && value !== undefined) cell.title = String(value);
  return cell;
}

const inUnit = (value, { factor, unit }) => `${digits(factor * value, 3)} ${unit}`;

const list = (words) => element('ul', {}, ...words.map((textContent) => element('li', { textContent })));
const heading = (textContent) => element('h2', { textContent });
const note = (textContent) => element('p', { className: 'note', textContent });
const link = (textContent, href) => element('a', { textContent, href, download: '', className: 'file' });

function files(job) {
  const names = { report: ['Report (HTML)', 'report.html'], parameters: ['Parameter file', 'parameters.yaml'], result: ['Result (JSON)', 'result.json'] };
  return element('p', { className: 'buttons' }, ...Object.keys(names).filter((name) => name in job.files).map((name) => link(names[name][0], `/download/${names[name][1]}?job=${job.number}`)));
}

/** The result of a step in `parent`: `{job, result, events, summary}` as the server has it. */
export function showResult(parent, stage, found, actions) {
  const { job, result } = found, words = `step ${job.number}, version ${job.version}, ${job.state}`;
  const parts = [element('h2', {}, `${HEADINGS[job.stage] ?? job.stage} `, element('span', { className: 'note', textContent: words }))];
  const grows = ['calibrate', 'diagnose'].includes(job.stage);
  const drawn = grows ? figure('growing', CAPTIONS[job.stage]) : null;
  if (drawn) parts.push(drawn);
  if (job.state === 'running') parts.push(element('p', { className: 'words', textContent: job.words }));
  if (['failed', 'killed'].includes(job.state)) parts.push(element('p', { className: 'problem', textContent: job.words }));
  if (result) parts.push(...SHOWN[job.stage](found, actions), files(job));
  parent.replaceChildren(...parts);
  if (!drawn) return;
  if (job.stage === 'diagnose') listen(drawn.querySelector('canvas'), (part) => errorAt(actions.events().filter((one) => one.kind === 'model'), part));
  redrawFigure(parent, job.stage, found.events);
}

/** Draw the figure of a step anew, as when an event has come. */
export function redrawFigure(parent, stage, events) {
  const canvas = parent.querySelector('#growing');
  if (!canvas) return;
  if (stage === 'diagnose') drawErrors(canvas, events.filter((one) => one.kind === 'model'));
  else drawCost(canvas, events.filter((one) => one.kind === 'iteration'));
}

const CAPTIONS = {
  calibrate: 'The cost falls while parameters are fitted; a line for each starting point.',
  diagnose: 'Line: the model so far. Dots: candidates. Squares: the same in runs left out in turn. Dashed: as good as the sensors can tell. Point at one to read which it is.',
};

const HEADINGS = {
  check: 'What was read', compare: 'Error over noise', calibrate: 'Calibration', diagnose: 'Diagnosis', candidates: 'What each effect would do',
};

const SHOWN = {
  check({ result }, { holdOut, labels }) {
    const chosen = new Set(result.runs.filter((run) => run.held_out).map((run) => run.name));
    const rows = result.runs.map((run) => {
      const box = element('input', { type: 'checkbox', checked: run.held_out, ariaLabel: `hold out ${run.name}` });
      box.addEventListener('change', () => { if (box.checked) chosen.add(run.name); else chosen.delete(run.name); holdOut([...chosen]); });
      const channels = Object.entries(run.channels).map(([name, one]) => name + (one.missing ? ` (${one.missing} missing)` : ''));
      return [run.name, box, `${digits(run.end - run.begin)} s`, String(run.samples), `${digits(1000 * (run.sample_time ?? 0))} ms`, channels.join(', ')];
    });
    const noise = Object.entries(result.noise_std).map(([name, value]) => `${name} ${inUnit(value, labels(name))}`).join(', ');
    return [table(['run', 'hold out', 'duration', 'samples', 'sample time', 'channels'], rows, 'Runs'),
      note('A run that is held out is not fitted: it shows whether the model predicts. Without a choice, a diagnosis leaves out each run in turn.'),
      element('p', { textContent: `Noise (standard deviation): ${noise || 'not known'}` }),
      ...(result.notes.length ? [heading('Repaired or noteworthy'), list(result.notes)] : [element('p', { textContent: 'Nothing had to be repaired.' })])];
  },
  compare({ result }) {
    const { findings, patterns } = result.comparisons[0];
    const words = [...patterns, ...findings].map((one) => one.text);
    const more = words.length > 3 ? [element('details', {}, element('summary', { textContent: `${words.length - 3} more` }), list(words.slice(3)))] : [];
    return words.length ? [heading('Where the error is'), list(words.slice(0, 3)), ...more] : [element('p', { textContent: 'The error is spread evenly, or is no more than noise.' })];
  },
  calibrate({ result }) {
    const rows = Object.entries(result.parameters).map(([name, one]) => [element('code', { textContent: name }), digits(one.value, 6),
      one.seen === false ? 'not determined' : one.low === undefined ? '' : `${digits(one.low)} to ${digits(one.high)}`, one.unit]);
    const held = result.error.held_out === null ? '' : `, of held-out runs ${digits(result.error.held_out)}`;
    const words = [...(result.at_bound ?? []).map((name) => `${name} is at its bound`), ...(result.implausible ?? []).map((one) => `${one.name ?? one.parameter ?? ''} is outside of what is plausible`)];
    return [element('p', { textContent: `Error over noise of the fitted runs ${digits(result.error.train)}${held}. ${result.converged ? '' : 'Not converged. '}${result.interrupted ? 'Stopped: the best so far.' : ''}` }),
      table(['parameter', 'value', '95 % interval', 'unit'], rows, 'Fitted parameters'), ...(words.length ? [list(words)] : [])];
  },
  diagnose({ result, summary }) {
    const rows = result.error.map((stage) => [stage.effects.join(' + ') || 'model as it is', errorCell(stage.train), errorCell(stage.held_out)]);
    const ranking = result.ranking.slice(0, 8).map((one) => [element('code', { textContent: one.effect }), digits(one.delta_bic), digits(one.held_out_error_ratio, 3),
      one.plausible === false ? 'no' : 'yes', one.confounded_with.join(', ')]);
    const [first, ...others] = summary.trim().split('\n');
    return [element('p', { className: 'verdict', textContent: first }),
      table(['model', 'fitted', 'held out'], rows, 'Error over noise'),
      ...(ranking.length ? [table(['effect', '\u0394BIC', 'held-out error, with / without', 'plausible', 'not distinguishable from'], ranking, 'First step, best first')] : []),
      element('details', {}, element('summary', { textContent: 'All that the command prints' }), element('pre', { textContent: [first, ...others].join('\n') }))];
  },
  candidates({ result }, { tryEffect, keepEffect, tried }) {
    const channels = Object.keys(result.errors);
    const rows = result.effects.map((effect) => {
      const look = element('button', { type: 'button', textContent: tried === effect.name ? 'Shown' : 'Try', ariaPressed: String(tried === effect.name) });
      look.addEventListener('click', () => tryEffect(tried === effect.name ? null : effect));
      const keep = element('button', { type: 'button', textContent: 'Switch on' });
      keep.addEventListener('click', () => keepEffect(effect));
      return [element('code', { textContent: effect.name }), element('span', { className: 'pair' }, look, ' ', keep), errorCell(effect.error), errorCell(effect.expected_error), digits(effect.family_p, 2), ...channels.map((name) => errorCell(effect.errors[name]))];
    });
    return [table(['effect', '', 'error with it', 'and parameters refitted (first order)', 'chance', ...channels],
      [['none', '', errorCell(result.error), errorCell(result.expected_error), '', ...channels.map((name) => errorCell(result.errors[name]))], ...rows], 'Error over noise with each effect switched on'),
    note('Chance: how often, by chance alone, the best of all effects explains as much. A small error is no proof: the diagnosis judges by runs that were not fitted.')];
  },
};

/** What was exported. */
export function showExport(parent, found) {
  const names = found.files.map((name) => link(name, `/download/${name}?export=${found.number}`));
  parent.replaceChildren(heading(`Version ${found.number} is exported`), note(`Written to ${found.folder}`), element('p', { className: 'buttons' }, ...names),
    note('parameters.yaml is the improved model, for --config of every command and for the node. again.sh and again.py lead to the same numbers.'),
    ...[['Parameter file', found.yaml], ['Shell commands', found.shell], ['Python', found.python]].map(([words, textContent]) => element('details', { open: words === 'Parameter file' }, element('summary', { textContent: words }), element('pre', { textContent }))));
}

/** What a part of a residual is. */
export function showRegion(parent, found, { switchOn, closer, close }) {
  const states = new Map();
  for (const share of found.states) states.set(share.dimension, [...states.get(share.dimension) ?? [], share]);
  const percent = (share) => `${Math.round(100 * share)} %`;
  const rows = [...states].map(([dimension, shares]) => [dimension, shares.map((one) => `${one.label} ${percent(one.share)}`).join(', '), `${percent(shares[0].elsewhere)} elsewhere`]);
  const temperatures = Object.entries(found.temperatures).map(([wire, [low, high]]) => `${wire} ${digits(low - 273.15, 3)} to ${digits(high - 273.15, 3)} \u00b0C`).join(', ');
  const effects = [...found.effects].filter((one) => one.explains > 0.05).sort((a, b) => b.explains - a.explains).slice(0, 6).map((one) => [element('code', { textContent: one.effect }), digits(one.cosine, 2), percent(one.explains)]);
  const button = (textContent, action) => { const one = element('button', { type: 'button', textContent }); one.addEventListener('click', action); return one; };
  const alike = effects.length ? [table(['effect', 'cosine with its trace', 'explains'], effects, 'Effects that leave such a trace here (first order)')]
    : found.effects.length ? [element('p', { textContent: 'No effect leaves a trace like this.' })] : [button('Which effects leave such a trace? (switches each on, takes a minute)', switchOn)];
  parent.hidden = false;
  parent.replaceChildren(element('div', { className: 'bar' }, heading(`${found.run}, ${found.channel}, ${digits(found.t0)} to ${digits(found.t1)} s`), button('Look closer', closer), button('Close', close)),
    element('p', { textContent: `${found.samples} samples; residual ${digits(found.over_noise, 3)} times the noise, mean ${digits(found.bias_over_noise, 3)}. Temperature: ${temperatures}.` }),
    table(['state of the model', 'here', 'most frequent one'], rows, 'What the model does there'), ...alike);
}
