// The size of a device pixel, from a calliper or a bank card. The server works it out and keeps it.
import { drawBoth, pixels, show } from "./surface.js";

const $ = (id) => document.getElementById(id);
const panel = $("measure");
const readings = $("readings");
// Squares of the row and of the column: both ends are black.
const SQUARES = 9;
const CARD_MM = [85.6, 53.98];

let shown = null; // what the page tells about the board, while measuring
let lengths = [0, 0]; // what is drawn, device pixels

// The size holds for one screen at one scale.
const key = () => `cellcal ${screen.width}x${screen.height}@${window.devicePixelRatio}`;

// { mm_per_px, mm_per_px_sigma } of this screen, or null.
export function known() {
  try {
    const found = JSON.parse(localStorage.getItem(key()));
    return found && found.mm_per_px.length === 2 && found.mm_per_px_sigma.length === 2 ? found : null;
  } catch {
    return null;
  }
}

export const measuring = () => shown !== null;
const method = () => document.querySelector("input[name=method]:checked").value;

export function startMeasuring(about) {
  shown = about;
  show(0);
  panel.hidden = false;
  $("measured").textContent = "";
  $("lines").hidden = true;
  const points = CARD_MM.map((mm) => Math.round((mm / 25.4) * 96 * window.devicePixelRatio));
  const old = known();
  const start = old ? CARD_MM.map((mm, i) => Math.round(mm / old.mm_per_px[i])) : points;
  [readings.elements.x_px.value, readings.elements.y_px.value] = start;
  redrawMeasure();
}

export function stopMeasuring() {
  shown = null;
  panel.hidden = true;
}

// Draws what is to be measured.
export function redrawMeasure() {
  const calliper = method() === "calliper";
  $("calliper").hidden = !calliper;
  $("card").hidden = calliper;
  panel.classList.toggle("beside", !calliper);
  if (!pixels()) return;
  if (calliper) drawRows();
  else drawCard();
}

function drawRows() {
  const [width, height] = pixels();
  const thick = Math.floor(Math.min(width, height) / 14);
  // Neither touches the other, so that every edge stands alone.
  const from = thick + 16;
  const squares = [width, height].map((n) => Math.floor((n - from - 8) / SQUARES));
  lengths = squares.map((n) => n * SQUARES);
  drawBoth((context) => {
    context.fillStyle = "#000";
    for (let i = 0; i < SQUARES; i += 2) {
      context.fillRect(from + i * squares[0], 4, squares[0], thick);
      context.fillRect(4, from + i * squares[1], thick, squares[1]);
    }
  });
  $("how").textContent = `Hold the calliper over all ${SQUARES} fields of the row at the top, from the first black edge to the last, ` +
    `then over all ${SQUARES} of the column at the left. ± is what two readings differ by, roughly.`;
}

function drawCard() {
  lengths = ["x_px", "y_px"].map((name) => Number(readings.elements[name].value));
  const [width, height] = pixels();
  const fits = lengths[0] + 8 <= width && lengths[1] + 8 <= height;
  drawBoth((context) => {
    context.fillStyle = "#000";
    if (fits) context.fillRect(4, 4, ...lengths);
  });
  $("how").textContent = fits
    ? "Lay a bank card (85.60 x 53.98 mm) on the black field, its corner at the top left. Change the field with the arrow keys " +
      "(Shift: 10 pixels) until no black shows beside the card and no white under its edge. A calliper is five times better."
    : `The field of ${lengths[0]} x ${lengths[1]} pixels does not fit the screen of ${width} x ${height}: turn the device, or use a calliper.`;
}

const number = (name) => Number(readings.elements[name].value.replace(",", "."));

async function keep(event) {
  event.preventDefault();
  const [refresh_hz, cycle_hz] = shown.rates();
  const body = { method: method(), px: lengths, px_per_square: shown.px(), panel_px: pixels(), refresh_hz, cycle_hz };
  if (body.method === "calliper") {
    Object.assign(body, { mm: [number("x_mm"), number("y_mm")], squares: SQUARES, reading_sigma_mm: number("sigma_mm") });
  }
  const response = await fetch(`api/measured?${shown.query()}`, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify(body),
  });
  const found = await response.json();
  $("measured").classList.toggle("bad", !response.ok);
  $("lines").hidden = !response.ok;
  if (!response.ok) {
    $("measured").textContent = found.error;
    return;
  }
  const [[x, y], [sx, sy]] = [found.square_mm, found.square_sigma_mm];
  $("measured").textContent = `Square ${x.toFixed(3)} ± ${sx.toFixed(3)} by ${y.toFixed(3)} ± ${sy.toFixed(3)} mm. ${found.notes.join(". ")}.`;
  $("lines").textContent = found.yaml;
  $("lines").scrollIntoView();
  try {
    localStorage.setItem(key(), JSON.stringify(found));
  } catch {
    $("measured").textContent += " This browser keeps nothing: the file of the server has it.";
  }
}

readings.addEventListener("submit", (event) => {
  keep(event).catch((error) => ($("measured").textContent = `The server does not answer: ${error.message}`));
});
for (const choice of document.querySelectorAll("input[name=method]")) choice.addEventListener("change", redrawMeasure);
for (const name of ["x_px", "y_px"]) readings.elements[name].addEventListener("input", drawCard);
window.addEventListener("keydown", (event) => {
  if (!measuring() || method() !== "card" || !event.key.startsWith("Arrow") || event.target.type === "radio") return;
  event.preventDefault();
  const name = event.key === "ArrowLeft" || event.key === "ArrowRight" ? "x_px" : "y_px";
  const sign = event.key === "ArrowRight" || event.key === "ArrowDown" ? 1 : -1;
  const input = readings.elements[name];
  input.value = Math.max(16, Number(input.value) + sign * (event.shiftKey ? 10 : 1));
  drawCard();
});
