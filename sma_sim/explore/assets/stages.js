// What the steps of the recordings do: begin and stop them, follow the one that runs, show what came out.

import { showColumns } from './columns.js';
import { element } from './controls.js';
import { keepFocus } from './focus.js';
import { duration, redrawFigure, showCandidatesSoFar, showExport, showResult } from './results.js';
import { PURPOSES, TITLES, nextStep, partDone, showSteps } from './steps.js';
import { ask } from './requests.js';

const part = (id) => document.getElementById(id);
const PERIOD = 400, AFTER_FAILURE = 2000; // [ms] between two questions about a step that runs
const RESULTS_KEPT = 20;
const PIECE = 4e6; // bytes of a file that are sent at once
const KINDS = /\.(csv|mcap|db3|ya?ml)$|^meta\.json$/i;

/** The bytes of a part of a file as base64. */
function base64(piece) {
  return new Promise((resolve, reject) => {
    const reader = new FileReader();
    if (!piece.size) { resolve(''); return; }
    reader.onload = () => resolve(reader.result.slice(reader.result.indexOf(',') + 1));
    reader.onerror = () => reject(new Error(`The file cannot be read: ${reader.error.message}`));
    reader.readAsDataURL(piece);
  });
}

export class Stages {
  /** `page`: what the page knows; `actions`: attempt, perform, load, setView, openTab, refresh, again (explain the marked part again). */
  constructor(page, actions) {
    Object.assign(this, { page, actions, results: new Map(), options: {}, events: [], chosen: null, exported: null, polling: 0 });
  }

  get state() { return this.page.state; }

  show() {
    const { steps } = this.state;
    this.chosen ??= steps.data ? nextStep(this.state) : null;
    keepFocus(part('steps'), () => showSteps(part('steps'), this.state, this.chosen, {
      choose: (stage) => this.choose(stage), begin: (stage, options) => this.begin(stage, options), stop: () => this.actions.perform('stop'),
      open: (files) => this.send(files), useRecorded: () => this.useRecorded(), options: this.options,
    }));
    if (!steps.compared.length) part('grid-view').hidden = true;
    this.detail();
    if (steps.running && !this.polling) this.poll();
  }

  choose(stage) {
    this.chosen = stage;
    this.actions.setView('data');
    this.show();
    part('detail').scrollIntoView({ block: 'start' });
  }

  /** Send files that were chosen to the session, in pieces, and open what they hold. */
  async send(files) {
    const wanted = files.filter((file) => !file.webkitRelativePath || KINDS.test(file.name)); // of a folder, what is no recording stays
    if (!wanted.length) return this.actions.attempt('change', () => { throw new Error('The folder holds no CSV files or bags (.mcap, .db3).'); });
    let batch = null;
    const sent = await this.actions.attempt('change', async () => {
      for (const [k, file] of wanted.entries()) {
        for (let at = 0; at === 0 || at < file.size; at += PIECE) {
          const say = part('sending');
          if (say) say.textContent = `Sending ${file.name} (${k + 1} of ${wanted.length}), ${Math.round(100 * at / (file.size || 1))} %`;
          ({ batch } = await ask('upload', { batch, name: file.webkitRelativePath || file.name, at, data: await base64(file.slice(at, at + PIECE)) }));
        }
      }
      return true;
    });
    if (part('sending')) part('sending').textContent = '';
    return sent && this.open({ batch });
  }

  async open(body) {
    await this.actions.perform('recordings', body);
    this.choose(nextStep(this.state));
  }

  async useRecorded() {
    await this.open({ recorded: true });
    this.actions.openTab('steps');
  }

  async begin(stage, options) {
    const { perform, attempt } = this.actions;
    if (stage === 'accept') {
      await perform('accept');
      return this.choose('compare');
    }
    if (stage === 'export') {
      const found = await attempt('change', () => ask('export'));
      if (found) this.exported = found;
      return this.choose('export');
    }
    this.chosen = stage;
    this.actions.setView('data');
    await perform('start', { stage, options });
    part('detail').scrollIntoView({ block: 'start' }); // where its figure grows
    return null;
  }

