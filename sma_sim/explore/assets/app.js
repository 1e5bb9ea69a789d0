// The page: what is shown follows from the state on the server and from the slider that moves.

import { Chart } from './chart.js';
import { showCommand } from './command.js';
import { element, showEffects, showParameters } from './controls.js';
import { Drawing } from './drawing.js';
import { keepFocus } from './focus.js';
import { showHistory } from './history.js';
import { RobotView } from './live.js';
import { RecordingsView } from './recordings.js';
import { Stages } from './stages.js';
import { ask } from './requests.js';

const part = (id) => document.getElementById(id);
const page = {
  state: null, values: {}, tried: null, window: null, beside: null, time: 0, end: 1, charts: new Map(), drawn: 0, latencies: [], ready: false,
  view: 'model',
};
window.smaExplore = page; // what tests and benchmarks look at
const drawing = new Drawing(part('drawing').querySelector('canvas'));

function say(words, kind = '') {
  const box = part('message');
  box.hidden = !words;
  box.className = kind;
  box.textContent = words;
}

let refused = ''; // what the message is about

/** Do something that the server may refuse; its words stay until the same succeeds. */
async function attempt(what, action) {
  try {
    const found = await action();
    if (refused === what) say('');
    if (refused === what) refused = '';
    return found;
  } catch (error) {
    refused = what;
    say(error.message);
    return null;
  }
}

// Curves: one request at a time; what is asked for meanwhile comes next, and only the last of it.
let asking = false, wanted = null;

/** What is changed for a look, but is no version: a slider that moves, an effect that is tried. */
const changes = () => ({ values: { ...page.tried?.values, ...page.values }, ...(page.tried ? { effects: page.tried.effects } : {}) });

/** Draw what the view shows, unless it has nothing to show. */
async function drawView() {
  if (page.view === 'model') showCurves(await ask('curves', { ...changes(), window: page.window, beside: page.beside, pixels: widest() }));
  else if (page.view === 'data' && page.state.steps.compared.length) {
    recordings.show(await ask('overlay', { ...changes(), beside: page.beside, ...recordings.request() }));
  }
}

function refresh(since = performance.now()) {
  if (asking) { wanted = since; return; }
  asking = true;
  attempt('curves', async () => {
    await drawView();
    page.drawn += 1;
    page.latencies.push(performance.now() - since);
    if (page.latencies.length > 2000) page.latencies.splice(0, 1000);
  }).then(() => {
    asking = false;
    page.ready = true;
    if (wanted === null) return settle();
    const next = wanted;
    wanted = null;
    return refresh(next);
  });
}

// The moving picture follows once nothing else is asked for.
let settling = 0;

function settle() {
  clearTimeout(settling);
  settling = setTimeout(async () => {
    if (page.view === 'data') return settleRecordings();
    if (page.view !== 'model') return null;
    const answer = await attempt('frames', () => ask('frames', { ...changes(), beside: page.beside }));
    if (!answer || asking) return null;
    drawing.set(answer, modeColours());
    drawing.draw(page.time);
    page.pictures = (page.pictures ?? 0) + 1;
    return null;
  }, 60);
}

/** Once no slider moves: delay and starts of the recordings are estimated for what is shown, which takes seconds. */
let estimating = false;
async function settleRecordings() {
  if (estimating || recordings.exact !== false || Object.keys(page.values).length || page.state.steps.running) return;
  estimating = true;
  recordings.estimating(true);
  const done = await attempt('curves', () => ask('settle', changes()));
  estimating = false;
  recordings.estimating(false);
  if (done) refresh();
}

const modeColours = () => Object.fromEntries(Object.entries(page.state.modes).map(([number, mode]) => [number, mode.colour]));
const widest = () => Math.max(400, ...[...page.charts.values()].filter((chart) => chart.kind === 'time').map((chart) => chart.pixels));

function curvesOf(list, numbers, beside) {
  return (list ?? []).map((curve) => ({ factor: 1, offset: 0, ...curve, x: numbers(curve.x), y: numbers(curve.y), beside }));
}

