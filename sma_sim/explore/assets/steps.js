// The steps from recordings to an improved model, in their order; each can be taken when what it needs is there.

import { element } from './controls.js';
import { duration } from './results.js';

export const TITLES = {
  check: 'Check the recordings', compare: 'Compare', calibrate: 'Calibrate', diagnose: 'Diagnose', accept: 'Accept', export: 'Export',
  candidates: 'Switch effects on, one at a time',
};
export const PURPOSES = {
  check: 'Reads the files: runs and channels, what is missing or was repaired, how large the noise is.',
  compare: 'Runs the model under the recorded commands and measures its error in units of the noise.',
  calibrate: 'Fits the parameters of the model as it is. It may be left out: a diagnosis calibrates too.',
  diagnose: 'Searches for the physical effect that the model lacks, and judges it by runs that were not fitted. Takes minutes; you may close the page meanwhile.',
  accept: 'Makes the calibrated or diagnosed model the current version. Undo goes back.',
  export: 'Gives you the parameter file, the report, and the commands and Python lines that do the same.',
};
const VERBS = { check: 'Check', compare: 'Compare', calibrate: 'Calibrate', diagnose: 'Diagnose', accept: 'Accept', export: 'Export' };
const MARKS = { done: '\u2713', stopped: '\u25a0', failed: '\u2717', killed: '\u2717', running: '\u25b6' };

/** The step that comes next, by what there is. */
export function nextStep({ steps, history }) {
  const of = Object.fromEntries(steps.stages.map((one) => [one.stage, one]));
  const has = (stage) => ['done', 'stopped'].includes(of[stage].job?.state) && 'result' in (of[stage].job?.files ?? {});
  if (steps.running) return steps.running.stage;
  if (!has('check')) return 'check';
  if (!has('compare')) return 'compare';
  const current = history.versions.find((one) => one.number === history.current);
  const found = of.accept.job;
  if (current.step !== null) return 'export';
  if (found && !history.versions.some((one) => one.step === found.number)) return found.stage === 'diagnose' ? 'accept' : 'diagnose';
  return 'diagnose';
}

/** Show the steps; `chosen` is the one whose result is looked at. */
export function showSteps(parent, state, chosen, actions) {
  const { steps } = state;
  if (!steps.data) return parent.replaceChildren(...openRecordings(actions, state));
  const next = nextStep(state), open = new Set([...parent.querySelectorAll('details[open]')].map((one) => one.dataset.options));
  const list = element('ol', { className: 'steps' }, ...steps.stages.map((one) => stepItem(one, state, { next, chosen, open }, actions)));
  parent.replaceChildren(element('p', { className: 'note', textContent: 'From recordings to an improved model, in this order. What is marked comes next.' }), list,
    element('details', {}, element('summary', { textContent: 'Other recordings' }), ...openRecordings(actions, state)));
}

function stepItem(one, state, { next, chosen, open }, actions) {
  const { stage, ready, reason, job } = one, running = job?.state === 'running', busy = state.steps.running !== null;
  const accepted = stage === 'accept' && job && state.history.versions.some((version) => version.step === job.number);
  const mark = stage === 'accept' ? (accepted ? MARKS.done : '') : MARKS[job?.state] ?? '';
  const title = element('button', { type: 'button', className: 'link', textContent: TITLES[stage], title: 'Show what came out of it' });
  title.addEventListener('click', () => actions.choose(stage));
  const item = element('li', { className: [stage === next ? 'next' : '', stage === chosen ? 'chosen' : '', ready || running ? '' : 'locked'].join(' ') },
    element('div', { className: 'head' }, title, element('span', { className: `mark ${job?.state ?? ''}`, textContent: mark })),
    element('p', { className: 'small', textContent: PURPOSES[stage] }));
  item.dataset.stage = stage;
  if (stage === chosen) item.setAttribute('aria-current', 'step');
  if (job && ['failed', 'killed'].includes(job.state) && stage !== 'accept') item.append(element('p', { className: 'problem', textContent: job.words }));
  if (running) return progress(item, job, actions);
  if (!ready) {
    const [first] = reason.split(': '); // how that went is said there
    item.append(element('p', { className: 'small reason', textContent: `${first[0].toUpperCase()}${first.slice(1)}.` }));
    return item;
  }
  const { fields, read } = optionsOf(stage, open.has(stage), actions.options);
  const begin = element('button', { type: 'button', className: stage === next ? 'primary' : '', textContent: label(stage, state, job, accepted), disabled: busy || accepted });
  begin.dataset.begin = begin.dataset.key = stage;
  begin.addEventListener('click', () => actions.begin(stage, read()));
  item.append(element('div', { className: 'row' }, begin), ...fields, ...(stage === 'compare' ? candidates(state, actions) : []));
  return item;
}

/** Effects switched on by hand belong to the comparison: each of them, one at a time. */
function candidates({ steps }, actions) {
  const { running, candidates: known } = steps, part = element('div', { className: 'sub' });
  part.dataset.stage = 'candidates';
  if (running?.stage === 'candidates') return [progress(part, running, actions)];
  if (!steps.compared.includes(steps.version)) return [];
  const done = known?.state === 'done';
  const begin = element('button', { type: 'button', textContent: done ? 'What each effect would do' : 'Switch effects on, one at a time', disabled: running !== null });
  begin.dataset.begin = begin.dataset.key = 'candidates';
  begin.addEventListener('click', () => (done ? actions.choose('candidates') : actions.begin('candidates', {})));
  part.append(begin);
  if (known && ['failed', 'killed'].includes(known.state)) part.append(element('p', { className: 'problem', textContent: known.words }));
  return [part];
}

