// The page: what is shown when. Time is in rhythm.js, pixels in surface.js, the size of a pixel in measure.js.
import { fit, History, Refresh, Rhythm } from "./rhythm.js";
import { drawBoth, pixels, scaleProblem, show, watch } from "./surface.js";
import { known, measuring, startMeasuring, stopMeasuring, redrawMeasure } from "./measure.js";

const $ = (id) => document.getElementById(id);
const BOARD_KEYS = ["squares_x", "squares_y", "square_mm", "marker_mm", "dictionary", "alpha"];
const KEYS = [...BOARD_KEYS, "cycle_hz", "px"];
const form = $("wish");

// What the user wants: "menu", "blink", "a" or "b". What happens: see `phase`.
let wanted = "menu";
let phase = "loading"; // loading, menu, measuring, blinking, held
let setup = null;
let wish = {};
let board = null; // { px, step, modules } once both surfaces are drawn
let refusal = "Loading.";
let refresh = null;
let refreshHz = null;
let offers = [];
let rhythm = null;
let marks = [];
let history = new History();
let lastRun = "";
let lock = null;
let drawing = 0;

// For tests and for the curious.
window.cellcal = {
  get phase() { return phase; },
  get n() { return rhythm ? rhythm.n : 0; },
  get k() { return rhythm ? rhythm.k : null; },
  get state() { return $("a").style.visibility === "hidden" ? 1 : 0; },
  get refresh_hz() { return refreshHz; },
  get cycle_hz() { return Number(wish.cycle_hz); },
  get offers() { return offers; },
  get dropped() { return rhythm ? rhythm.dropped : 0; },
  get drops() { return marks; },
  get history() { return history.list(); },
  get board() { return board; },
  get panel_px() { return pixels(); },
  get message() { return $("message").textContent; },
};

function say(text, bad = false) {
  $("message").textContent = text;
  $("message").classList.toggle("bad", bad);
}

function setPhase(next) {
  phase = next;
  const visible = next === "loading" || next === "menu" || (next === "measuring" && wanted === "menu");
  $("menu").hidden = !visible || measuring();
  document.body.classList.toggle("blinking", !visible);
  if (visible) facts();
}

// Draws both states at the largest whole scale; says why where that cannot be.
async function draw() {
  const mine = ++drawing;
  board = null;
  refusal = scaleProblem() || (pixels() ? null : "Loading.");
  if (refusal) return;
  const [width, height] = pixels();
  const query = new URLSearchParams(BOARD_KEYS.map((key) => [key, wish[key]]));
  const found = await answer(await fetch(`api/board?${query}`));
  if (mine !== drawing) return;
  const across = [Number(wish.squares_x), Number(wish.squares_y)];
  const largest = (margin) => {
    const fits = Math.min(width / (across[0] + margin), height / (across[1] + margin));
    return Math.floor(fits / found.step) * found.step;
  };
  // With half a square of white around the board where there is room.
  const px = wish.px ? Number(wish.px) : largest(1) || largest(0);
  if (!(px >= 8) || px * across[0] > width || px * across[1] > height) {
    const need = px >= 8 ? px : Math.ceil(8 / found.step) * found.step;
    refusal = `The screen has ${width} x ${height} device pixels; a board of ${across[0]} x ${across[1]} squares needs ` +
      `${need * across[0]} x ${need * across[1]}: turn the device, use fewer squares, or markers of 0.75 or 0.8 squares.`;
    return;
  }
  const images = await Promise.all(["pattern", "blended"].map(async (state) => {
    const response = await fetch(`board.png?${query}&px=${px}&state=${state}`);
    if (!response.ok) await answer(response);
    return createImageBitmap(await response.blob(), { colorSpaceConversion: "none" });
  }));
  if (mine !== drawing) return;
  const at = [Math.floor((width - images[0].width) / 2), Math.floor((height - images[0].height) / 2)];
  drawBoth((context, index) => context.drawImage(images[index], ...at));
  board = { px, at, ...found };
}

async function answer(response) {
  const body = await response.json();
  if (!response.ok) throw new Error(body.error);
  return body;
}

// From the beginning: draw, measure the refresh, then do what is wanted.
async function restart() {
  show(0);
  rhythm = null;
  refresh = null;
  refreshHz = null;
  offers = [];
  phase = "loading";
  const mine = drawing + 1;
  try {
    await draw();
  } catch (error) {
    if (mine === drawing) refusal = error.message;
  }
  // Another one has begun meanwhile.
  if (mine !== drawing) return;
  if (measuring()) redrawMeasure();
  if (refusal || !board) return stop(refusal || "Loading.", true);
  if (wanted === "a" || wanted === "b") return hold();
  measure();
}