const handlers = {
  point(time) { setTime(time); },
  zoom(range) { page.window = range; part('whole').hidden = false; refresh(); },
  whole() { page.window = null; part('whole').hidden = true; refresh(); },
};

function chartOf(id, kind) {
  if (!page.charts.has(id)) page.charts.set(id, new Chart(part(kind === 'loop' ? 'loops' : 'panels'), kind, kind === 'loop' ? {} : handlers));
  return page.charts.get(id);
}

function showCurves({ content: { shown, beside }, numbers }) {
  page.end = Math.max(shown.end, beside?.end ?? 0);
  const range = page.window ?? [0, page.end], used = new Set();
  const draw = (id, kind, content) => { used.add(id); const chart = chartOf(id, kind); chart.set(content); chart.cursor = page.time; };
  for (const panel of shown.panels) {
    const other = beside?.panels.find((one) => one.id === panel.id);
    draw(panel.id, 'time', { label: panel.label, range, curves: [...curvesOf(other?.curves, numbers, true), ...curvesOf(panel.curves, numbers, false)] });
  }
  if (shown.modes.length) draw('modes', 'bands', { label: 'mode; time [s]', range, bands: [...bandsOf(shown.modes, false), ...bandsOf(beside?.modes ?? [], true)] });
  for (const loop of shown.loops) {
    const other = beside?.loops.find((one) => one.id === loop.id);
    draw(`loop ${loop.id}`, 'loop', { label: loop.y, xLabel: loop.x, curves: [...curvesOf(other?.curves, numbers, true), ...curvesOf(loop.curves, numbers, false)] });
  }
  for (const [id, chart] of page.charts) if (!used.has(id)) { chart.box.remove(); page.charts.delete(id); }
  if (!page.time && !page.posed) setTime(0.24 * page.end); // a pose that is not the one at rest
  page.posed = true;
  for (const chart of page.charts.values()) chart.draw();
  const words = [`${shown.end.toPrecision(4)} s, ${Number(shown.rate.toPrecision(3))} samples/s.`];
  if (!shown.completed) words.push(`The run ended early: ${shown.reason}.`);
  part('summary').textContent = [...words, ...shown.notes].join(' ');
}

function bandsOf(modes, beside) {
  return modes.map((band) => ({
    ...band, beside, label: beside ? `v${page.beside}, ${band.label.replace('wire ', '')}` : band.label,
    colours: band.mode.map((number) => page.state.modes[number]?.colour ?? 'black'),
  }));
}

function setTime(time) {
  page.time = Math.min(Math.max(time, 0), page.end);
  part('instant').value = String(1000 * page.time / (page.end || 1));
  part('instant-text').textContent = `${page.time.toFixed(1)} s`;
  drawing.draw(page.time);
  for (const chart of page.charts.values()) if (chart.kind !== 'loop') { chart.cursor = page.time; chart.draw(); }
}

// Changes: a slider that moves is a preview; what is let go is a version. Keys let go with every press: their last one counts.
const KEY_PAUSE = 600; // [ms] without a key after which what was moved becomes a version
const moved = new Map(); // by name, the value that is no version yet
let pause = 0, last = Promise.resolve();

const preview = (name, value) => { page.values[name] = value; refresh(performance.now()); };
const change = (effects) => perform('change', () => ({ effects, expected: page.state.history.current }));

function commit(name, value, byKey = false) {
  moved.set(name, { value });
  clearTimeout(pause);
  if (byKey) pause = setTimeout(flush, KEY_PAUSE);
  else flush();
}

const parameterActions = { preview, commit, change, moved: (name) => moved.get(name)?.value };
const movedValues = () => Object.fromEntries([...moved].map(([name, { value }]) => [name, value]));
const flush = () => { last = last.then(sendMoved); return last; };

/** One version of all that was moved; what is moved on meanwhile stays. */
async function sendMoved() {
  clearTimeout(pause);
  if (!moved.size) return;
  const sent = new Map(moved);
  const state = await attempt('change', () => ask('change', { values: movedValues(), expected: page.state.history.current }));
  for (const [name, one] of sent) if (moved.get(name) === one) moved.delete(name);
  if (state) show(state);
  else await load(); // the controls go back to what holds
}

