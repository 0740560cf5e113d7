// Two surfaces that are drawn beforehand, at whole device pixels.

const surfaces = ["a", "b"].map((id) => document.getElementById(id));
const contexts = surfaces.map((surface) => surface.getContext("2d", { alpha: false }));

let size = null;
let problem = null;

// Size in device pixels, [columns, rows]; null before it is known or where it is not whole.
export const pixels = () => size;

// Why no whole device pixels can be drawn, as a sentence; null where they can.
export function scaleProblem() {
  const zoom = window.visualViewport ? window.visualViewport.scale : 1;
  if (Math.abs(zoom - 1) > 1e-3) return `The page is enlarged ${zoom.toFixed(2)} times by two fingers: pinch it back to 1.`;
  return problem;
}

function exactSize(entry) {
  const exact = entry.devicePixelContentBoxSize && entry.devicePixelContentBoxSize[0];
  const ratio = window.devicePixelRatio;
  const { width, height } = entry.contentRect;
  const found = [width * ratio, height * ratio];
  if (exact) {
    const size = [exact.inlineSize, exact.blockSize];
    // Where both differ the picture is scaled on its way to the screen, as in the device view of developer tools.
    return size.every((n, i) => Math.abs(n - found[i]) < 2) ? size : null;
  }
  // Safari: only a whole ratio tells where device pixels are.
  const whole = Number.isInteger(ratio) && found.every((n) => Math.abs(n - Math.round(n)) < 1e-3);
  return whole ? found.map(Math.round) : null;
}

// Calls `changed` whenever the number of device pixels changes, also at the start.
export function watch(changed) {
  const observer = new ResizeObserver((entries) => {
    const found = exactSize(entries[entries.length - 1]);
    problem = found
      ? null
      : `This browser shows ${window.devicePixelRatio} device pixels a point but scales them or does not say where they are, so a ` +
        "square cannot have whole pixels: set the zoom of page and system to 100 %, or use another browser.";
    if (String(found) === String(size) && found) return;
    size = found;
    changed();
  });
  try {
    observer.observe(surfaces[0], { box: "device-pixel-content-box" });
  } catch {
    observer.observe(surfaces[0]);
  }
}

// Empties both surfaces to white and calls draw(context, index) for each.
export function drawBoth(draw) {
  surfaces.forEach((surface, index) => {
    [surface.width, surface.height] = size;
    contexts[index].imageSmoothingEnabled = false;
    contexts[index].fillStyle = "#fff";
    contexts[index].fillRect(0, 0, ...size);
    draw(contexts[index], index);
  });
}

// Shows surface 0 or 1; both are drawn, only the upper one is hidden or not.
let shown = 0;
export function show(index) {
  if (index === shown) return;
  shown = index;
  surfaces[0].style.visibility = index === 0 ? "visible" : "hidden";
}
