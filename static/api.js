/* Asking the console: JSON in and out; what is refused is an Error with the console's own sentence. */

export class Refused extends Error {
  constructor(sentence, status) {
    super(sentence);
    this.status = status;
  }
}

export async function ask(method, path, body) {
  const options = { method, headers: {}, cache: "no-store", credentials: "same-origin" };
  if (body !== undefined) {
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Refused("The console does not answer: see whether it is running.", 0);
  }
  const data = await answer.json().catch(() => ({}));
  if (answer.ok) return data;
  if (answer.status === 401 && path !== "/api/sign-in") signInAgain();
  throw new Refused(data.error || `The console answered ${answer.status}.`, answer.status);
}

export const get = (path) => ask("GET", path);
export const post = (path, body) => ask("POST", path, body);
export const patch = (path, body) => ask("PATCH", path, body);

let leaving = false;

/** The session has ended: sign in, and come back here. */
export function signInAgain() {
  if (leaving) return;
  leaving = true;
  location.assign(`/signin?next=${encodeURIComponent(location.pathname)}`);
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
