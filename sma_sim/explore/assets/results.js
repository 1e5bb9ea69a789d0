// What came out of a step, as tables, figures and sentences.

import { element, shifted } from './controls.js';
import { drawCost, drawErrors, errorAt, figure, listen } from './step_figures.js';

export const digits = (value, count = 4) => (value === null || value === undefined ? '\u2013' : String(Number(value.toPrecision(count))).replace('-', '\u2212'));

/** A table; `kind` 'low' for one that leaves room for the curves below it. */
export function table(head, rows, caption = '', kind = '') {
  const found = element('table', {}, ...(caption ? [element('caption', { textContent: caption })] : []),
    element('thead', {}, element('tr', {}, ...head.map((one) => element('th', { scope: 'col' }, one)))),
    element('tbody', {}, ...rows.map((row) => element('tr', {}, ...row.map((cell, k) => element(k ? 'td' : 'th', k ? {} : { scope: 'row' }, cell))))));
  return element('div', { className: `scroll results ${kind}`, tabIndex: 0, role: 'group', ariaLabel: caption || 'table' }, found);
}

/** The same with all of its digits, so that a column of them is even. */
const even = (value, count = 4) => (value === null || value === undefined || value >= 10 ** count ? digits(value, count) : value.toPrecision(count));

/** A normalized RMSE as a cell: coloured by size, and readable without colour. */
export function errorCell(value) {
  const cell = element('span', { className: `error ${value === null || value === undefined ? '' : value < 1.2 ? 'small-error' : value < 3 ? 'some-error' : 'large-error'}`, textContent: even(value) });
  if (value !== null && value !== undefined) cell.title = String(value);
  return cell;
}

/** A time that something took, such as 3 min 20 s; a short one with so many digits behind the point. */
export function duration(seconds, behind = 1) {
  if (seconds === null || seconds === undefined) return '';
  const whole = Math.round(seconds), hours = Math.floor(whole / 3600), minutes = Math.floor(whole / 60) % 60;
  if (seconds < 9.95) return `${seconds.toFixed(behind)} s`;
  return [hours ? `${hours} h` : '', hours || minutes ? `${minutes} min` : '', hours ? '' : `${whole % 60} s`].filter(Boolean).join(' ');
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
  const { job, result } = found, elapsed = element('span', { className: 'elapsed', textContent: duration(job.seconds) });
  const words = element('span', { className: 'note' }, `step ${job.number}, version ${job.version}, ${job.state}${job.state === 'running' || job.seconds === null ? '' : ' in'} `, elapsed);
  const parts = [element('h2', {}, `${HEADINGS[job.stage] ?? job.stage} `, words)];
  const grows = ['calibrate', 'diagnose'].includes(job.stage);
  const drawn = grows ? figure('growing', CAPTIONS[job.stage]) : null;
  if (drawn) parts.push(drawn);
  if (job.state === 'running') parts.push(element('p', { className: 'words', textContent: job.words }));
  if (['failed', 'killed'].includes(job.state)) parts.push(element('p', { className: 'problem', textContent: job.words }));
  if (job.state === 'running' && job.stage === 'candidates') parts.push(element('div', { id: 'candidates-so-far' }));
  if (result) parts.push(...SHOWN[job.stage](found, actions), files(job));
  parent.replaceChildren(...parts);
  showCandidatesSoFar(parent, found.events, actions);
  if (!drawn) return;
  if (job.stage === 'diagnose') listen(drawn.querySelector('canvas'), (part) => errorAt(actions.events().filter((one) => one.kind === 'model'), part));
  redrawFigure(parent, job.stage, found.events);
}

/** The effects that were switched on so far, while others still are. */
export function showCandidatesSoFar(parent, events, actions) {
  const place = parent.querySelector('#candidates-so-far'), effects = events.filter((one) => one.kind === 'candidate');
  if (place && effects.length) place.replaceChildren(candidateTable(effects.sort((a, b) => a.expected_error - b.expected_error), [], actions));
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
  diagnose: 'Line: the model so far. Dots: candidates. Dashed: as good as the sensors can tell. Point at one to read which it is.',
};

const HEADINGS = {
  check: 'What was read', compare: 'Normalized RMSE', calibrate: 'Calibration', diagnose: 'Diagnosis', candidates: 'What each effect would do',
};

/** A fitted parameter: its name, value, interval, unit. */
const intervalRow = ([name, one]) => [element('code', { textContent: name }), digits(one.value, 6),
  one.seen === false ? 'not determined' : one.low === undefined ? '' : `${digits(one.low)} to ${digits(one.high)}`, one.unit];