/** Ask for a change, one after the other; `body` may be a function of the state that the change before has left. */
function perform(verb, body = {}) {
  last = last.then(async () => {
    await sendMoved();
    const state = await attempt('change', () => ask(verb, typeof body === 'function' ? body() : body));
    if (state) show(state);
    else await load();
  });
  return last;
}

async function load() {
  const state = await attempt('state', () => ask('state'));
  if (state) show(state);
}

function show(state) {
  if (page.state && state.changes < page.state.changes) return; // answers may overtake each other
  const first = page.state === null;
  if (page.state && page.state.history.current !== state.history.current) page.tried = null;
  page.state = state;
  page.values = movedValues();
  const { controls, history } = state;
  if (first && (state.steps.data || state.steps.recorded.length)) { setView('data'); openTab('steps'); }
  recordings.forget();
  stages.show();
  if (page.beside !== null && (page.beside === history.current || !history.versions.some((one) => one.number === page.beside))) page.beside = null;
  part('title').textContent = `${controls.system}${controls.title === controls.system ? '' : ` (${controls.title})`}`;
  part('title').title = controls.description;
  const model = part('model');
  model.replaceChildren(...controls.models.map((name) => element('option', { value: name, textContent: name })));
  model.value = controls.model;
  keepFocus(document.querySelector('header'), () => {
    part('undo').disabled = !history.can_undo;
    part('redo').disabled = !history.can_redo;
  });
  part('yaml').href = `/download/parameters.yaml?version=${history.current}`;
  part('csv').href = `/download/run.csv?version=${history.current}`;
  keepFocus(part('parameters'), () => showParameters(part('parameters'), controls.groups, parameterActions));
  keepFocus(part('effects'), () => showEffects(part('effects'), controls, parameterActions));
  keepFocus(part('command'), () => showCommand(part('command'), state.command, state.columns, (command) => perform('command', { command })));
  keepFocus(part('history'), () => showHistory(part('history'), history, page.beside, {
    go: (number) => perform('go_to', { number }), rename: (number, name) => perform('rename', { number, name }),
    compare: (number) => { page.beside = number; show(page.state); },
    differences: async (before, after) => (await attempt('differences', () => ask('differences', { before, after })))?.differences ?? [],
  }));
  const modes = Object.values(state.modes).map((mode) => {
    const swatch = element('i');
    swatch.style.background = mode.colour;
    return element('span', {}, swatch, mode.name);
  });
  const dashed = page.beside === null ? [] : [element('span', { textContent: `dashed, and on the right: version ${page.beside}` })];
  part('legend').replaceChildren(element('span', { textContent: 'Wires by mode:' }), ...modes, ...dashed);
  refresh();
}

// Steps with recordings, and the robot.
const recordings = new RecordingsView({ refresh: () => refresh(), attempt, startCandidates: () => stages.begin('candidates', {}) });
const stages = new Stages(page, { attempt, perform, load, setView, openTab, refresh: () => refresh(), again: () => recordings.again() });
const robot = new RobotView(part('robot-view'), {
  attempt, recorded: load, recordedCount: () => page.state?.steps.recorded.length ?? 0, useRecorded: () => stages.useRecorded(),
  useCause: (cause) => stages.useCause(cause),
  labels: (channel) => page.state?.channels[channel] ?? { label: channel, factor: 1, offset: 0, colour: '' },
});
Object.assign(page, { recordings, robot, stages });

// Views: the model by itself, recordings beside it, a robot beside it.
function setView(name) {
  if (page.view === name) return;
  page.view = name;
  for (const one of ['model', 'data', 'robot']) {
    part(`view-${one}`).setAttribute('aria-pressed', String(one === name));
    part(`${one}-view`).hidden = one !== name;
  }
  document.body.dataset.view = name;
  const open = tabs.find((tab) => tab.getAttribute('aria-selected') === 'true')?.getAttribute('aria-controls');
  if (open === 'steps' && name !== 'data') openTab('parameters');
  if (open === 'command' && name !== 'model') openTab(name === 'data' ? 'steps' : 'parameters');
  robot.wake();
  if (page.state) refresh();
}
for (const name of ['model', 'data', 'robot']) part(`view-${name}`).addEventListener('click', () => {
  setView(name);
  if (name === 'data') openTab('steps');
});

