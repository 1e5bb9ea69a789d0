// The command editor: steps, a sine, a file.

import { element } from './controls.js';

const HELP = {
  steps: 'Each row holds from its time on; an imposed strain, stress or temperature goes straight to the next row. The last row is the end.',
  sine: 'One column swings about its mean, the others stay as in the first row of the steps.',
  file: 'A CSV file with a header, such as time_s,J_eq_W: what sma-sim simulate --input reads.',
};

/** Show the editor of a command; `set(command)` is called with a changed one. */
export function showCommand(parent, command, columns, set) {
  const kinds = element('select', { id: 'kind' }, ...Object.keys(HELP).map((kind) => element('option', { value: kind, textContent: kind })));
  kinds.value = command.kind;
  kinds.addEventListener('change', () => {
    if (kinds.value === 'file' && !command.text) showCommand(parent, { ...command, kind: 'file' }, columns, set);
    else set({ ...command, kind: kinds.value });
  });
  parent.replaceChildren(element('label', { className: 'field' }, 'What is imposed ', kinds),
    element('p', { className: 'note', textContent: HELP[command.kind] }), ...EDITORS[command.kind](command, columns, set));
}

const EDITORS = {
  steps(command, columns, set) {
    const table = element('table', {}, element('tr', {}, ...['time [s]', ...columns.map(withUnit), ''].map((name) => element('th', { textContent: name }))));
    const change = (rows) => set({ ...command, rows, duration: rows[rows.length - 1][0] || command.duration });
    command.rows.forEach((row, k) => {
      const cells = row.map((value, column) => {
        const box = number(value, `row ${k + 1}, ${column ? columns[column - 1] : 'time_s'}`, (given) => {
          change(command.rows.map((one, n) => (n === k ? one.map((old, m) => (m === column ? given : old)) : one)));
        });
        return element('td', {}, box);
      });
      const remove = element('button', { type: 'button', textContent: '\u2212', title: `Remove row ${k + 1}`, disabled: command.rows.length < 3 });
      remove.addEventListener('click', () => change(command.rows.filter((_, n) => n !== k)));
      table.append(element('tr', {}, ...cells, element('td', {}, remove)));
    });
    const add = element('button', { type: 'button', textContent: 'Add a row' });
    add.addEventListener('click', () => {
      const last = command.rows[command.rows.length - 1];
      change([...command.rows, [last[0] + 20, ...last.slice(1)]]);
    });
    return [element('div', { className: 'scroll' }, table), add];
  },
  sine(command, columns, set) {
    const column = element('select', {}, ...columns.map((name) => element('option', { value: name, textContent: withUnit(name) })));
    column.value = command.column;
    column.addEventListener('change', () => set({ ...command, column: column.value }));
    const fields = [['mean', 'offset'], ['amplitude', 'amplitude'], ['period [s]', 'period'], ['duration [s]', 'duration']];
    return [element('label', { className: 'field' }, 'column ', column), ...fields.map(([label, name]) => element('label', { className: 'field' },
      `${label} `, number(command[name], label, (given) => set({ ...command, [name]: given }))))];
  },
  file(command, columns, set) {
    const chosen = element('input', { type: 'file', accept: '.csv,text/csv' });
    chosen.setAttribute('aria-label', 'CSV file with the command');
    chosen.addEventListener('change', async () => {
      const [file] = chosen.files;
      if (file) set({ ...command, kind: 'file', name: file.name, text: await file.text() });
    });
    return [chosen, element('p', { className: 'note', textContent: command.name ? `Now: ${command.name}` : `It needs time_s and ${columns.join(', ')}.` })];
  },
};

function withUnit(column) {
  const cut = column.lastIndexOf('_');
  return cut > 0 ? `${column.slice(0, cut)} [${column.slice(cut + 1)}]` : `${column} [-]`;
}

function number(value, label, change) {
  const box = element('input', { type: 'number', step: 'any', value: String(value) });
  box.setAttribute('aria-label', label);
  box.addEventListener('change', () => { if (box.value !== '') change(Number(box.value)); });
  return box;
}
