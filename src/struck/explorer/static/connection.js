/** The way to the server: the room, news of it, models and what changes do to them. */

/** A refusal of the server, or no answer at all; the message is for a person. */
export class ConnectionError extends Error {
  /**
   * @param {string} message
   * @param {string} [id] under which it is shown, where it may come from several sides
   */
  constructor(message, id) {
    super(message);
    this.id = id;
  }
}

const WAIT = 500; // ms that a blow waits for the server
const AGAIN = 3000; // ms until the next try to follow the news
const GONE = 'lost'; // id of messages that the server is out of reach
const LOST = 'the server does not answer: start struck explore again, and open the address that it prints. What is here still sounds.';
const STRANGER = 'this page belongs to a struck explore that has ended: reload with the new address, which struck explore has printed. What is here still sounds.';
const FORBIDDEN = 403; // to whom the server does not know

/**
 * Ask the server, and return its answer.
 * @param {string} path
 * @param {RequestInit} [options]
 * @returns {Promise<Response>}
 */
async function ask(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new ConnectionError(LOST, GONE);
  }
  if (answer.ok) return answer;
  if (answer.status === FORBIDDEN) throw new ConnectionError(STRANGER, GONE);
  const text = await answer.text();
  let message = text.trim();
  try {
    message = JSON.parse(text).message;
  } catch { /* not every refusal is JSON */ }
  throw new ConnectionError(message || `the server refused ${path} (${answer.status})`);
}

/** Return the objects as they stand, strikers and materials. */
export async function fetchRoom() {
  return (await ask('api/room')).json();
}

/** Return the bytes of an object's model file. */
export async function fetchModel(id) {
  return (await ask(`models/${encodeURIComponent(id)}.struck`)).arrayBuffer();
}

/** Return what another material, size or damping does to an object, as `facts.change` tells it. */
export async function fetchChange(id, wanted) {
  return (await ask(`api/models/${encodeURIComponent(id)}/change`, {
    method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(wanted),
  })).json();
}

/** Return the drive of an object's modes at a place of the body as it was computed, within `WAIT`. */
export async function fetchDrive(id, { point, direction }) {
  const { drive } = await (await ask(`api/models/${encodeURIComponent(id)}/drive`, {
    method: 'POST',
    headers: { 'content-type': 'application/json' },
    body: JSON.stringify({ point, direction }),
    signal: AbortSignal.timeout(WAIT),
  })).json();
  return drive;
}

/**
 * Follow the news of objects until the page is left.
 * @param {(told: object) => void} changed called with each object that changed
 * @param {(error: ConnectionError | null) => void} connected called when the connection is lost,
 *   with the reason, and with null when it is there
 */
export function follow(changed, connected) {
  const news = new EventSource('api/events');
  const leave = () => news.close();
  news.onmessage = (event) => changed(JSON.parse(event.data));
  news.onopen = () => connected(null);
  news.onerror = async () => {
    removeEventListener('pagehide', leave);
    news.close();
    // News say nothing of why they ended: a plain question does.
    const error = await fetchRoom().then(() => null, (reason) => reason);
    connected(error);
    setTimeout(() => follow(changed, connected), AGAIN);
  };
  addEventListener('pagehide', leave);
}
