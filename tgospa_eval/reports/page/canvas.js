// What the pictures share: the selection, the range of steps, colours, canvases.
const state = { step: null, side: null, track: null, from: 0, to: Math.max(steps - 1, 0) };
const LEFT = 74, RIGHT = 10;
const PAPER = 690; // CSS pixels between the margins of a page
let style = null;

function colour(name) {
  style = style || getComputedStyle(document.documentElement);
  return style.getPropertyValue(`--${name}`).trim();
}

// Neighbouring numbers get hues far apart.
function colourOf(track) {
  return `oklch(${colour("lightness")} ${colour("chroma")} ${(track * 137.508 + 250) % 360})`;
}

const patterns = new Map();
function pattern(context, name) {
  const key = name + colour(name) + devicePixelRatio;
  if (patterns.has(key)) return patterns.get(key);
  const tile = document.createElement("canvas"), size = 6 * Math.ceil(devicePixelRatio);
  tile.width = tile.height = size;
  const pen = tile.getContext("2d");
  pen.fillStyle = colour("paper");
  pen.fillRect(0, 0, size, size);
  pen.fillStyle = pen.strokeStyle = colour(name);
  if (name === "missed") {
    pen.lineWidth = size / 3;
    for (const shift of [-size, 0, size]) {
      pen.beginPath();
      pen.moveTo(shift - 1, size + 1);
      pen.lineTo(shift + size + 1, -1);
      pen.stroke();
    }
  } else {
    for (const [x, y] of [[0.25, 0.25], [0.75, 0.75]]) {
      pen.beginPath();
      pen.arc(x * size, y * size, size / 5, 0, 7);
      pen.fill();
    }
  }
  const made = context.createPattern(tile, "repeat");
  made.setTransform(new DOMMatrix().scale(1 / Math.ceil(devicePixelRatio)));
  patterns.set(key, made);
  return made;
}
const fillOf = (context, name) => name === "missed" || name === "false" ? pattern(context, name) : colour(name);

// A context in CSS pixels with a clean canvas of the given height.
function prepare(canvas, height) {
  const width = printing ? PAPER : canvas.clientWidth || canvas.parentElement.clientWidth, ratio = Math.max(devicePixelRatio, printing ? 2 : 1);
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.height = `${height}px`;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.font = "12px system-ui, sans-serif";
  context.textBaseline = "middle";
  context.direction = "ltr";
  return [context, width, height];
}

// As wide as the lanes, which may have a scroll bar: one step is above the other.
function alignWithLanes(canvas) {
  canvas.style.width = printing ? "" : `${lanes.canvas.clientWidth}px`;
}

let printing = false, pending = 0;
const views = [];
function redraw() {
  if (!pending) pending = requestAnimationFrame(drawNow);
}
function drawNow() {
  cancelAnimationFrame(pending);
  pending = 0;
  for (const view of views) view.draw();
}

// Steps to pixels in the pictures over time, and back.
const span = () => state.to - state.from + 1;
const left = (step, width) => LEFT + (step - state.from) / span() * (width - LEFT - RIGHT);
const stepAt = (x, width) => {
  const step = Math.floor(state.from + (x - LEFT) / (width - LEFT - RIGHT) * span());
  return Math.min(Math.max(step, state.from), state.to);
};

function niceSteps(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const size = [1, 2, 5, 10].find((factor) => factor * power >= raw) * power;
  const ticks = [];
  // By number, for a step may be less than the last digit of a large value.
  for (let k = 0, first = Math.ceil(low / size) * size; k <= 2 * count + 2 && first + k * size <= high + size * 1e-9; k++) ticks.push(first + k * size);
  return ticks;
}

// A value of an axis with as many digits as tell it from the next one.
function tick(value, ticks) {
  const size = ticks.length > 1 ? ticks[1] - ticks[0] : Math.abs(value) || 1;
  if (Math.abs(value) >= 1e9 || size < 1e-6) return number(value);
  const text = value.toFixed(Math.max(0, Math.ceil(-Math.log10(size) - 1e-9)));
  return Number(text) === 0 ? "0" : text;
}

// Of times that are texts what is the same in all, as the date or the seconds, is left out on axes.
const SECONDS = /(?<=\d\d:\d\d):\d\d(\.\d+)?(Z|[+-]\d\d:?\d\d)?$/;
const seconds = (SECONDS.exec(time(0)) || [""])[0];
const sharedEnd = steps > 1 && doc.times.every((t) => String(t).endsWith(seconds)) ? seconds.length : 0;
const shared = (() => {
  const [first, last] = [time(0), time(Math.max(steps - 1, 0))];
  if (!steps || typeof doc.times[0] === "number") return 0;
  let same = 0;
  while (same < first.length && first[same] === last[same]) same++;
  const day = Math.max(first.lastIndexOf("T", same - 1), first.lastIndexOf(" ", same - 1)) + 1;
  return day || (/^\d{4}-/.test(first) && same >= 5 ? 5 : 0);
})();
// Whole numbers beyond the digits of a browser, as fine stamps since 1970, are told from the first.
const stamps = steps > 1 && doc.times.every((t) => typeof t === "string" && /^-?\d+$/.test(t)) ? doc.times.map(BigInt) : null;
// Numbers that were computed, as 0.1 + 0.2, lose the digits that are rounding.
const roundTime = (t) => typeof t === "number" ? String(+t.toPrecision(12)) : String(t);
const shortTime = (step) => stamps ? `+${number(Number(stamps[step] - stamps[0]))}` : roundTime(doc.times[step]).slice(shared, roundTime(doc.times[step]).length - sharedEnd);
const stepAtRound = new Map(doc.times.map((t, k) => [roundTime(t), k]));

