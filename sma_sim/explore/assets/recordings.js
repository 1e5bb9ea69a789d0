// All recordings beside the model: a chart for each channel of each run, normalized RMSE, and what a part of a residual is.

import { Chart } from './chart.js';
import { element } from './controls.js';
import { digits, errorCell, showRegion, table } from './results.js';
import { ask } from './requests.js';

const part = (id) => document.getElementById(id);
const SHOWN_AT_FIRST = 3; // runs
const NEAR = 0.03; // of a run, on both sides of a click

export class RecordingsView {
  /** `actions`: refresh(), attempt(what, action), startCandidates(). */
  constructor(actions) {
    this.actions = actions;
    this.charts = new Map();
    this.window = null;
    this.runs = null;
    this.marked = null;
    this.forget();
    part('drawn').addEventListener('change', () => actions.refresh());
    part('run').addEventListener('change', () => actions.refresh());
    part('whole-data').addEventListener('click', () => this.zoom(null));
  }

  get residuals() { return part('drawn').value === 'residuals'; }

  /** What is asked for beside the model. */
  request() {
    const widths = [...this.charts.values()].map((chart) => chart.pixels), pixels = widths.length ? Math.max(...widths) : 500;
    this.asked = JSON.stringify([this.window, pixels, part('run').value]);
    const curves = this.residuals ? ['residual'] : this.asked === this.kept ? ['model'] : ['measured', 'model'];
    return { window: this.window, pixels, curves };
  }

  /** What was measured is asked for once, as long as the same part of it is shown. */
  forget() {
    this.kept = null;
    this.measured = new Map();
  }

  zoom(range) {
    this.window = range;
    part('whole-data').hidden = range === null;
    this.actions.refresh();
  }

  show({ content, numbers }) {
    this.exact = content.exact;
    const drawn = Object.values(content.runs[0]?.channels ?? {})[0] ?? {};
    if (!this.residuals !== !('residual' in drawn)) return; // the choice was changed meanwhile: another answer comes
    if ('measured' in drawn) this.keep(content.runs, numbers);
    part('grid-view').hidden = false;
    this.offerRuns(content.runs);
    this.showErrors(content);
    const chosen = part('run').value, used = new Set();
    const runs = content.runs.filter((run, k) => chosen === run.name || (chosen === '' && k < SHOWN_AT_FIRST) || chosen === '*');
    part('grid').style.setProperty('--runs', String(Math.min(runs.length, SHOWN_AT_FIRST)));
    for (const channel of content.channels) for (const run of runs) if (channel.name in run.channels) {
      const id = `${run.name}|${channel.name}`;
      used.add(id);
      this.chart(id, run, channel).set(this.shown(run, channel, numbers));
    }
    let changed = false;
    for (const [id, chart] of this.charts) if (!used.has(id)) { chart.box.remove(); this.charts.delete(id); changed = true; }
    if (changed || used.size !== this.order?.length) this.arrange([...used]);
    this.draw();
  }

  keep(runs, numbers) {
    const place = ([x, y]) => ({ x: numbers(x).slice(), y: numbers(y).slice() });
    this.measured = new Map(runs.flatMap((run) => Object.entries(run.channels).map(([name, curves]) => [`${run.name}|${name}`, place(curves.measured)])));
    this.kept = this.asked;
  }

  draw() { for (const chart of this.charts.values()) chart.draw(); }

  arrange(order) {
    this.order = order;
    for (const id of order) part('grid').append(this.charts.get(id).box);
  }

  chart(id, run, channel) {
    if (!this.charts.has(id)) {
      const at = (time) => { for (const [other, chart] of this.charts) if (other.startsWith(`${run.name}|`)) { chart.cursor = time; chart.draw(); } };
      const explain = (range, byKey) => this.explain({ run: run.name, channel: channel.name, range }, byKey);
      const near = (time) => { const span = NEAR * (this.charts.get(id).x[1] - this.charts.get(id).x[0]); return [time - span, time + span]; };
      this.charts.set(id, new Chart(part('grid'), 'time', {
        point: at, zoom: (range, byKey) => (this.residuals ? explain(range, byKey) : this.zoom(range)), whole: () => this.zoom(null),
        pick: (time, byKey) => (this.residuals ? explain(near(time), byKey) : at(time)),
      }));
    }
    return this.charts.get(id);
  }

