// Which column of the files is which: for files whose columns have other names or units than ours.

import { element } from './controls.js';

/** Show the choices in `found` (columns of the files, and for each of ours column, unit, factor); `use(columns)` takes them. */
export function showColumns(parent, found, use) {
  if (!found.columns.length) {
    parent.replaceChildren(element('p', { className: 'note', textContent: found.file ? 'The map of these files says more than can be chosen here: change it, and choose it again with the files.' : 'These are bags: their topics say what is what.' }));
    return;
  }
  const rows = found.ours.map((one) => row(one, found.columns));
  const apply = element('button', { type: 'button', className: 'primary', id: 'use-columns', textContent: 'Use these columns' });
  apply.addEventListener('click', () => use(Object.fromEntries(rows.map((each) => each.read()).filter(Boolean))));
  const head = element('tr', {}, ...['', `column of ${found.file}`, 'its unit', 'times'].map((textContent) => element('th', { scope: 'col', textContent })));
  parent.replaceChildren(
    element('p', { className: 'note', textContent: 'On the left what the model knows, with its unit; * is a must. Choose the column of your files that holds it, and its unit; what was not measured stays empty.' }),
    element('div', { className: 'scroll results' }, element('table', {}, element('thead', {}, head), element('tbody', {}, ...rows.map((each) => each.line)))), apply);
}

function row(one, columns) {
  const named = (control, what) => { control.setAttribute('aria-label', `${one.name}: ${what}`); return control; };
  const column = named(element('select', {}, ...['', ...columns].map((name) => element('option', { value: name, textContent: name || '\u2013' }))), 'column');
  const unit = named(element('select', {}, ...one.units.map((name) => element('option', { value: name, textContent: name }))), 'unit');
  const factor = named(element('input', { type: 'number', step: 'any', value: String(one.factor) }), 'factor');
  column.value = one.column;
  unit.value = one.unit;
  const line = element('tr', {}, element('th', { scope: 'row' }, element('code', { textContent: `${one.name}${one.needed ? ' *' : ''}` }), ` ${one.meaning}`), ...[column, unit, factor].map((cell) => element('td', {}, cell)));
  line.dataset.column = one.name;
  return { line, read: () => (column.value ? [one.name, { column: column.value, unit: unit.value, factor: Number(factor.value) }] : null) };
}