function measure() {
  if (document.hidden) return;
  refresh = new Refresh();
  refreshHz = null;
  say("Measuring the refresh of this screen.");
  setPhase("measuring");
}

function measured(hz) {
  refresh = null;
  if (Number.isNaN(hz)) {
    return stop("Refreshes come unevenly here: close other programs, plug the device in, turn off variable refresh, and measure again.", true);
  }
  refreshHz = hz;
  const found = fit(hz, Number(wish.cycle_hz));
  offers = found.offers;
  if (found.k === null) {
    const choice = offers.map((o) => `${o.toFixed(2)} Hz`).join(" or ");
    return stop(`${hz.toFixed(2)} refreshes a second cannot show ${wish.cycle_hz} cycles in whole refreshes. ` +
      `Set the screen to a multiple of ${2 * Number(wish.cycle_hz)} Hz, or use ${choice}; it goes into the cell as display.cycle_hz.`, true);
  }
  rhythm = new Rhythm(hz, found.k);
  if (wanted !== "blink") {
    return stop(`Ready: ${found.k} ${found.k === 1 ? "refresh" : "refreshes"} a state. ${lastRun}`);
  }
  history = new History();
  marks = [];
  setPhase("blinking");
}

function blink(stamp) {
  const next = rhythm.next(stamp);
  show(next.state);
  history.add(next);
  if (next.dropped && marks.length < 1000) marks.push([next.n, next.dropped]);
  if (next.changed) restart();
}

function refreshed(stamp) {
  requestAnimationFrame(refreshed);
  if (phase === "blinking") blink(stamp);
  else if (refresh) {
    const hz = refresh.add(stamp);
    if (hz !== null) measured(hz);
  }
}

function hold() {
  show(wanted === "a" ? 0 : 1);
  say(`Holding state ${wanted.toUpperCase()}.`);
  setPhase("held");
}

// Back to the menu with a sentence.
function stop(text, bad = false) {
  show(0);
  wanted = "menu";
  say(text, bad);
  setPhase("menu");
}

function stopped() {
  if (lock) lock.release().catch(() => {});
  lock = null;
  const { n, dropped } = window.cellcal;
  const last = marks.length ? ` The last before refresh ${marks[marks.length - 1][0]}.` : "";
  if (phase === "blinking") lastRun = `Stopped after ${n} refreshes; ${dropped} dropped.${last}`;
  stop(lastRun || "Ready.", dropped > 0);
}

function want(next) {
  if (measuring()) leaveMeasuring();
  wanted = next;
  if (next === "blink") {
    enterFullScreen();
    keepAwake();
  }
  restart();
}

function enterFullScreen() {
  const root = document.documentElement;
  // Refused without a gesture, and absent on phones of Apple: the page says so in `missing`.
  if (!document.fullscreenElement && root.requestFullscreen) root.requestFullscreen({ navigationUI: "hide" }).catch(() => {});
}

async function keepAwake() {
  try {
    lock = await navigator.wakeLock.request("screen");
  } catch {
    lock = null;
  }
}

function missing() {
  const lacks = [];
  if (!document.fullscreenEnabled) lacks.push("full screen");
  if (!("wakeLock" in navigator)) lacks.push("the wake lock that keeps the screen on");
  if (!lacks.length) return;
  const why = window.isSecureContext
    ? "this browser does not have it: add the page to the home screen, and turn the screen's sleep off"
    : "this page came without https: start it with --https";
  $("missing").textContent = `Missing: ${lacks.join(" and ")}; ${why}. Or play the video: cellcal target video.`;
  $("missing").hidden = false;
}

function facts() {
  const size = pixels();
  const lines = [["Screen", size ? `${size[0]} x ${size[1]} px` : "unknown"]];
  lines.push(["Refresh", refreshHz ? `${refreshHz.toFixed(3)} Hz` : "not measured"]);
  if (rhythm) lines.push(["Rhythm", `${rhythm.k} + ${rhythm.k} refreshes`], ["Dropped", String(rhythm.dropped)]);
  if (board) lines.push(["Square", `${board.px} px`], ["Module", `${moduleOf(board)} px`]);
  const pitch = board && known();
  if (pitch) {
    const [x, y, sx, sy] = [...pitch.mm_per_px, ...pitch.mm_per_px_sigma].map((mm) => mm * board.px);
    lines.push(["Square x", `${x.toFixed(3)} ± ${sx.toFixed(3)} mm`], ["Square y", `${y.toFixed(3)} ± ${sy.toFixed(3)} mm`]);
  } else lines.push(["Size", "not measured"]);
  if (setup && setup.panel_px && size && String(setup.panel_px) !== String(size)) {
    lines.push(["Cell's panel", `${setup.panel_px[0]} x ${setup.panel_px[1]} px`]);
  }
  $("facts").replaceChildren(...lines.map(([name, value]) => {
    const [line, dt, dd] = ["div", "dt", "dd"].map((tag) => document.createElement(tag));
    dt.textContent = name;
    dd.textContent = value;
    line.append(dt, dd);
    return line;
  }));
  $("offers").replaceChildren(...offers.map((hz) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `Use ${hz.toFixed(2)} Hz`;
    button.addEventListener("click", () => choose({ ...wish, cycle_hz: String(Number(hz.toFixed(4))) }));
    return button;
  }));
  $("start").disabled = !board || offers.length > 0;
  $("size").disabled = !board;
}

