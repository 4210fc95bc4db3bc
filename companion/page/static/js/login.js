// Login and logout; a token in the address, as the demo prints it, is used once and removed.

import { byId, setText } from "./dom.js";

export class Login {
  /** @param {() => void} onChange open the connection again, with other rights */
  constructor(onChange) {
    this.onChange = onChange;
    this.box = byId("login-box");
    byId("login").addEventListener("click", () => this.ask());
    byId("login-close").addEventListener("click", () => this.box.close());
    byId("logout").addEventListener("click", async () => {
      await post("/logout", {});
      this.onChange();
    });
    byId("login-form").addEventListener("submit", (/** @type {Event} */ event) => {
      event.preventDefault();
      this.send({ password: byId("password").value });
    });
  }

  /** Show the box. @param {string} [says] */
  ask(says = "") {
    setText(byId("login-says"), says);
    if (!this.box.open) this.box.showModal();
    byId("password").focus();
  }

  /** Use the token in the address, if there is one. */
  async useToken() {
    const token = new URLSearchParams(location.hash.slice(1)).get("token");
    if (token === null) return;
    history.replaceState(null, "", location.pathname);
    const says = await post("/login", { token });
    if (says !== "") this.ask(says);
  }

  /** @param {object} secret */
  async send(secret) {
    const says = await post("/login", secret);
    setText(byId("login-says"), says);
    byId("password").value = "";
    if (says !== "") return;
    this.box.close();
    this.onChange();
  }
}

/**
 * Post JSON; return why it failed, empty if it did not.
 * @param {string} path @param {object} body
 */
async function post(path, body) {
  try {
    const answer = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      credentials: "same-origin",
      body: JSON.stringify(body),
    });
    if (answer.ok) return "";
    const said = await answer.json().catch(() => ({}));
    return said.error ?? `refused (${answer.status})`;
  } catch {
    return "no connection to the page's server";
  }
}
