// What goes to the server and comes back: JSON, or JSON with the numbers of curves behind it.

/** Ask for a verb; the answer as an object, in which `[first, count]` stand for numbers (see `numbers`). Throws Error with words for the user. */
export async function ask(verb, body = {}) {
  let answer;
  try {
    answer = await fetch(`/api/${verb}`, {
      method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body),
    });
  } catch {
    throw new Error('The program does not answer: has sma-sim explore been ended? Start it again; every version is kept.');
  }
  if (!answer.ok) throw new Error(await answer.text());
  if ((answer.headers.get('Content-Type') ?? '').startsWith('application/json')) {
    const found = await answer.json();
    if ('refused' in found) throw new Error(found.refused);
    return found;
  }
  return unpacked(await answer.arrayBuffer());
}

/** A packed message: `content`, and `numbers(place)` for the numbers at a place of it. */
export function unpacked(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const content = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const numbers = ([first, count]) => new Float64Array(buffer, 4 + length + 8 * first, count);
  return { content, numbers };
}