const moduleOf = ({ px, modules }) => Math.round((px * wish.marker_mm) / wish.square_mm / modules);

// Another board: into the address too, so that it can be opened again.
function choose(next) {
  wish = next;
  const changed = KEYS.filter((key) => String(wish[key]) !== String(setup[key] ?? ""));
  const query = new URLSearchParams(changed.map((key) => [key, wish[key]]));
  window.history.replaceState(null, "", query.size ? `?${query}` : "./");
  for (const key of KEYS) form.elements[key].value = wish[key];
  $("opacity").textContent = Number(wish.alpha).toFixed(2);
  restart();
}

function leaveMeasuring() {
  stopMeasuring();
  restart();
}

function beginMeasuring() {
  if (!board) return;
  wanted = "menu";
  const query = () => new URLSearchParams(BOARD_KEYS.map((key) => [key, wish[key]]));
  startMeasuring({ query, px: () => board && board.px, rates: () => [refreshHz, Number(wish.cycle_hz)] });
  $("menu").hidden = true;
}

function keyed(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
  const pressing = event.target.tagName === "BUTTON";
  if (event.key === "Escape") return measuring() ? leaveMeasuring() : phase === "blinking" || phase === "held" ? stopped() : undefined;
  if (typing || measuring()) return;
  const key = event.key.toLowerCase();
  if (phase === "blinking" || phase === "held") {
    if (key === " " || key === "enter") return event.preventDefault(), stopped();
  } else if (key === " " && !pressing && !$("start").disabled) return event.preventDefault(), want("blink");
  if (key === "a" || key === "b") want(key);
  if (key === "f") enterFullScreen();
  if (key === "c") beginMeasuring();
}

function listen() {
  $("start").addEventListener("click", () => want("blink"));
  $("again").addEventListener("click", restart);
  $("size").addEventListener("click", beginMeasuring);
  $("full").addEventListener("click", enterFullScreen);
  $("leave").addEventListener("click", leaveMeasuring);
  $("stage").addEventListener("click", () => (phase === "blinking" || phase === "held") && stopped());
  form.elements.alpha.addEventListener("input", () => ($("opacity").textContent = Number(form.elements.alpha.value).toFixed(2)));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    choose(Object.fromEntries(KEYS.map((key) => [key, form.elements[key].value.trim()])));
  });
  window.addEventListener("keydown", keyed);
  // Whatever may change the rate or the pixels: measure anew, then go on with what was wanted.
  watch(restart);
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) {
      if (phase === "blinking" || phase === "measuring") phase = "loading";
      refresh = null;
      return;
    }
    if (wanted === "blink") keepAwake();
    restart();
  });
  document.addEventListener("fullscreenchange", () => {
    if (!document.fullscreenElement && wanted === "blink") stopped();
  });
  if (screen.orientation) screen.orientation.addEventListener("change", restart);
  if (window.visualViewport) {
    let scale = window.visualViewport.scale;
    window.visualViewport.addEventListener("resize", () => {
      if (scale === window.visualViewport.scale) return;
      scale = window.visualViewport.scale;
      restart();
    });
  }
}

async function begin() {
  setup = await answer(await fetch("api/setup"));
  setup.px = "";
  $("cell").textContent = setup.cell ? `cell ${setup.cell}` : "no cell: the board of the paper";
  form.elements.dictionary.replaceChildren(...setup.dictionaries.map((name) => new Option(name, name)));
  const asked = new URLSearchParams(location.search);
  wish = Object.fromEntries(KEYS.map((key) => [key, asked.get(key) ?? String(setup[key])]));
  const state = asked.get("state");
  if (state === "a" || state === "b") wanted = state;
  if (asked.has("start")) wanted = "blink";
  for (const key of KEYS) form.elements[key].value = wish[key];
  $("opacity").textContent = Number(wish.alpha).toFixed(2);
  missing();
  listen();
  requestAnimationFrame(refreshed);
}

begin().catch((error) => say(`The page cannot start: ${error.message}`, true));
