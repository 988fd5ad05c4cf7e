import { post } from "./api.js";
import { $, setText } from "./dom.js";

const token = new URLSearchParams(location.search).get("token") || "";
// The token stays out of the history and of screenshots of the address bar.
history.replaceState(null, "", "/first");

try {
  const { name } = await post("/api/first/look", { token: token || "-" });
  setText($("title"), name ? `Welcome, ${name}` : "Welcome");
  setText($("lead"), name ? "Choose your password." : "You are the first here: choose name and password of the admin.");
  $("name-field").hidden = Boolean(name);
  $("name").required = !name;
  if (name) $("name").value = name;
  $("form").hidden = false;
  (name ? $("password") : $("name")).focus();
} catch (error) {
  setText($("spent-text"), error.message);
  $("spent").hidden = false;
}

$("show").addEventListener("change", () => { $("password").type = $("show").checked ? "text" : "password"; });

$("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  setText($("problem"), "");
  try {
    await post("/api/first", { token, name: $("name").value, password: $("password").value });
    location.replace("/");
  } catch (error) {
    setText($("problem"), error.message);
    $("password").focus();
  }
});