  /** The job whose result a stage shows. */
  jobOf(stage) {
    const { steps } = this.state;
    return stage === 'candidates' ? steps.candidates : steps.stages.find((one) => one.stage === stage)?.job ?? null;
  }

  async detail() {
    const stage = this.chosen, box = part('detail'), job = stage && this.jobOf(stage);
    if (stage === 'export' && this.exported?.number === this.state.history.current) return showExport(box, this.exported);
    if (!job || stage === 'export') return box.replaceChildren(...this.untaken(), ...this.columnsPart(false));
    const found = await this.resultOf(job);
    if (!found || this.chosen !== stage) return null;
    if (job.state === 'running') this.events = found.events;
    keepFocus(box, () => showResult(box, job.stage, found, this.resultActions(job, found)));
    if (job.state !== 'running') box.append(...this.columnsPart(job.state === 'failed' || found.result?.notes?.some((note) => note.includes('columns not used'))));
    return null;
  }

  /** What can be done with what came out of a step, and what is known of its channels and effects. */
  resultActions(job, found) {
    const { controls, channels } = this.state;
    return {
      events: () => (job.state === 'running' ? this.events : found.events), labels: (channel) => channels[channel]?.deviation ?? { factor: 1, unit: '(SI)' },
      moveLimit: (limit) => this.moveLimit(job.stage, limit), holdOut: (names) => this.actions.perform('recordings', { hold_out: names }), tried: this.page.tried?.name ?? null,
      tryEffect: (effect) => this.tryEffect(effect), keepEffect: (effect) => this.actions.perform('change', () => ({ ...this.with(effect), expected: this.state.history.current })),
      unitOf: (effect, name) => controls.effects.find((one) => one.name === effect)?.parameters.find((one) => one.label === name) ?? { power: 0, unit: '' },
    };
  }

  /** Write the limit at which an estimate ended into the options of its step, where it can be changed. */
  moveLimit(stage, { name, low, high }) {
    const chosen = this.options[stage] ??= {};
    const others = (chosen.limits ?? '').split(',').map((word) => word.trim()).filter((word) => word && !word.startsWith(`${name}=`));
    chosen.limits = [...others, `${name}=${[low, high].map((end) => Number(end.toPrecision(6))).join(':')}`].join(', ');
    this.actions.openTab('steps');
    this.show();
    const options = document.querySelector(`[data-options=${stage}]`);
    options.open = true;
    options.querySelector('[data-option=limits]').focus();
  }

  /** Which column of the files is which, below what was read; `open` where that is likely to be asked. */
  columnsPart(open) {
    if (this.chosen !== 'check' || !this.state.steps.data) return [];
    const place = element('div'), details = element('details', { id: 'columns', open }, element('summary', { textContent: 'Columns of the files' }), place);
    const load = async () => {
      const found = place.childElementCount ? null : await this.actions.attempt('columns', () => ask('columns'));
      if (found) showColumns(place, found, (columns) => this.useColumns(columns));
    };
    details.addEventListener('toggle', () => { if (details.open) load(); });
    if (open) load();
    return [details];
  }

  async useColumns(columns) {
    const state = await this.actions.attempt('columns', () => ask('choose_columns', { columns }));
    if (!state) return;
    await this.actions.load();
    await this.begin('check', {});
  }

