// Light, dark, or as the device says; and the colours that canvases draw with.

import { byId, setText } from "./dom.js";

const CHOICES = ["auto", "light", "dark"];
const KEY = "companion.theme";

/** @type {Record<string, string>} */
let colours = {};

/** Return a colour of the style sheet by its name without dashes. @param {string} name */
export function colour(name) {
  if (colours[name] === undefined) {
    colours[name] = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  }
  return colours[name];
}

/** Apply the remembered choice and let the button change it. @param {() => void} onChange */
export function startTheme(onChange) {
  const button = byId("theme");
  const apply = (/** @type {string} */ choice) => {
    document.documentElement.dataset.theme = choice;
    setText(button, choice[0].toUpperCase() + choice.slice(1));
    button.setAttribute("aria-label", `Colours: ${choice}`);
    colours = {};
    onChange();
  };
  const remembered = remember();
  apply(CHOICES.includes(remembered) ? remembered : "auto");
  button.addEventListener("click", () => {
    const next = CHOICES[(CHOICES.indexOf(document.documentElement.dataset.theme ?? "auto") + 1) % CHOICES.length];
    remember(next);
    apply(next);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    colours = {};
    onChange();
  });
}

/** Read or write the choice; a browser that keeps nothing for pages is no error. @param {string} [choice] */
function remember(choice) {
  try {
    if (choice !== undefined) localStorage.setItem(KEY, choice);
    return localStorage.getItem(KEY) ?? "";
  } catch {
    return "";
  }
}