// Tabs of the controls.
function openTab(id) {
  document.body.dataset.tab = id;
  for (const tab of document.querySelectorAll('[role="tab"]')) {
    const chosen = tab.id === `tab-${id}`;
    tab.setAttribute('aria-selected', String(chosen));
    tab.tabIndex = chosen ? 0 : -1;
    part(tab.getAttribute('aria-controls')).hidden = !chosen;
  }
}
const tabs = [...document.querySelectorAll('[role="tab"]')];
for (const tab of tabs) {
  tab.addEventListener('click', () => openTab(tab.getAttribute('aria-controls')));
  tab.addEventListener('keydown', (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const seen = tabs.filter((one) => one.offsetParent !== null), next = seen[(seen.indexOf(tab) + step + seen.length) % seen.length];
    openTab(next.getAttribute('aria-controls'));
    next.focus();
  });
}
openTab('parameters');

// The picture moves.
let playing = 0;
function play() {
  const pressed = !playing;
  part('play').setAttribute('aria-pressed', String(pressed));
  part('play').textContent = pressed ? 'Pause' : 'Play';
  cancelAnimationFrame(playing);
  playing = 0;
  if (!pressed) return;
  let before = performance.now();
  const step = (now) => {
    const next = page.time + (now - before) / 1000 * page.end / 12; // a run is shown in 12 s
    before = now;
    setTime(next > page.end ? 0 : next);
    playing = requestAnimationFrame(step);
  };
  playing = requestAnimationFrame(step);
}
part('play').addEventListener('click', play);
part('instant').addEventListener('input', () => setTime(Number(part('instant').value) / 1000 * page.end));
part('whole').addEventListener('click', handlers.whole);
part('undo').addEventListener('click', () => perform('undo'));
part('redo').addEventListener('click', () => perform('redo'));
part('model').addEventListener('change', () => perform('change', () => ({ values: { model: part('model').value }, expected: page.state.history.current })));
document.addEventListener('keydown', (event) => {
  if (event.key === '?' && !event.target.matches('input, select, textarea')) part('help').showModal();
  if (!(event.ctrlKey || event.metaKey) || event.target.matches('input[type="text"], input[type="number"]')) return;
  const verb = event.key.toLowerCase() === 'z' ? (event.shiftKey ? 'redo' : 'undo') : event.key.toLowerCase() === 'y' ? 'redo' : '';
  if (verb && !part(verb).disabled) { event.preventDefault(); perform(verb); }
});
part('help-open').addEventListener('click', () => part('help').showModal());
part('help-close').addEventListener('click', () => part('help').close());
function redraw() {
  for (const chart of page.charts.values()) chart.draw();
  drawing.draw(page.time);
  recordings.draw();
  stages.redraw();
}
new ResizeObserver(redraw).observe(part('curves'));
const header = document.querySelector('header'); // what sticks below it has to know its height
new ResizeObserver(() => document.documentElement.style.setProperty('--header', `${header.offsetHeight}px`)).observe(header);
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);

// Other tabs: what they change is shown here too. A hidden tab does not listen: a browser opens few connections to one server.
let events = null;
function listen() {
  events?.close();
  events = null;
  if (document.hidden) return;
  events = new EventSource('/events');
  events.addEventListener('changed', (event) => {
    if (page.state && JSON.parse(event.data).changes > page.state.changes) load();
  });
  events.addEventListener('notice', (event) => {
    const { words } = JSON.parse(event.data);
    say(words, 'notice');
    if (words.startsWith('compiled')) setTimeout(() => say(''), 3000);
  });
  if (page.state) load();
}
document.addEventListener('visibilitychange', () => { if (document.hidden) flush(); listen(); });

history.replaceState(null, '', location.pathname); // the token is in the cookie now
listen();
load();