/** How probable the models are, in the words of the program; nothing where a diagnosis says nothing of it. */
function probabilities({ lines, models, findings }) {
  if (!lines.length) return [];
  const shown = element('div', { id: 'probabilities' }, ...lines.map((textContent) => element('p', { textContent })),
    table(['model', 'probability', 'normalized RMSE'], models.map((one) => [one.words, one.probability, errorCell(one.error)]), 'Models, the most probable first'));
  if (findings.length) shown.append(element('details', {}, element('summary', { textContent: 'Of each effect' }), table(['missing', 'probability'], findings.map((one) => [one.words, one.probability]), 'How probable it is that it is missing')));
  return [shown];
}

const FIRST_SENTENCES = 3; // of where the error is

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
    const { findings, patterns, spread } = result.comparisons[0], found = [...patterns, ...findings].sort((a, b) => (b.weight ?? 0) - (a.weight ?? 0));
    if (!found.length) return [element('p', { textContent: spread })];
    const rest = found.slice(FIRST_SENTENCES), channels = [...new Set(rest.map((one) => one.channel))];
    const more = rest.length ? [element('details', {}, element('summary', { textContent: `${rest.length} more, by channel` }),
      ...channels.flatMap((channel) => [element('h3', { textContent: channel }), list(rest.filter((one) => one.channel === channel).map((one) => one.text))]))] : [];
    return [heading('Where the error is'), list(found.slice(0, FIRST_SENTENCES).map((one) => one.text)), ...more];
  },
  calibrate({ result }, { moveLimit }) {
    const rows = Object.entries(result.parameters).map(intervalRow);
    const held = result.error.held_out === null ? '' : `, of held-out runs ${digits(result.error.held_out)}`;
    const words = (result.implausible ?? []).map((one) => `${one.name ?? one.parameter ?? ''} is outside of what is plausible`);
    const limits = result.limits.map((one) => {
      const move = element('button', { type: 'button', textContent: 'Move this limit' });
      move.addEventListener('click', () => moveLimit(one));
      return element('li', {}, one.text, ...(one.text.includes('--limit') ? [' ', move] : []));
    });
    return [element('p', { textContent: `Normalized RMSE of the fitted runs ${digits(result.error.train)}${held}. ${result.converged ? '' : 'Not converged. '}${result.interrupted ? 'Stopped: the best so far.' : ''}` }),
      table(['parameter', 'value', '95 % interval', 'unit'], rows, 'Fitted parameters'),
      ...(limits.length ? [element('ul', { id: 'limits' }, ...limits)] : []), ...(words.length ? [list(words)] : [])];
  },
  diagnose({ result, summary }) {
    const rows = result.error.map((stage) => [`${stage.effects.join(' + ') || 'calibrated, as it is'}${stage.differences?.length ? ', recordings differ' : ''}`, errorCell(stage.train), errorCell(stage.held_out)]);
    const ranking = result.ranking.slice(0, 8).map((one) => [element('code', { textContent: one.effect }), digits(one.delta_bic), digits(one.held_out_error_ratio, 3),
      one.plausible === false ? 'no' : 'yes', one.confounded_with.join(', ')]);
    const [first, ...others] = summary.trim().split('\n'), fitted = Object.entries(result.intervals ?? {});
    const [found, rest] = [true, false].map((own) => fitted.filter(([name]) => name.startsWith('effects.') === own));
    const head = ['parameter', 'value', '95 % interval', 'unit'];
    return [element('p', { className: 'verdict', textContent: first }), ...probabilities(result.probability),
      ...(found.length ? [table(head, found.map(intervalRow), 'Values of what was found')] : []),
      table(['model', 'fitted', 'held out'], rows, 'Normalized RMSE'),
      ...(rest.length ? [element('details', {}, element('summary', { textContent: 'Fitted parameters' }), table(head, rest.map(intervalRow), 'Fitted parameters'))] : []),
      ...(ranking.length ? [table(['effect', '\u0394BIC', 'held-out error, with / without', 'plausible', 'not distinguishable from'], ranking, 'First step, best first')] : []),
      element('details', {}, element('summary', { textContent: 'All that the command prints' }), element('pre', { textContent: [first, ...others].join('\n') }))];
  },
  candidates({ result }, actions) {
    const channels = Object.keys(result.errors);
    const none = ['none', '', errorCell(result.error), errorCell(result.expected_error), '', result.probability_words, ...channels.map((name) => errorCell(result.errors[name]))];
    return [candidateTable(result.effects, [none], actions),
      note('Values: where the effect explains most while all other parameters stay as they are, within the limits of what is realistic. Intervals: 95 %, as wide as the other parameters leave them. Probability: among the models with one of these effects or none, to first order. The diagnosis fits them, and pairs of them too.')];
  },
};