function label(stage, { history }, job, accepted) {
  if (stage === 'accept') return accepted ? 'Accepted' : `Accept the ${job.stage === 'diagnose' ? 'diagnosed' : 'calibrated'} model`;
  if (stage === 'compare' || stage === 'export') return `${VERBS[stage]} version ${history.current}`;
  return job ? `${VERBS[stage]} again` : VERBS[stage];
}

function progress(item, job, actions) {
  const stop = element('button', { type: 'button', textContent: 'Stop, and keep what it has' });
  stop.dataset.stop = stop.dataset.key = job.stage;
  stop.addEventListener('click', actions.stop);
  item.append(element('progress', { ariaLabel: `${TITLES[job.stage]} is running` }),
    element('p', { className: 'small' }, element('span', { className: 'words', role: 'status', textContent: job.words }), ' ', element('span', { className: 'elapsed', textContent: duration(job.seconds) })), stop);
  return item;
}

/** How far a step is that does one thing after the other: how many are done of how many, and the time that is left [s]. */
export function partDone(events) {
  const each = events.filter((one) => one.total), last = each[each.length - 1];
  if (!last) return null;
  const begin = events.find((one) => one.n === each[0].n - 1)?.t ?? 0; // what it began with took its own time
  return { done: last.done, total: last.total, left: (last.t - begin) / last.done * (last.total - last.done) };
}

/** The options of a step, as they were chosen last (`kept`, by stage). */
function optionsOf(stage, open, kept) {
  const controls = OPTIONS[stage]?.();
  if (!controls) return { fields: [], read: () => ({}) };
  const chosen = kept[stage] ??= {};
  const rows = Object.entries(controls).map(([name, [words, control]]) => {
    const what = control.type === 'checkbox' ? 'checked' : 'value';
    if (name in chosen) control[what] = chosen[name];
    control.dataset.option = name;
    control.addEventListener('input', () => { chosen[name] = control[what]; });
    return element('label', { className: 'field' }, `${words} `, control);
  });
  const details = element('details', { open }, element('summary', { textContent: 'Options' }), ...rows);
  details.dataset.options = stage;
  const values = () => Object.fromEntries(Object.entries(controls).map(([name, [, control]]) => [name, read(control)]));
  return { fields: [details], read: () => Object.fromEntries(Object.entries(values()).filter(([, value]) => value !== null)) };
}

/** What a control says: a list of names, a number, a switch or a word; null for what was left to the program. */
function read(control) {
  if (control.type === 'checkbox') return control.checked;
  if (control.type === 'number') return Number(control.value);
  if (control.type !== 'text') return control.value || null;
  const names = control.value.split(',').map((name) => name.trim()).filter(Boolean);
  return names.length ? names : null;
}

const check = (checked) => element('input', { type: 'checkbox', checked });
const kinetics = () => element('select', {}, ...[['', 'as this version says'], ['auto', 'the more probable of both'], ['hybrid', 'hybrid'], ['mas', 'mas']].map(([value, textContent]) => element('option', { value, textContent })));

const limits = () => ['between which values (SI) something is estimated, such as delay=-2:5, beam.E=1e9:3e9', element('input', { type: 'text', placeholder: 'the usual limits' })];

const OPTIONS = {
  calibrate: () => ({
    model: ['kinetics', kinetics()],
    free: ['parameters to fit, such as beam.E, wire.lambda', element('input', { type: 'text', placeholder: 'chosen automatically' })],
    starts: ['starting points', element('input', { type: 'number', min: '1', max: '100', value: '2' })],
    robust: ['give outliers less weight', check(false)],
    limits: limits(),
  }),
  diagnose: () => ({
    model: ['kinetics', kinetics()],
    equation: ['search for an equation if no known effect explains the error', check(true)],
    variants: ['also effects in one wire or coordinate only', check(true)],
    limits: limits(),
  }),
};

function openRecordings({ open, useRecorded }, { steps: { recorded }, recorded_columns: columns }) {
  const files = fileInput('recordings-files', 'Files with recordings', { multiple: true, accept: '.csv,.mcap,.db3,.yaml,.yml,.json,text/csv' }, open);
  const folder = fileInput('recordings-folder', 'Folder with recordings', { webkitdirectory: true }, open);
  const found = [element('p', { textContent: 'Choose the recordings of your robot: one CSV file or bag for each run, three runs or more if you have them.' }),
    element('div', { className: 'choose' }, files, folder),
    element('p', { id: 'sending', className: 'small', role: 'status' }),
    element('p', { className: 'note', textContent: `CSV files have columns with units in the header: time_s and those of ${columns.join(', ')} that you have: the command, and what was measured. Of columns with other names or units you say on this page which is which, once they are there. A bag is a file .mcap or .db3, or its folder. With them you may choose meta.json (the noise of the sensors) and a column map (.yaml). Copies of the files are kept in the session.` })];
  if (recorded.length) {
    const use = element('button', { type: 'button', textContent: `Use what was recorded here (${recorded.length})` });
    use.addEventListener('click', useRecorded);
    found.push(use);
  }
  return found;
}

/** A button that chooses files; what is chosen is opened. */
function fileInput(id, label, kind, open) {
  const chosen = Object.assign(element('input', { type: 'file', id }), kind);
  chosen.addEventListener('change', () => { if (chosen.files.length) open([...chosen.files]); });
  return element('label', {}, `${label} `, chosen);
}
