// Shows the streams and, twice a second, the aids. Text from the server is only ever set as text.

const PERIOD_MS = 500;
const NAMES = { rgb: "frame camera", event: "event camera" };

const state = document.getElementById("state");
const figures = new Map();

function figureOf(camera) {
  if (!figures.has(camera)) {
    const figure = document.getElementById("camera").content.cloneNode(true).firstElementChild;
    figure.querySelector("figcaption").textContent = NAMES[camera];
    const image = figure.querySelector("img");
    image.alt = `live image of the ${NAMES[camera]} with the corners that were found`;
    image.src = `/${camera}.mjpeg`;
    document.getElementById("cameras").append(figure);
    figures.set(camera, figure);
  }
  return figures.get(camera);
}

function line({ name, value, advice }) {
  const [row, term, said] = ["div", "dt", "dd"].map((tag) => document.createElement(tag));
  row.classList.toggle("bad", advice !== null);
  [term.textContent, said.textContent] = [name, value];
  row.append(term, said);
  return row;
}

function advised(text, good) {
  const item = document.createElement("li");
  item.textContent = text;
  item.classList.toggle("good", good);
  return item;
}

function show(camera, readings) {
  const figure = figureOf(camera);
  figure.querySelector("dl").replaceChildren(...readings.map(line));
  const advice = readings.flatMap((reading) => (reading.advice === null ? [] : [advised(reading.advice, false)]));
  const list = advice.length > 0 ? advice : [advised("nothing to improve", true)];
  const before = figure.querySelector(".advice");
  // Screen readers speak only what is new.
  if (before.textContent !== list.map((item) => item.textContent).join("")) before.replaceChildren(...list);
}

function say(text, bad) {
  state.textContent = text;
  state.classList.toggle("bad", bad);
}

async function refresh() {
  try {
    const { cell, cameras, shown } = await (await fetch("/aids.json")).json();
    document.getElementById("cell").textContent = cell;
    document.title = `${cell}: cameras`;
    cameras.forEach(figureOf);
    if (shown === null) return say("waiting for the first image …", false);
    say(`image ${shown.number}`, false);
    for (const [camera, { readings }] of Object.entries(shown.cameras)) show(camera, readings);
  } catch {
    say("the view has ended; start `cellcal camera stream` and load this page again", true);
  }
}

refresh();
setInterval(refresh, PERIOD_MS);
