/* Asking the console: JSON in and out; what is refused is an Error with the console's own sentence. */

class Refused extends Error {
  /** `details` is all that the console answered, as both versions of a conflict. */
  constructor(sentence, status, details = {}) {
    super(sentence);
    this.status = status;
    this.details = details;
  }
}

/** What is said of a request that the console did not answer. */
export const SILENT = "The console does not answer: see whether it is running. Nothing that you typed here is lost.";

const ASK_AGAIN_MS = 700;
const ASKED_AGAIN_COUNT = 4;

export async function ask(method, path, body, { key = "" } = {}) {
  const options = { method, headers: {}, cache: "no-store", credentials: "same-origin" };
  if (key) options.headers["Idempotency-Key"] = key;
  if (body !== undefined) {
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  const answer = await answered(path, options, key ? ASKED_AGAIN_COUNT : 0);
  return taken(path, answer.status, await answer.json().catch(() => ({})));
}

/** Where the console is being started anew, what has a key is asked again: nobody knows whether it was done, and it is not done twice. */
async function answered(path, options, again_count) {
  try {
    return await fetch(path, options);
  } catch {
    if (again_count === 0) throw new Refused(SILENT, 0);
  }
  await new Promise((resolve) => setTimeout(resolve, ASK_AGAIN_MS));
  return answered(path, options, again_count - 1);
}

/** A key that no other request has. */
function newKey() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

function taken(path, status, data) {
  if (status >= 200 && status < 300) return data;
  if (status === 401 && path !== "/api/sign-in") signInAgain();
  throw new Refused(data.error || `The console answered ${status}.`, status, data);
}

/** Send a file, as it is; `tell(share)` hears how much of it has gone, 0–1. */
export function sendFile(path, file, tell, { key = "" } = {}) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    if (key) request.setRequestHeader("Idempotency-Key", key);
    request.upload.onprogress = ({ loaded, total }) => tell(total ? loaded / total : null);
    request.onerror = () => reject(new Refused(SILENT, 0));
    request.onload = () => {
      let data = {};
      try { data = JSON.parse(request.responseText); } catch { /* the status says enough */ }
      try { resolve(taken(path, request.status, data)); } catch (error) { reject(error); }
    };
    request.send(file);
  });
}

export const get = (path) => ask("GET", path);
export const post = (path, body) => ask("POST", path, body);
const unheard = new Map();

/** Ask with a key of its own. Whoever asks the same again, for no answer came, asks with the same key; whoever asks twice before the first
 *  answer, as for two steps back, means two. */
async function once(request, act) {
  const key = unheard.get(request) ?? newKey();
  unheard.delete(request);
  try {
    return await act(key);
  } catch (error) {
    if (error.status === 0) unheard.set(request, key);
    throw error;
  }
}

/** The same for what must not be done twice: an edit, an undo. */
export const postOnce = (path, body) => once(`${path} ${JSON.stringify(body)}`, (key) => ask("POST", path, body, { key }));

/** A file that must not be taken in twice. */
export const sendFileOnce = (path, file, tell) => once(`${path} ${file.name} ${file.size} ${file.lastModified}`, (key) => sendFile(path, file, tell, { key }));
export const patch = (path, body) => ask("PATCH", path, body);

/** Get what a part of the console answers that may not be there; null where it is not. */
export async function getIfThere(path) {
  try {
    return await get(path);
  } catch (error) {
    if (error.status === 404) return null;
    throw error;
  }
}

/** Do `work` once at a time, and once more where it was asked for meanwhile: of two answers, the one that overtakes the other would
 *  otherwise be shown, and be old. The promise is kept when the last of it is done. */
export function inTurn(work) {
  let isDue = false;
  let going = null;
  const go = async () => {
    try {
      while (isDue) {
        isDue = false;
        await work();
      }
    } finally {
      going = null;
    }
  };
  return () => {
    isDue = true;
    going ??= go();
    return going;
  };
}

let leaving = false;

/** The session has ended: sign in, and come back here. */
export function signInAgain() {
  if (leaving) return;
  leaving = true;
  location.assign(`/signin?next=${encodeURIComponent(location.pathname)}`);
}

/** Whether the session is over, asked where a socket was refused: why is not told to scripts. */
export async function isSignedOut() {
  const answer = await fetch("/api/session", { cache: "no-store" }).catch(() => null);
  return answer !== null && answer.status === 401;
}

/** Sign out for good. The console ends the live socket meanwhile, which must not lead to another page at the same time. */
export async function signOut() {
  leaving = true;
  try {
    await post("/api/sign-out");
  } catch (error) {
    leaving = false;
    if (error.status !== 401) throw error;
  }
  location.assign("/signin");
}
