import { get, post } from "./api.js";
import { $, setText } from "./dom.js";

/** Where to go afterwards: a page of this console, and nothing else. */
function next() {
  const wanted = new URLSearchParams(location.search).get("next") || "/";
  return /^\/[a-z-]*$/.test(wanted) ? wanted : "/";
}

// Somebody who comes by a link from elsewhere may be signed in already: the cookie is not sent on that first step.
fetch("/api/session", { cache: "no-store" }).then((answer) => { if (answer.ok) location.replace(next()); });

$("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  setText($("problem"), "");
  try {
    await post("/api/sign-in", { name: $("name").value, password: $("password").value });
    await get("/api/session");
    location.replace(next());
  } catch (error) {
    setText($("problem"), error.message);
    $("password").select();
  }
});
