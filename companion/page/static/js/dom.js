// Small helpers around the document. Text from outside only ever becomes a text node, never markup.

const SVG = "http://www.w3.org/2000/svg";

/**
 * Return the element with an id that index.html has.
 * @param {string} id
 * @returns {any}
 */
export function byId(id) {
  const node = document.getElementById(id);
  if (node === null) throw new Error(`index.html has no #${id}`);
  return node;
}

/**
 * Make an element with a class and a text.
 * @param {string} tag
 * @param {string} [className]
 * @param {string} [text]
 * @returns {any}
 */
export function make(tag, className = "", text = "") {
  const node = document.createElement(tag);
  if (className !== "") node.className = className;
  if (text !== "") node.textContent = text;
  return node;
}

/**
 * Make one of the symbols of index.html.
 * @param {string} name
 */
export function symbol(name) {
  const svg = document.createElementNS(SVG, "svg");
  const use = document.createElementNS(SVG, "use");
  svg.setAttribute("aria-hidden", "true");
  use.setAttribute("href", `#s-${name}`);
  svg.append(use);
  return svg;
}

/**
 * Change a text only if it differs, so that a screen reader is not told the same again.
 * @param {Element} node
 * @param {string} text
 */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/**
 * Change an attribute only if it differs.
 * @param {Element} node
 * @param {string} name
 * @param {string} value
 */
export function setAttribute(node, name, value) {
  if (node.getAttribute(name) !== value) node.setAttribute(name, value);
}

/**
 * Change the symbol that an element shows first.
 * @param {Element} node
 * @param {string} name
 */
export function setSymbol(node, name) {
  const use = node.querySelector("use");
  if (use !== null) setAttribute(use, "href", `#s-${name}`);
}

/**
 * Show or hide an element.
 * @param {HTMLElement} node
 * @param {boolean} shown
 */
export function show(node, shown) {
  if (node.hidden === shown) node.hidden = !shown;
}

/**
 * Fill a list with rows, only if their key has changed.
 * @param {any} node
 * @param {string} key
 * @param {() => Node[]} rows
 */
export function fill(node, key, rows) {
  if (node.filledWith === key) return;
  node.filledWith = key;
  node.replaceChildren(...rows());
}

/**
 * Fill a select with names; its choice stays where it can.
 * @param {any} select
 * @param {readonly string[]} names
 * @param {string} [none] text of an empty choice before the names
 */
export function fillSelect(select, names, none = "") {
  const chosen = select.value;
  fill(select, JSON.stringify([none, ...names]), () => {
    const options = names.map((name) => new Option(name, name));
    return none === "" ? options : [new Option(none, ""), ...options];
  });
  if (chosen !== "" && names.includes(chosen)) select.value = chosen;
}

/**
 * Keep an element at the bottom of what is seen, in its usual size, when the page is zoomed or a keyboard covers a part.
 * @param {HTMLElement} node at the bottom of the page as it is laid out
 */
export function keepInSight(node) {
  const seen = window.visualViewport;
  if (!seen) return;
  let [right, down] = [0, 0];
  const place = () => {
    const box = node.getBoundingClientRect();
    right += seen.offsetLeft - box.left;
    down += seen.offsetTop + seen.height - box.bottom;
    if (seen.scale === 1) [right, down] = [0, Math.min(0, Math.round(down))]; // not below a short page's end
    const moved = seen.scale !== 1 || down !== 0;
    node.style.transform = moved ? `translate(${right}px, ${down}px) scale(${1 / seen.scale})` : "";
  };
  for (const event of ["resize", "scroll"]) seen.addEventListener(event, place);
  addEventListener("scroll", place, { passive: true });
}
