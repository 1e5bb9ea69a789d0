// Controls are made anew when the state changes: who was at one of them is there again, with what he was typing.

const REACHED = 'a[href], button, input, select, summary, canvas, [tabindex]';
const ROWS = '[data-name], [data-effect], [data-stage], [data-version]';

/** What tells a control from the others of its panel, also when it is made anew. */
function keyOf(one) {
  if (one.dataset.key) return one.dataset.key;
  const row = one.closest(ROWS), of = row && (row.dataset.name ?? row.dataset.effect ?? row.dataset.stage ?? row.dataset.version);
  return [of ?? '', one.tagName, one.type ?? '', one.ariaLabel ?? '', one.labels?.[0]?.textContent ?? '', one.tagName === 'INPUT' ? '' : one.textContent].join('|');
}

/** Render anew what is in `parent`; the focus stays on the same control, or on the next one that can have it. */
export function keepFocus(parent, render) {
  const active = document.activeElement;
  if (!active || active === parent || !parent.contains(active)) return render();
  const all = () => [...parent.querySelectorAll(REACHED)], usable = (one) => !one.disabled && one.offsetParent !== null;
  const key = keyOf(active), place = all().indexOf(active), { typed, value } = active;
  const found = render(), now = all(), same = now.find((one) => usable(one) && keyOf(one) === key);
  const next = same ?? now.slice(place).find(usable) ?? now.findLast(usable);
  if (same && typed) Object.assign(same, { typed, value });
  if (document.activeElement !== next) next?.focus({ preventScroll: true });
  return found;
}

document.addEventListener('input', ({ target }) => { if (target.matches('input[type="text"], input[type="number"]')) target.typed = true; }, true);
document.addEventListener('change', ({ target }) => { target.typed = false; }, true);
