// Puts the page together: messages go into the fleet and the commands, and what they hold is shown.

import { Camera } from "./camera.js";
import { Cards } from "./cards.js";
import { Commands } from "./commands.js";
import { Controls } from "./controls.js";
import { byId, keepInSight, setAttribute, setSymbol, setText, show } from "./dom.js";
import { Fleet } from "./fleet.js";
import { Kill } from "./kill.js";
import { Link } from "./link.js";
import { showChecks, showLinks, showLog } from "./lists.js";
import { Login } from "./login.js";
import { showNow } from "./now.js";
import { drawPlan, placeOf } from "./plan.js";
import { drawPlots, makePlots } from "./plots.js";
import { drawScene } from "./scene.js";
import { showStale } from "./stale.js";
import { startTheme } from "./theme.js";

/** A tick also shows that nothing comes. */
const TICK_MS = 50;
const QUIET_MS = 240;
/** Ages in milliseconds cannot be read faster. */
const LINKS_MS = 300;
/** Least time between two drawings of what comes ten times a second: the page may share a computer with a flight. */
const REST_MS = 90;
/** Messages that wait for the next drawing; all others are drawn at once. */
const ROUTINE = ["state", "beat"];

const fleet = new Fleet();
const link = new Link(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`, take, changed);
const commands = new Commands(link, wake);
const login = new Login(() => link.restart());
const controls = new Controls(fleet, commands, allowed);
const cards = new Cards(fleet, wake);
const camera = new Camera(byId("scene"), () => drawScene(byId("scene"), fleet, camera, follow));
const kill = new Kill(() => fleet.focusName, commands, allowed, () => fleet.vehicles.size > 1);
const plots = makePlots(byId("plots"));
let follow = false;
let asked = 0;
let drawnMs = 0;
let soon = false;
let linksMs = -Infinity;

/** Take one message of the server. @param {any} message */
function take(message) {
  if (["reply", "error", "confirm"].includes(message.type)) commands.take(message);
  else fleet.take(message);
  if (message.type === "reply" && message.verb === "preflight") keepChecks(message);
  if (!ROUTINE.includes(message.type)) wake();
  else if (message.type === "state") soon = true;
}

/** Keep the list of a preflight, also while it runs. @param {any} reply */
function keepChecks(reply) {
  const vehicle = fleet.vehicle(reply.vehicle);
  const running = reply.answer === "accepted" || reply.answer === "progress";
  const checks = reply.data?.checks ?? (running ? (vehicle.preflight?.running ? vehicle.preflight.checks : []) : []);
  vehicle.preflight = { running, checks, text: reply.text };
}

/** @param {boolean} open */
function changed(open) {
  if (open) fleet.forget();
  else commands.lose();
  wake();
}

/** Return true if this page may command; else say why not, and offer the login. */
function allowed() {
  if (!link.open || fleet.canCommand) return true; // without a connection the command says so itself
  if (fleet.password) login.ask();
  else byId("rights").animate?.([{ opacity: 0.2 }, { opacity: 1 }], { duration: 400, iterations: 2 });
  return false;
}

/** Draw at the screen's next frame. */
function wake() {
  if (asked === 0) asked = requestAnimationFrame(frame);
}

function frame() {
  asked = 0;
  soon = false;
  drawnMs = performance.now();
  draw();
}

/** Draw what has come since the last drawing; while nothing comes, say so in time. */
function tick() {
  const silentS = (performance.now() - link.heardMs) / 1000;
  const quiet = performance.now() - drawnMs > QUIET_MS;
  if ((soon && performance.now() - drawnMs > REST_MS) || quiet) wake();
  else showStale(fleet, link, silentS);
}

function draw() {
  const vehicle = fleet.focus;
  const silentS = (performance.now() - link.heardMs) / 1000;
  showTop(silentS);
  showStale(fleet, link, silentS);
  cards.show();
  showNow(fleet);
  controls.show();
  kill.show();
  showChecks(vehicle);
  if (performance.now() - linksMs > LINKS_MS) {
    linksMs = performance.now();
    showLinks(fleet, silentS, link.open);
  }
  showLog(vehicle, commands.entries);
  drawPlots(plots, vehicle);
  drawPlan(byId("plan"), fleet);
  drawScene(byId("scene"), fleet, camera, follow);
}

/** @param {number} silentS */
function showTop(silentS) {
  const [badge, rights] = [byId("link"), byId("rights")];
  const good = link.open && fleet.linked && silentS < 1;
  setAttribute(badge, "data-tone", good ? "ok" : "bad");
  setSymbol(badge, good ? "ok" : "bad");
  setText(badge.querySelector("span"), !link.open ? "no connection" : silentS >= 1 ? "silent" : fleet.linked ? "live" : "no broker");
  setText(byId("version"), fleet.version);
  show(rights, fleet.greeted);
  const why = fleet.password ? "read-only: log in to command" : "read-only: the server has no password file";
  setText(rights.querySelector("span"), fleet.canCommand ? "may command" : why);
  setAttribute(rights, "data-tone", fleet.canCommand ? "ok" : "warn");
  show(byId("login"), fleet.greeted && fleet.password && !fleet.canCommand);
  show(byId("logout"), fleet.greeted && fleet.password && fleet.canCommand);
  document.body.classList.toggle("readonly", fleet.greeted && !fleet.canCommand);
  for (const button of document.querySelectorAll("[data-command], #kill")) {
    setAttribute(button, "aria-disabled", String(fleet.greeted && !fleet.canCommand));
  }
}

function listen() {
  byId("zoom-in").addEventListener("click", () => camera.nearer(1.25));
  byId("zoom-out").addEventListener("click", () => camera.nearer(0.8));
  byId("view-reset").addEventListener("click", () => camera.reset());
  byId("follow").addEventListener("click", () => {
    follow = !follow;
    setAttribute(byId("follow"), "aria-pressed", String(follow));
    wake();
  });
  byId("plan").addEventListener("click", (/** @type {MouseEvent} */ event) => {
    const place = placeOf(byId("plan"), fleet, event);
    if (place !== null) controls.choose(place);
    wake();
  });
  for (const event of ["resize", "scroll"]) addEventListener(event, wake, { passive: true });
  keepInSight(byId("bar"));
  setInterval(tick, TICK_MS);
}

startTheme(wake);
listen();
await login.useToken(); // a token that does not count leaves the page read-only, and it says so
link.connect();
wake();
