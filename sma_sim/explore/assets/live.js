// A robot that runs, beside the model: what it measures, what the model shows, the normalized RMSE; recordings of it.

import { Chart } from './chart.js';
import { element } from './controls.js';
import { ask } from './requests.js';

const PERIOD = 300; // [ms] between two questions
const SHOWN = 60; // [s]
const KEPT = 1500; // samples
const COLOURS = ['#1f6fb4', '#c4561a', '#2f8f4e', '#8a4fb0', '#7a6a00'];
const RUNS = ['starting', 'waiting for joint_states', 'burn-in', 'comparing'];

export class RobotView {
  /** `actions`: attempt(what, action), version(), labels(channel), recorded(). */
  constructor(parent, actions) {
    this.parent = parent;
    this.actions = actions;
    this.samples = [];
    this.next = 0;
    this.changes = 0;
    this.timer = 0;
    this.charts = new Map();
    this.state = { state: 'off', problems: [], recording: { path: '', messages: 0, failed: '' }, model: { version: null, failed: '' } };
    this.build();
  }

  build() {
    const namespace = element('input', { type: 'text', placeholder: 'none', id: 'namespace' }), domain = element('input', { type: 'number', min: '0', max: '232', placeholder: 'as set', id: 'domain' });
    this.start = element('button', { type: 'button', className: 'primary', textContent: 'Listen', id: 'listen' });
    this.stop = element('button', { type: 'button', textContent: 'End', id: 'listen-end' });
    this.record = element('button', { type: 'button', textContent: 'Record', id: 'record' });
    this.use = element('button', { type: 'button', textContent: 'Use the recordings', id: 'use-recorded' });
    this.words = element('p', { role: 'status', id: 'robot-state' });
    this.problems = element('ul', { className: 'problem', id: 'robot-problems' });
    this.recording = element('p', { className: 'note', id: 'robot-recording' });
    this.cause = element('div', { id: 'robot-cause' });
    this.grid = element('div', { id: 'robot-grid' });
    this.start.addEventListener('click', () => this.ask('live_start', { namespace: namespace.value.trim(), domain: domain.value === '' ? null : Number(domain.value) }));
    this.stop.addEventListener('click', () => this.ask('live_stop'));
    this.record.addEventListener('click', async () => {
      const on = this.state.recording.path === '';
      await this.ask('record', { on });
      if (!on) setTimeout(() => this.actions.recorded(), 500);
    });
    this.use.addEventListener('click', () => this.actions.useRecorded());
    this.parent.replaceChildren(element('div', { className: 'bar' }, element('h2', { textContent: 'Robot beside the model' }),
      element('label', {}, 'namespace ', namespace), element('label', {}, 'ROS domain ', domain), this.start, this.stop, this.record, this.use),
    element('p', { className: 'note', textContent: 'Listens to the topics of a robot or a simulating node (joint_states, its command, ...) and runs the current version of the model under the same command: what you change under Parameters or Effects acts at once, also on what was measured before. For a recording to improve the model with, begin while the robot is at rest.' }),
    this.words, this.problems, this.recording, this.cause, this.grid);
    this.show();
  }

  async ask(verb, body = {}) {
    const found = await this.actions.attempt(verb, () => ask(verb, body));
    if (!found) return;
    if (verb === 'live_start') { this.samples = []; this.next = 0; this.changes = 0; }
    this.take({ ...found, samples: [], next: this.next, model: { ...found.model, changes: this.changes } }); // samples come with the next question
    this.wake();
  }

  /** Ask as long as the view is seen and somebody listens. */
  wake() {
    clearTimeout(this.timer);
    if (this.parent.hidden) return;
    this.timer = setTimeout(async () => {
      const found = await this.actions.attempt('live', () => ask('live', { since: this.next }));
      if (found) this.take(found);
      this.wake();
    }, RUNS.includes(this.state.state) ? PERIOD : 2000);
  }

  take(found) {
    const { changes = 0 } = found.model ?? {};
    if (found.next < this.next || changes !== this.changes) this.samples = []; // another beginning, by another tab, or another model
    this.changes = changes;
    if (found.samples.length && found.next > this.next) this.samples = [...this.samples, ...found.samples].slice(-KEPT);
    this.next = found.next;
    this.state = found;
    this.show();
  }

