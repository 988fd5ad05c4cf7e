import { get, inTurn, patch, post } from "./api.js";
import { $, ago, badge, el, setText, tableRow } from "./dom.js";
import { sure } from "./form.js";
import { ready, start } from "./shell.js";
import { attempt } from "./toast.js";

const ROLES = ["viewer", "editor", "technician", "admin"];
let deeds = [];
let asked = { who: "", action: "" };
await start();

const refresh = inTurn(async () => {
  const [{ users }, { tokens }] = await Promise.all([get("/api/users"), get("/api/tokens"), showAudit()]);
  $("people").replaceChildren(...users.map(personRow));
  $("no-tokens").hidden = tokens.length > 0;
  $("tokens-wrap").hidden = tokens.length === 0;
  $("tokens").replaceChildren(...tokens.map(tokenRow));
});
await refresh();

/** Show the newest deeds that were asked for; those before the last one that is shown as well, where `older`. */
async function showAudit({ older = false } = {}) {
  const wanted = asked;
  const before = older && deeds.length ? { before: deeds.at(-1).id } : {};
  const { audit, has_older } = await get(`/api/audit?${new URLSearchParams({ ...wanted, ...before })}`);
  if (wanted !== asked) return;
  deeds = older ? [...deeds, ...audit] : audit;
  $("audit").replaceChildren(...deeds.map(deedRow));
  $("no-audit").hidden = deeds.length > 0;
  $("older-audit").hidden = !has_older;
}

function deedRow({ at_s, who, action, detail }) {
  return tableRow(el("td", { class: "when" }, new Date(at_s * 1000).toLocaleString()), el("td", {}, who),
    el("td", {}, action.replaceAll("_", " "), el("span", { class: "narrow-only small quiet" }, detail)), el("td", { class: "quiet small wide" }, detail));
}

const doing = (work) => attempt(async () => { await work(); await refresh(); });

function personRow(user) {
  const role = el("select", { "aria-label": `Role of ${user.name}`, onchange: async () => {
    if (!(await doing(() => patch(`/api/users/${user.id}`, { role: role.value })))) role.value = user.role;
  } }, ...ROLES.map((name) => el("option", {}, name)));
  role.value = user.role;
  let state = badge("good", "●", "active");
  if (user.disabled) state = badge("bad", "✕", "locked");
  else if (!user.has_password) state = badge("info", "…", "invited");
  return tableRow(el("th", { scope: "row" }, user.name), el("td", {}, role), el("td", {}, state), el("td", { class: "actions" },
    el("button", { type: "button", class: "plain slim", "aria-label": `New password link for ${user.name}`, onclick: () => newLink(user) }, "Password link"),
    el("button", { type: "button", class: `plain slim ${user.disabled ? "" : "danger"}`, "aria-label": `${user.disabled ? "Unlock" : "Lock"} ${user.name}`, onclick: () => lock(user) }, user.disabled ? "Unlock" : "Lock")));
}

async function lock(user) {
  const wanted = user.disabled || (await sure({
    title: `Lock ${user.name}?`, text: `${user.name} is signed out everywhere at once, and cannot sign in until an admin unlocks them.`, yes: "Lock",
  }));
  if (wanted) await doing(() => patch(`/api/users/${user.id}`, { disabled: !user.disabled }));
}

async function revokeToken({ name }) {
  const text = `The device ${name} is cut off at once: nobody can watch its walker or speak to them, until the device is given a new token. It cannot be taken back.`;
  if (await sure({ title: `Revoke the token of ${name}?`, text, yes: "Revoke" })) await doing(() => post("/api/tokens/revoke", { name }));
}

function tokenRow(token) {
  const seen = token.connected ? "connected now" : token.last_seen_at_s ? ago(Date.now() / 1000 - token.last_seen_at_s) : "never";
  const state = token.revoked ? badge("bad", "✕", "revoked") : badge("good", "●", "valid");
  const revoke = el("button", { type: "button", class: "plain danger slim", "aria-label": `Revoke the token of ${token.name}`, onclick: () => revokeToken(token) }, "Revoke");
  return tableRow(el("th", { scope: "row" }, token.name), el("td", { class: "wide" }, token.created_by), el("td", {}, seen), el("td", {}, state),
    el("td", { class: "actions" }, token.revoked ? "" : revoke));
}

function showSecret(text, value) {
  setText($("secret-text"), text);
  $("secret-value").value = value;
  $("secret").hidden = false;
  $("secret-value").focus();
  $("secret-value").select();
}

$("secret-copy").addEventListener("click", async () => {
  $("secret-value").select();
  await navigator.clipboard?.writeText($("secret-value").value).catch(() => {});
  setText($("secret-copy"), "Copied");
  setTimeout(() => setText($("secret-copy"), "Copy"), 2000);
});

function newLink(user) {
  return doing(async () => {
    const { link } = await post(`/api/users/${user.id}/link`);
    showSecret(`Give this link to ${user.name}: it sets a new password, once, within 48 hours.`, link);
  });
}

function form(id, problem, work) {
  $(id).addEventListener("submit", async (event) => {
    event.preventDefault();
    setText($(problem), "");
    try {
      await work();
      $(id).reset();
      await refresh();
    } catch (error) {
      setText($(problem), error.message);
    }
  });
}

form("invite-form", "invite-problem", async () => {
  const { user, link } = await post("/api/users", { name: $("invite-name").value, role: $("invite-role").value });
  showSecret(`Give this link to ${user.name}: it lets them choose a password, once, within 48 hours.`, link);
});

form("token-form", "token-problem", async () => {
  const { name, token } = await post("/api/tokens", { name: $("token-name").value });
  showSecret(`This is the token of ${name}. It is shown only now; an earlier one of this name is void.`, token);
});

$("audit-form").addEventListener("submit", (event) => {
  event.preventDefault();
  asked = { who: $("audit-who").value.trim(), action: $("audit-action").value.trim() };
  attempt(() => showAudit());
});
$("older-audit").addEventListener("click", () => attempt(() => showAudit({ older: true })));

ready();
