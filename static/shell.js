/* What all pages share: the header with the pages that a role may see, who is signed in and who else is here, help,
 * and the way out. The header is there before the console has answered: it shows what was known last. */

import { get, signOut } from "./api.js";
import { $, el, setText } from "./dom.js";
import { openHelp } from "./help.js";
import { attempt } from "./toast.js";

const EDITING = ["editor", "admin"];
const TUNING = ["technician", "admin"];
const MAPPING = [...EDITING, "technician"];
const PAGES = [
  { path: "/", title: "Console" },
  { path: "/pois", title: "Places" },
  { path: "/versions", title: "Versions" },
  { path: "/checks", title: "Checks" },
  { path: "/rehearse", title: "Rehearse" },
  { path: "/exchange", title: "Import/export" },
  { path: "/map-walks", title: "Map walks", roles: MAPPING },
  { path: "/settings", title: "Settings" },
  { path: "/admin", title: "Admin", roles: ["admin"] },
];
const KNOWN = "session";

build();
show(JSON.parse(sessionStorage.getItem(KNOWN) ?? "{}"));
addEventListener("error", sayItFailed);
addEventListener("unhandledrejection", (event) => sayItFailed({ error: event.reason }));

/** Fill the header and return who is signed in, with what the role may do (the console checks it again). */
export async function start() {
  const session = await get("/api/session");
  sessionStorage.setItem(KNOWN, JSON.stringify(session));
  show(session);
  return { ...session, mayEdit: EDITING.includes(session.role), mayTune: TUNING.includes(session.role), mayMap: MAPPING.includes(session.role) };
}

/** The page is whole: until now nothing on it could be pressed, for nothing would have happened. */
export function ready() {
  removeEventListener("error", sayItFailed);
  document.body.inert = false;
}

function build() {
  const nav = el("nav", { id: "pages", "aria-label": "Pages" }, el("ul", {}, ...PAGES.map(pageItem)));
  const here = PAGES.find(({ path }) => path === location.pathname);
  const menu = el("button", { type: "button", class: "menu slim", "aria-expanded": "false", "aria-controls": "pages" }, `Pages: ${here?.title ?? ""}`);
  menu.addEventListener("click", () => menu.setAttribute("aria-expanded", String(nav.classList.toggle("open"))));
  const brand = el("a", { class: "brand", href: "/" }, el("img", { src: "/static/icon.svg", alt: "" }),
    el("span", {}, "Virtual blind road", el("span", { class: "site", id: "site-name" })));
  const who = el("div", { class: "who" },
    el("span", {}, el("span", { id: "user-name" }), " ", el("span", { class: "role", id: "user-role" })),
    el("button", { type: "button", class: "plain slim", id: "help", "aria-haspopup": "dialog", onclick: () => openHelp() }, "Help"),
    el("button", { type: "button", class: "plain slim", id: "sign-out", onclick: () => attempt(signOut) }, "Sign out"));
  document.querySelector("header.top").append(brand, menu, nav, who);
  document.querySelector("header.top").after(
    el("div", { class: "banner", id: "link-banner", role: "alert", hidden: true }), el("p", { class: "people", id: "also-here", role: "status", hidden: true }));
  document.body.append(el("div", { class: "toasts", id: "toasts", role: "status", "aria-live": "polite" }));
}

function pageItem({ path, title, roles }) {
  const here = path === location.pathname;
  return el("li", { "data-roles": roles?.join(" "), hidden: Boolean(roles) }, el("a", { href: path, "aria-current": here && "page" }, title));
}

function show({ site = "", name = "", role = "" }) {
  setText($("site-name"), site);
  setText($("user-name"), name);
  setText($("user-role"), role);
  for (const item of document.querySelectorAll("#pages [data-roles]")) item.hidden = !item.dataset.roles.split(" ").includes(role);
}

function sayItFailed({ error, message }) {
  if (!document.body.inert) return;
  const again = el("button", { type: "button", onclick: () => location.reload() }, "Load it again");
  $("main").prepend(el("p", { class: "note bad", role: "alert" }, `This page could not be started. ${error?.message ?? message} `, again));
  ready();
}
