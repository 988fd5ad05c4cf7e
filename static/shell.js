/* What all pages share: the header with the pages that there are for a role, who is signed in and who else is here, help,
 * and the way out. The header is there before the console has answered: it shows what was known last. */

import { alertHead, alertSoundLine, watchAlerts } from "./alert-head.js";
import { get, signOut } from "./api.js";
import { $, el, setText } from "./dom.js";
import { fullDiskLine, watchDisk } from "./full-disk.js";
import { openHelp } from "./help.js";
import { keepSession, knownSession } from "./session.js";
import { attempt } from "./toast.js";

const EDITING = ["editor", "admin"];
const TUNING = ["technician", "admin"];
const MAPPING = [...EDITING, "technician"];
/** All pages, by what people come for. The console tells which of them it has, and this role may open. */
const PAGES = [
  ["Watch", [["/", "Console"], ["/overview", "Overview"], ["/alerts", "Alerts"], ["/walks", "Walks"]]],
  ["Map", [["/pois", "Places"], ["/versions", "Versions"], ["/checks", "Checks"], ["/rehearse", "Rehearse"], ["/exchange", "Import/export"], ["/map-walks", "Map walks"]]],
  ["Set up", [["/settings", "Settings"], ["/privacy", "Privacy"], ["/admin", "Admin"]]],
];

build();
show(knownSession());
addEventListener("error", sayItFailed);
addEventListener("unhandledrejection", (event) => sayItFailed({ error: event.reason }));

/** Fill the header and return who is signed in, with what the role may do (the console checks it again). */
export async function start() {
  const session = await get("/api/session");
  keepSession(session);
  show(session);
  watchAlerts();
  watchDisk();
  return { ...session, mayEdit: EDITING.includes(session.role), mayTune: TUNING.includes(session.role), mayMap: MAPPING.includes(session.role) };
}

/** The page is whole: until now nothing on it could be pressed, for nothing would have happened. */
export function ready() {
  removeEventListener("error", sayItFailed);
  document.body.inert = false;
}

function build() {
  const nav = el("nav", { id: "pages", "aria-label": "Pages" }, ...PAGES.map(pageGroup));
  const here = PAGES.flatMap(([, pages]) => pages).find(([path]) => path === location.pathname);
  const menu = el("button", { type: "button", class: "menu slim", "aria-expanded": "false", "aria-controls": "pages" }, here ? `Pages: ${here[1]}` : "Pages");
  menu.addEventListener("click", () => menu.setAttribute("aria-expanded", String(nav.classList.toggle("open"))));
  const brand = el("a", { class: "brand", href: "/" }, el("img", { src: "/static/icon.svg", alt: "" }),
    el("span", {}, "Virtual blind road", el("span", { class: "site", id: "site-name" })));
  const who = el("div", { class: "who" },
    el("span", {}, el("span", { id: "user-name" }), " ", el("span", { class: "role", id: "user-role" })),
    el("button", { type: "button", class: "plain slim", id: "help", "aria-haspopup": "dialog", onclick: () => openHelp() }, "Help"),
    el("button", { type: "button", class: "plain slim", id: "sign-out", onclick: () => attempt(signOut) }, "Sign out"));
  document.querySelector("header.top").append(brand, menu, nav, alertHead(), who);
  document.querySelector("header.top").after(
    el("div", { class: "banner", id: "link-banner", role: "alert", hidden: true }), fullDiskLine(), alertSoundLine(), el("p", { class: "people", id: "also-here", role: "status", hidden: true }));
  document.body.append(el("div", { class: "toasts", id: "toasts", role: "status", "aria-live": "polite" }));
}

function pageGroup([title, pages], index) {
  const id = `pages-${index}`;
  return el("div", { class: "page-group", role: "group", "aria-labelledby": id }, el("span", { class: "page-group-title", id }, title), el("ul", {}, ...pages.map(pageItem)));
}

function pageItem([path, title]) {
  return el("li", { "data-page": path }, el("a", { href: path, "aria-current": path === location.pathname && "page" }, title));
}

function show({ site = "", name = "", role = "", pages = [location.pathname] }) {
  setText($("site-name"), site);
  setText($("user-name"), name);
  setText($("user-role"), role);
  for (const item of document.querySelectorAll("#pages [data-page]")) item.hidden = !pages.includes(item.dataset.page);
  for (const group of document.querySelectorAll("#pages .page-group")) group.hidden = !group.querySelector("[data-page]:not([hidden])");
}

function sayItFailed({ error, message }) {
  if (!document.body.inert) return;
  const again = el("button", { type: "button", onclick: () => location.reload() }, "Load it again");
  $("main").prepend(el("p", { class: "note bad", role: "alert" }, `This page could not be started. ${error?.message ?? message} `, again));
  ready();
}