  /** What is said before a step was taken: what it does, and what comes first. */
  untaken() {
    const { data, stages } = this.state.steps, words = (textContent) => element('p', { className: 'note', textContent });
    if (!data) return [words('No recordings yet: choose the files of your robot under Steps.')];
    const { reason } = stages.find((one) => one.stage === this.chosen) ?? { reason: '' };
    if (this.chosen !== 'check') {
      const first = reason ? `Not yet: ${reason}.` : 'It has not been taken yet: its button is under Steps.';
      return [element('h2', { textContent: TITLES[this.chosen] }), element('p', { textContent: PURPOSES[this.chosen] ?? '' }), words(first)];
    }
    const names = data.data.map((path) => path.split(/[\\/]/).at(-1));
    const held = data.hold_out.length ? ` Held out: ${data.hold_out.map((path) => path.split(/[\\/]/).at(-1)).join(', ')}.` : '';
    return [element('h2', { textContent: 'Recordings' }), element('ul', {}, ...names.map((textContent) => element('li', { textContent }))),
      words(`They have not been checked yet.${held}`)];
  }

  async resultOf(job) {
    const key = `${job.number} ${job.state}`;
    if (!this.results.has(key) || job.state === 'running') {
      const found = await this.actions.attempt('job', () => ask('job', { number: job.number, since: 0, result: job.state !== 'running' }));
      if (!found) return null;
      this.results.set(key, found);
      if (this.results.size > RESULTS_KEPT) this.results.delete(this.results.keys().next().value);
    }
    return this.results.get(key);
  }

  /** Look at an effect with the values that explain most, without a version. */
  tryEffect(effect) {
    this.page.tried = effect && { name: effect.name, ...this.with(effect) };
    this.detail();
    this.actions.refresh();
  }

  with(effect) {
    return {
      effects: [...this.state.controls.active, effect.name],
      values: Object.fromEntries(Object.entries(effect.values).map(([name, value]) => [`effects.${effect.name}.${name}`, value])),
    };
  }

  /** A version with what has changed on a robot: an effect, or other values of parameters. */
  useCause({ name, values }) {
    const effects = Object.keys(values).some((one) => one.startsWith('effects.')) ? [...this.state.controls.active, name] : this.state.controls.active;
    return this.actions.perform('change', () => ({ values, effects, expected: this.state.history.current }));
  }

  /** A step that runs is asked how it proceeds, until it has ended. */
  poll() {
    this.polling = setTimeout(async () => {
      const { running } = this.state.steps, { attempt, load, refresh, again } = this.actions;
      const seen = running?.stage === this.chosen;
      const found = running && await attempt('job', () => ask('job', { number: running.number, since: seen ? this.events.length : 0 }));
      this.polling = 0;
      if (!running) return;
      if (!found) { setTimeout(() => { if (!this.polling) this.poll(); }, AFTER_FAILURE); return; }
      if (found.job.state === 'running') {
        this.progress(running, found, seen);
        this.poll();
        return;
      }
      await load();
      refresh();
      again();
    }, PERIOD);
  }

  progress(running, { job, events }, seen) {
    Object.assign(running, { words: job.words, seconds: job.seconds });
    if (seen) this.events = [...this.events, ...events];
    const known = partDone(seen ? this.events : []), left = known ? `; about ${duration(Math.max(1, Math.round(known.left)), 0)} left` : '';
    const say = (what, textContent) => {
      for (const one of document.querySelectorAll(`[data-stage="${running.stage}"] .${what}${seen ? `, #detail .${what}` : ''}`)) one.textContent = textContent;
    };
    say('words', job.words);
    say('elapsed', `${duration(job.seconds)}${left}`);
    if (known) for (const bar of document.querySelectorAll(`[data-stage="${running.stage}"] progress`)) Object.assign(bar, { max: known.total, value: known.done });
    if (!seen || !events.length) return;
    redrawFigure(part('detail'), running.stage, this.events);
    showCandidatesSoFar(part('detail'), this.events, this.resultActions(job, null));
  }

  redraw() {
    const job = this.state && this.chosen && this.jobOf(this.chosen);
    if (job) redrawFigure(part('detail'), job.stage, job.state === 'running' ? this.events : this.results.get(`${job.number} ${job.state}`)?.events ?? []);
  }
}
