// The versions of the model: go to one, name it, look at it beside the current one.

import { element } from './controls.js';

/** Show all versions, the newest first. */
export function showHistory(parent, history, beside, { go, rename, compare, differences }) {
  const list = element('ol', {}, ...[...history.versions].reverse().map((version) => {
    const current = version.number === history.current;
    const name = element('input', { type: 'text', value: version.name, placeholder: 'name it' });
    name.setAttribute('aria-label', `Name of version ${version.number}`);
    name.addEventListener('change', () => rename(version.number, name.value));
    const visit = element('button', { type: 'button', textContent: current ? 'current' : 'Go to', disabled: current });
    visit.addEventListener('click', () => go(version.number));
    const shown = beside === version.number;
    const look = element('button', { type: 'button', textContent: shown ? 'Shown dashed' : 'Compare', disabled: current && !shown });
    look.setAttribute('aria-pressed', String(shown));
    look.addEventListener('click', () => compare(shown ? null : version.number));
    const entry = element('li', { className: current ? 'current' : '' }, element('b', { textContent: `${version.number} ` }), version.words,
      element('div', {}, visit, look, name));
    entry.dataset.version = version.number;
    return entry;
  }));
  const table = element('div', { id: 'differences' });
  parent.replaceChildren(element('p', { className: 'note', textContent: `Kept in ${history.folder}` }), table, list);
  if (beside !== null && beside !== history.current) differences(beside, history.current).then((found) => table.replaceChildren(differenceTable(found, beside, history.current)));
}

function differenceTable(found, before, after) {
  const shown = (value) => (value === null ? '\u2013' : typeof value === 'number' ? String(Number(value.toPrecision(6))) : String(value));
  if (!found.length) return element('p', { className: 'note', textContent: `Versions ${before} and ${after} are equal.` });
  return element('table', {}, element('tr', {}, ...['', `version ${before}`, `version ${after}`].map((name) => element('th', { textContent: name }))),
    ...found.map((one) => element('tr', { title: one.meaning }, element('td', {}, element('code', { textContent: one.name })),
      element('td', { textContent: shown(one.before) }), element('td', { textContent: `${shown(one.after)} ${one.unit}` }))));
}
