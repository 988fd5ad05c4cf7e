/* The alerts of all devices as they come from the console, for whatever shows them on a page: one stream for all. */

import { isSignedOut, signInAgain } from "./api.js";
import { PageClock } from "./page_clock.js";

const RETRY_MS = [500, 1000, 2000, 4000];
const SILENT_AFTER_S = 6;
const TICK_MS = 500;
const SIGNED_OUT = 4401;

const listeners = new Set();
let alerts = null;
let fullDisk = null;
const clock = new PageClock(); // what came before the computer slept is as old as the sleep was long
let receivedAt_s = clock.now_s(); // until then: when the page began to listen
let failures = 0;
let started = false;

/** Call `show(alerts, elapsed_s, known, fullDisk)` at each message and twice a second: `alerts` is null before the first message, `elapsed_s` is how long
 *  ago it came (add it to every age), and `known` is false once the console has gone silent: nobody knows then whether there are others.
 *  `fullDisk` is null where the disk of the console's machine has room. */
export function onAlerts(show) {
  listeners.add(show);
  begin();
  tell(show);
}

function begin() {
  if (started) return;
  started = true;
  connect();
  setInterval(tellAll, TICK_MS);
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const socket = new WebSocket(`${scheme}://${location.host}/live/alerts`);
  let opened = false;
  socket.onopen = () => { opened = true; failures = 0; };
  socket.onmessage = ({ data }) => {
    const told = JSON.parse(data);
    fullDisk = told.full_disk;
    take(told.alerts);
  };
  socket.onclose = async ({ code }) => {
    if (code === SIGNED_OUT) return signInAgain();
    if (!opened && (await isSignedOut())) return signInAgain();
    setTimeout(connect, RETRY_MS[Math.min(failures++, RETRY_MS.length - 1)]);
  };
}

/** Take in what the console says: on the stream, or in answer to what somebody did here. */
export function take(fresh) {
  alerts = fresh;
  receivedAt_s = clock.now_s();
  tellAll();
}

function tellAll() {
  for (const show of listeners) tell(show);
}

function tell(show) {
  const elapsed_s = clock.now_s() - receivedAt_s;
  show(alerts, elapsed_s, alerts !== null && elapsed_s < SILENT_AFTER_S, fullDisk);
}