/** Effects that were switched on one at a time, each to be tried and kept, below the `first` rows. */
function candidateTable(effects, first, { tryEffect, keepEffect, tried, unitOf }) {
  const channels = Object.keys(effects[0]?.errors ?? {});
  const rows = effects.map((effect) => {
    const look = element('button', { type: 'button', textContent: tried === effect.name ? 'Shown' : 'Try', ariaPressed: String(tried === effect.name) });
    look.addEventListener('click', () => tryEffect(tried === effect.name ? null : effect));
    const keep = element('button', { type: 'button', textContent: 'Switch on' });
    keep.addEventListener('click', () => keepEffect(effect));
    const values = Object.entries(effect.parameters).map(([name, one]) => element('div', { textContent: valueWords(name, one, unitOf(effect.name, name)) }));
    return [element('code', { textContent: effect.name }), element('span', { className: 'pair' }, look, ' ', keep), errorCell(effect.error), errorCell(effect.expected_error), element('div', { className: 'small' }, ...values), effect.probability_words, ...channels.map((name) => errorCell(effect.errors[name]))];
  });
  return table(['effect', '', 'error with it', 'and parameters refitted (first order)', 'values (95 % interval)', 'probability', ...channels], [...first, ...rows], 'Normalized RMSE with each effect switched on', 'low');
}

/** A parameter of an effect with its interval, in the unit in which the page shows it. */
function valueWords(name, { value, low, high, at_end: atEnd, determined }, { power, unit }) {
  const shown = (number) => digits(shifted(number, -power), 3), interval = determined ? `${shown(low)} to ${shown(high)}` : 'not determined';
  return `${name} ${shown(value)} (${interval})${unit === '-' ? '' : ` ${unit}`}${atEnd ? ', at its limit' : ''}`;
}

/** What was exported. */
export function showExport(parent, found) {
  const names = found.files.map((name) => link(name, `/download/${name}?export=${found.number}`));
  parent.replaceChildren(heading(`Version ${found.number} is exported`), note(`Written to ${found.folder}`), element('p', { className: 'buttons' }, ...names),
    note('parameters.yaml is the improved model, for --config of every command and for the node. reproduce.sh and reproduce.py lead to the same numbers.'),
    ...[['Parameter file', found.yaml], ['Shell commands', found.shell], ['Python', found.python]].map(([words, textContent]) => element('details', { open: words === 'Parameter file' }, element('summary', { textContent: words }), element('pre', { textContent }))));
}

/** What a part of a residual is. */
export function showRegion(parent, found, { switchOn, closer, close }) {
  const states = new Map();
  for (const share of found.states) states.set(share.dimension, [...states.get(share.dimension) ?? [], share]);
  const percent = (share) => `${Math.round(100 * share)} %`;
  const rows = [...states].map(([dimension, shares]) => [dimension, shares.map((one) => `${one.label} ${percent(one.share)}`).join(', '), `${percent(shares[0].elsewhere)} elsewhere`]);
  const temperatures = Object.entries(found.temperatures).map(([wire, [low, high]]) => `${wire} ${digits(low - 273.15, 3)} to ${digits(high - 273.15, 3)} deg C`).join(', ');
  const effects = [...found.effects].filter((one) => one.explains > 0.05).sort((a, b) => b.explains - a.explains).slice(0, 6).map((one) => [element('code', { textContent: one.effect }), digits(one.cosine, 2), percent(one.explains)]);
  const button = (textContent, action) => { const one = element('button', { type: 'button', textContent }); one.addEventListener('click', action); return one; };
  const alike = effects.length ? [table(['effect', 'cosine with its trace', 'explains'], effects, 'Effects that leave such a trace here (first order)')]
    : found.effects.length ? [element('p', { textContent: 'No effect leaves a trace like this.' })] : [button('Which effects leave such a trace? (switches each on by itself; the time that is left is shown)', switchOn)];
  parent.hidden = false;
  parent.replaceChildren(element('div', { className: 'bar' }, heading(`${found.run}, ${found.channel}, ${digits(found.t0)} to ${digits(found.t1)} s`), button('Look closer', closer), button('Close', close)),
    element('p', { textContent: `${found.samples} samples; residual ${digits(found.over_noise, 3)} times the noise, mean ${digits(found.bias_over_noise, 3)}. Temperature: ${temperatures}.` }),
    table(['state of the model', 'here', 'most frequent one'], rows, 'What the model does there'), ...alike);
}