function timeAxis(context, width, bottom) {
  context.fillStyle = colour("soft");
  context.textAlign = "center";
  const longest = Math.max(shortTime(state.from).length, shortTime(state.to).length) * 7 + 24;
  const count = Math.max(2, Math.floor((width - LEFT - RIGHT) / Math.max(longest, 60)));
  let ticks = Array.from({ length: Math.min(span(), count) }, (_, k) => state.from + k);
  if (span() > count) {
    // Round times where there are such steps, else steps at round distances.
    const [begin, end] = [doc.times[state.from], doc.times[state.to]];
    const round = typeof begin === "number" && end > begin ? niceSteps(begin, end, count) : [];
    ticks = round.map((value) => stepAtRound.get(roundTime(value))).filter((step) => step !== undefined);
    if (ticks.length < Math.max(2, round.length / 2)) ticks = niceSteps(0, state.to - state.from, count).filter(Number.isInteger).map((step) => step + state.from);
  }
  let end = -1e9;
  for (const step of ticks) {
    const x = (left(step, width) + left(step + 1, width)) / 2, half = context.measureText(shortTime(step)).width / 2;
    const middle = Math.min(Math.max(x, half), width - half);
    if (middle - half < end + 10) continue;
    end = middle + half;
    context.fillRect(x, bottom, 1, 4);
    context.fillText(shortTime(step), middle, bottom + 13);
  }
}

function valueAxis(context, width, top, bottom, high) {
  context.textAlign = "right";
  for (const value of niceSteps(0, high, Math.max(2, (bottom - top) / 40))) {
    const y = bottom - value / high * (bottom - top);
    context.fillStyle = colour("grid");
    context.fillRect(LEFT, y, width - LEFT - RIGHT, 1);
    context.fillStyle = colour("soft");
    context.fillText(number(+value.toPrecision(12)), LEFT - 6, y);
  }
}

function chosenStep(context, width, top, bottom) {
  if (state.step === null || state.step < state.from || state.step > state.to) return;
  const x = left(state.step, width), wide = Math.max(left(state.step + 1, width) - x, 1);
  context.fillStyle = colour("chosen");
  context.fillRect(x - 2, top, wide + 4, bottom - top);
  context.strokeStyle = colour("accent");
  context.lineWidth = 1.5;
  context.strokeRect(x - 2, top, wide + 4, bottom - top);
}

function clipped(context, text, width) {
  if (context.measureText(text).width <= width) return isolate(text);
  // The end of an id tells more than its middle.
  const short = (size) => `${text.slice(0, Math.floor(size / 3))}…${text.slice(text.length - Math.ceil(size * 2 / 3))}`;
  let size = Math.min(text.length, 40);
  while (size > 1 && context.measureText(short(size)).width > width) size--;
  return isolate(short(size));
}

const tip = document.getElementById("tip");
function showTip(event, text) {
  tip.hidden = !text;
  if (!text) return;
  tip.textContent = text;
  const box = tip.getBoundingClientRect();
  tip.style.left = `${Math.max(4, Math.min(event.clientX + 14, innerWidth - box.width - 8))}px`;
  tip.style.top = `${event.clientY + box.height + 24 > innerHeight ? event.clientY - box.height - 10 : event.clientY + 16}px`;
}

// Clicks choose, drags give a range of steps: for all pictures over time.
function timePointer(canvas, describe, choose) {
  let begin = null;
  canvas.addEventListener("pointerdown", (event) => { if (event.button === 0) begin = event.offsetX; });
  canvas.addEventListener("pointermove", (event) => showTip(event, describe(event)));
  canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
  canvas.addEventListener("pointercancel", () => { begin = null; });
  canvas.addEventListener("pointerup", (event) => {
    if (begin === null) return;
    const width = canvas.clientWidth, start = begin;
    begin = null;
    if (Math.abs(event.offsetX - start) > 8 && event.pointerType !== "touch") {
      const ends = [stepAt(start, width), stepAt(event.offsetX, width)].sort((a, b) => a - b);
      setRange(ends[0], ends[1]);
    } else choose(event, stepAt(event.offsetX, width));
  });
  canvas.addEventListener("dblclick", () => setRange(0, steps - 1));
}

// Keys with Ctrl, Alt or Cmd belong to the browser: its zoom, its way back.
const taken = (event) => event.ctrlKey || event.metaKey || event.altKey;
const bigger = ({ key }) => key === "+" || key === "="; // without Shift on many keyboards
const smaller = ({ key }) => key === "-" || key === "_";
