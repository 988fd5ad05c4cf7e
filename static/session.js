/* Who was signed in here when the console was asked last: what a page shows before it answers. */

const KNOWN = "session";

/** What is known of the session; empty before the first answer. */
export function knownSession() {
  return JSON.parse(sessionStorage.getItem(KNOWN) ?? "{}");
}

export function keepSession(session) {
  sessionStorage.setItem(KNOWN, JSON.stringify(session));
}
