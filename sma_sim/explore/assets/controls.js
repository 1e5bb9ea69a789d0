// Parameters as sliders with their units, effects as switches.

const STEPS = 1000;

/** An element with properties and children. */
export function element(name, properties = {}, ...children) {
  const found = Object.assign(document.createElement(name), properties);
  found.append(...children);
  return found;
}

/** A number with its power of ten moved, exactly: what is read in GPa as Pa and back. */
export function shifted(number, power) {
  const [digits, exponent = '0'] = String(number).split('e');
  return Number(`${digits}e${Number(exponent) + power}`);
}

/** A number with at most six digits, short enough for its box. */
function brief(number) {
  const found = Number(number.toPrecision(6));
  return found !== 0 && Math.abs(found) < 1e-4 ? found.toExponential() : String(found);
}

const text = (parameter, value) => (value === null ? '' : brief(shifted(value, -parameter.power)));

const MOVING_KEYS = ['ArrowUp', 'ArrowDown', 'ArrowLeft', 'ArrowRight', 'PageUp', 'PageDown', 'Home', 'End'];

/**
 * One parameter. `actions`: preview(name, value) while its slider moves, commit(name, value, byKey) once it is let go, which a
 * key does with every press, and moved(name), the value to which it was moved and which is no version yet.
 */
export function parameterControl(parameter, { preview, commit, moved }) {
  const { name, label, low, high } = parameter;
  const slider = element('input', { type: 'range', min: '0', max: String(STEPS), step: '1' });
  const box = element('input', { type: 'number', step: 'any', placeholder: 'automatic' });
  const reset = element('button', { type: 'button', className: 'reset', textContent: '\u21ba', title: `Back to ${text(parameter, parameter.default) || 'automatic'} ${parameter.unit}` });
  const described = `${label}: ${parameter.meaning}`;
  slider.setAttribute('aria-label', described);
  box.setAttribute('aria-label', `${described}, in ${parameter.unit}`);
  reset.setAttribute('aria-label', `${label}: ${reset.title}`);
  const shown = (value) => (value === null ? 0 : STEPS * (value - low) / (high - low || 1));
  const chosen = () => {
    const step = Number(slider.value);
    if (step === 0 || step === STEPS) return step ? high : low;
    return Number((low + step / STEPS * (high - low)).toPrecision(5));
  };
  const show = (value, withSlider = true) => {
    if (withSlider) slider.value = String(shown(value));
    box.value = text(parameter, value);
    slider.setAttribute('aria-valuetext', `${box.value} ${parameter.unit}`);
    row.classList.toggle('changed', value !== parameter.default);
  };
  let key = '';
  slider.addEventListener('input', () => { show(chosen(), false); preview(name, chosen()); });
  slider.addEventListener('change', () => commit(name, chosen(), key !== ''));
  box.addEventListener('change', () => {
    commit(name, box.value === '' ? parameter.default : shifted(box.value, parameter.power), key !== '');
  });
  for (const one of [slider, box]) {
    one.addEventListener('keydown', (event) => { key = MOVING_KEYS.includes(event.key) ? event.key : ''; });
    one.addEventListener('pointerdown', () => { key = ''; });
  }
  reset.addEventListener('click', () => commit(name, parameter.default));
  const unit = parameter.unit === '-' ? '' : parameter.unit;
  const bounds = `allowed ${text(parameter, parameter.least)} to ${text(parameter, parameter.most)} ${unit}`
    + (parameter.neutral === null ? '' : `; no effect at ${text(parameter, parameter.neutral)}`)
    + (parameter.source ? `; default from: ${parameter.source}` : '');
  const row = element('div', { className: 'parameter' },
    element('span', { className: 'meaning' }, element('b', { textContent: label }), ` ${parameter.meaning}`),
    slider, element('span', { className: 'value' }, box, ' ', element('span', { className: 'unit', textContent: unit }), reset),
    element('span', { className: 'bounds', textContent: bounds }));
  row.dataset.name = name;
  show(moved(name) ?? parameter.value);
  return row;
}

const GROUPS = { wire: 'Wire', beam: 'Beam', plate: 'Plate', environment: 'Environment', initial: 'Start', solver: 'Solver' };

/** All parameters, by group. */
export function showParameters(parent, groups, actions) {
  const closed = new Set([...parent.querySelectorAll('details:not([open])')].map((one) => one.dataset.group));
  const first = !parent.childElementCount;
  parent.replaceChildren(...groups.map((group, k) => {
    const heading = GROUPS[group.name] ?? group.name;
    const found = element('details', { open: first ? k < 3 : !closed.has(group.name) }, element('summary', { textContent: heading }),
      ...group.parameters.map((parameter) => parameterControl(parameter, actions)));
    found.dataset.group = group.name;
    return found;
  }));
}

/** All effects, by port: `actions` are those of parameters, and change(names) with the names of those that are to be active. */
export function showEffects(parent, { effects, active }, actions) {
  const open = new Set([...parent.querySelectorAll('.effect details[open]')].map((one) => one.closest('.effect').dataset.effect));
  const found = [];
  let port = '';
  for (const effect of effects) {
    if (effect.port !== port) found.push(element('h2', { textContent: port = effect.port }));
    found.push(effectControl(effect, active, open.has(effect.name), actions));
  }
  parent.replaceChildren(...found);
}

function effectControl(effect, active, open, actions) {
  const on = active.includes(effect.shown);
  const others = active.filter((name) => name !== effect.shown);
  const box = element('input', { type: 'checkbox', checked: on });
  box.addEventListener('change', () => actions.change(box.checked ? [...active, effect.shown] : others));
  const about = element('details', { open }, element('summary', { textContent: 'equation and source' }),
    element('p', {}, element('code', { textContent: effect.equation })),
    ...[effect.description, effect.source && `Source: ${effect.source}`, effect.signature && `Trace in measurements: ${effect.signature}`,
      effect.same_as && `Not distinguishable from: ${effect.same_as}`].filter(Boolean).map((words) => element('p', { textContent: words })));
  const row = element('div', { className: 'effect' }, element('label', {}, box, `${effect.title[0].toUpperCase()}${effect.title.slice(1)} `), element('code', { className: 'small', textContent: effect.name }), about);
  row.dataset.effect = effect.name;
  if (!on) return row;
  if (effect.scopes.length) {
    const where = element('select', {}, element('option', { value: effect.name, textContent: 'everywhere' }),
      ...effect.scopes.map((scope) => element('option', { value: scope.name, textContent: scope.words })));
    where.value = effect.shown;
    where.addEventListener('change', () => actions.change([...others, where.value]));
    row.append(element('label', { className: 'field' }, 'acts ', where));
  }
  row.append(...effect.parameters.map((parameter) => parameterControl(parameter, actions)));
  return row;
}