  shown(run, channel, numbers) {
    const curves = run.channels[channel.name], place = ([x, y]) => ({ x: numbers(x), y: numbers(y) });
    const error = run.errors[channel.name] === undefined ? '' : `, ${digits(run.errors[channel.name], 3)} \u00d7 noise`;
    const held = run.held_out ? ' (held out)' : '', si = { factor: channel.factor, offset: channel.offset };
    const range = this.window ?? [run.begin, run.end];
    const mark = this.marked?.run === run.name && this.marked.channel === channel.name ? this.marked.range : null;
    if (this.residuals) {
      return { label: `${run.name}${held} ${channel.name} / noise${error}`, range, mark, shade: [-2, 2], curves: [{ factor: 1, offset: 0, colour: channel.colour, label: '', ...place(curves.residual) }] };
    }
    const beside = run.beside?.[channel.name];
    const measured = this.measured.get(`${run.name}|${channel.name}`); // not there while it is asked for anew
    return { label: `${run.name}${held} ${channel.label}${error}`, range, mark, curves: [
      ...(measured ? [{ ...si, colour: '', thin: true, label: '', ...measured }] : []),
      ...(beside ? [{ ...si, colour: channel.colour, beside: true, label: '', ...place(beside.model) }] : []),
      { ...si, colour: channel.colour, label: '', ...place(curves.model) }] };
  }

  offerRuns(runs) {
    const names = runs.map((run) => run.name).join('|');
    if (this.runs === names) return;
    this.runs = names;
    const first = runs.length > SHOWN_AT_FIRST ? [['', `the first ${SHOWN_AT_FIRST}`], ['*', 'all']] : [['', 'all']];
    part('run').replaceChildren(...[...first, ...runs.map((run) => [run.name, run.name])].map(([value, textContent]) => element('option', { value, textContent })));
  }

  estimating(begins) { if (begins) part('basis').textContent = 'Estimating delay and start of each run for this model \u2026'; }

  showErrors(content) {
    const { channels, runs, parts, error } = content, names = channels.map((one) => one.name);
    const row = (title, errors, all) => [title, ...names.map((name) => errorCell(errors[name])), errorCell(all)];
    const held = Object.keys(parts.held_out).length > 0;
    const rows = [...runs.map((run) => row(run.name + (run.held_out ? ' (held out)' : ''), run.errors, run.error)),
      row(held ? 'fitted runs' : 'all runs', parts.train, error.train), ...(held ? [row('held-out runs', parts.held_out, error.held_out)] : [])];
    part('errors').replaceChildren(table(['normalized RMSE', ...names, 'all'], rows, 'Normalized RMSE: 1 is as large as the noise'));
    part('basis').textContent = content.exact ? 'The numbers of sma-sim compare.'
      : 'Preview: delay and start of each run are those of the model before; they are estimated anew once nothing moves.';
    part('basis').append(this.residuals ? ' Grey: \u00b12. Click on a part of a residual to see what happens there; by keys: Tab to a chart, arrows, Enter.' : ' Black or white: measured; coloured: model. Drag across a curve to look closer.');
    part('basis').classList.toggle('preview', !content.exact);
    part('grid-title').textContent = this.residuals ? 'Residual (measured \u2212 model) over noise' : 'Measured and model';
  }

  /** Say what happens in a part of a residual; who came there by keys is led to the answer, and back. */
  async explain(marked, byKey = false) {
    this.marked = marked;
    const { run, channel, range: [t0, t1] } = marked;
    const found = await this.actions.attempt('part', () => ask('part', { run, channel, t0, t1 }));
    if (!found) return;
    this.region(found);
    if (byKey) part('region').focus();
  }

  region(found) {
    const range = [found.t0, found.t1], id = `${found.run}|${found.channel}`;
    this.mark(id, range);
    showRegion(part('region'), found, {
      switchOn: () => this.actions.startCandidates(), closer: () => this.zoom(range),
      close: () => { this.marked = null; part('region').hidden = true; this.mark(id, null); this.charts.get(id)?.canvas.focus({ preventScroll: true }); },
    });
    part('region').scrollIntoView({ block: 'nearest' });
  }

  mark(id, range) {
    for (const [other, chart] of this.charts) { chart.mark = other === id ? range : null; chart.draw(); }
  }

  /** Explain the marked part again, as when effects were switched on meanwhile. */
  again() { if (this.marked && !part('region').hidden) this.explain(this.marked); }
}