  show() {
    const { state, problems, recording, model, channels = [] } = this.state, runs = RUNS.includes(state);
    this.start.disabled = runs;
    this.stop.disabled = !runs;
    this.record.disabled = !runs || state === 'starting';
    this.record.textContent = recording.path ? 'Stop the recording' : 'Record';
    this.record.setAttribute('aria-pressed', String(recording.path !== ''));
    this.use.hidden = this.actions.recordedCount() === 0;
    this.use.disabled = recording.path !== '';
    this.words.textContent = { off: 'Not listening.', ended: 'Listening has ended; what was heard stays.', failed: 'Listening has failed.' }[state] ?? `${state}${model?.version ? ` with version ${model.version}` : ''}; ${this.state.compared ?? 0} samples compared`;
    const failed = runs && model?.failed ? [`The current version cannot be run beside the robot, version ${model.version} stays: ${model.failed}`] : [];
    this.problems.replaceChildren(...[...failed, ...problems].map((textContent) => element('li', { textContent })));
    this.recording.textContent = recording.failed ? `Not recorded: ${recording.failed}` : recording.path ? `Recording to ${recording.path}: ${recording.messages} messages` : '';
    this.showCauses();
    this.draw(channels);
  }

  /** What has changed on the robot, how probable it is over time, and a version with it. */
  showCauses() {
    const { causes = [], channels = [] } = this.state, last = causes[causes.length - 1], told = JSON.stringify(last?.stamp ?? null);
    if (this.toldCause === told) return;
    this.toldCause = told;
    if (!last || !channels.length) { this.cause.replaceChildren(); return; }
    const best = last.causes[0]?.is_listed ? last.causes[0] : null, words = element('p', { role: 'status', textContent: last.changed ? `The robot has ${last.words}.` : `Cause of a deviation: ${last.words}.` });
    const parts = [words];
    if (last.changed && best) {
      const make = element('button', { type: 'button', id: 'use-cause', textContent: `Make a version with ${best.name}` });
      make.addEventListener('click', () => this.actions.useCause(best));
      parts.push(make);
    }
    this.cause.replaceChildren(...parts);
    if (!causes.some((one) => one.changed)) return;
    const names = [...new Set(causes.flatMap((one) => one.causes.filter((cause) => cause.probability > 0.02 && cause.name !== 'nothing').map((cause) => cause.name)))].slice(0, 5);
    const begin = causes[0].stamp - last.stamp, chart = new Chart(this.cause, 'time');
    chart.set({
      label: 'Probability of each cause; time before now [s]', range: [Math.min(begin, -1), 0], height: [0, 1.05],
      curves: names.map((name, k) => ({ factor: 1, offset: 0, label: name, colour: COLOURS[k], x: causes.map((one) => one.stamp - last.stamp), y: causes.map((one) => one.probabilities[name] ?? 0) })),
    });
    chart.draw();
  }

  draw(channels) {
    if (!this.samples.length) return;
    const end = this.samples[this.samples.length - 1].stamp, shown = this.samples.filter((one) => one.stamp > end - SHOWN);
    const time = (one) => one.stamp - end, range = [Math.max(-SHOWN, time(shown[0])) - 0.1, 0];
    const curve = (name, k, more) => {
      const known = shown.filter((one) => one[name][k] !== null);
      return { factor: 1, offset: 0, label: '', x: known.map(time), y: known.map((one) => one[name][k]), ...more };
    };
    channels.forEach((channel, k) => {
      const { label, factor, offset, colour } = this.actions.labels(channel), si = { factor, offset };
      if (!shown.some((one) => one.measured[k] !== null)) return;
      this.chart(channel).set({ label: `${label}: measured and model; time before now [s]`, range, curves: [curve('measured', k, { ...si, colour: '', thin: true }), curve('model', k, { ...si, colour })] });
      this.chart(`${channel} error`).set({ label: `${channel}: normalized RMSE`, range, shade: [0, 1], curves: [curve('error', k, { colour })] });
    });
    for (const chart of this.charts.values()) chart.draw();
  }

  chart(id) {
    if (!this.charts.has(id)) this.charts.set(id, new Chart(this.grid, 'time'));
    return this.charts.get(id);
  }
}
