// Used by all pictures: the selection, the range of steps, colours, canvases and axes.
const state = { step: null, side: null, track: null, repair: null, from: 0, to: Math.max(steps - 1, 0) };
const RIGHT = 10, FOOT = 40;
let LEFT = 74, BESIDE = 65; // left margin, and the part of it for values and name of a vertical axis
const PAPER = 690; // CSS pixels between the margins of a printed page
let style = null;

function colour(name) {
  style = style || getComputedStyle(document.documentElement);
  return style.getPropertyValue(`--${name}`).trim();
}

const TRACKS = (() => {
  let count = 0;
  while (colour(`track-${count}`)) count++;
  return count;
})();
const colourOf = (track) => colour(`track-${track % TRACKS}`);

const patterns = new Map();
function pattern(context, name) {
  const key = name + colour(name) + devicePixelRatio;
  if (patterns.has(key)) return patterns.get(key);
  const tile = document.createElement("canvas"), size = 6 * Math.ceil(devicePixelRatio);
  tile.width = tile.height = size;
  const pen = tile.getContext("2d");
  const free = name === "soft" || name === "paper";
  if (!free) {
    pen.fillStyle = colour("paper");
    pen.fillRect(0, 0, size, size);
  }
  pen.fillStyle = pen.strokeStyle = colour(name);
  if (name === "missed") {
    pen.lineWidth = size / 3;
    for (const shift of [-size, 0, size]) {
      pen.beginPath();
      pen.moveTo(shift - 1, size + 1);
      pen.lineTo(shift + size + 1, -1);
      pen.stroke();
    }
  } else if (free) {
    pen.lineWidth = size / 6;
    for (const shift of [-size, 0, size]) {
      pen.beginPath();
      pen.moveTo(shift - 1, -1);
      pen.lineTo(shift + size + 1, size + 1);
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

// Clear a canvas and set its height. Return a context in CSS pixels, the width and the height.
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

// Make a canvas as wide as the lanes, which may have a scroll bar: so a step has one place in all pictures over time.
function alignWithLanes(canvas) {
  const width = lanes.canvas.clientWidth;
  canvas.style.width = printing || !width ? "" : `${width}px`;
}

// Set the left margin so that names of lanes and values of axes fit; names get at most a quarter of the width.
function fitMargin() {
  const context = costs.canvas.getContext("2d"), width = printing ? PAPER : lanes.canvas.clientWidth || costs.canvas.clientWidth;
  const shown = [total, doc.curve.total, ...(doc.windows ? [doc.windows.lines.total] : [])];
  const most = (values) => values.reduce((high, value) => Math.max(high, value), 0);
  context.font = "12px system-ui, sans-serif";
  BESIDE = Math.max(65, ...shown.map((values) => context.measureText(number(+most(values).toPrecision(2))).width + 18));
  LEFT = Math.max(74, BESIDE + 9, lanes.canvas.clientWidth ? Math.min(lanes.widest() + 16, width / 4) : 0);
}

let printing = false, pending = 0;
const views = [];
function redraw() {
  if (!pending) pending = requestAnimationFrame(drawNow);
}
function drawNow() {
  cancelAnimationFrame(pending);
  pending = 0;
  fitMargin();
  for (const view of views) view.draw();
}

// Begin and end of each step: halfway to the steps before and after it. Next to a gap, it is half a typical step away.
const [begins, ends] = (() => {
  const gaps = [...moments.keys()].slice(1).map((k) => moments[k] - moments[k - 1]);
  const usual = [...gaps].sort((a, b) => a - b)[Math.floor(0.9 * (gaps.length - 1))] ?? 1;
  const near = gaps.map((gap) => (gap > 2 * usual ? usual : gap) / 2);
  return [moments.map((at, k) => at - (near[k - 1] ?? near[0] ?? 0.5)), moments.map((at, k) => at + (near[k] ?? near[k - 1] ?? 0.5))];
})();
const span = () => state.to - state.from + 1;
const across = (at, width) => LEFT + (at - begins[state.from]) / (ends[state.to] - begins[state.from]) * (width - LEFT - RIGHT);
const left = (step, width) => across(begins[step], width);
const right = (step, width) => across(ends[Math.min(step, steps - 1)], width);
const stepAt = (x, width) => {
  const at = begins[state.from] + (x - LEFT) / (width - LEFT - RIGHT) * (ends[state.to] - begins[state.from]);
  let low = state.from, high = state.to;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (begins[middle] <= at) low = middle; else high = middle - 1;
  }
  return low < state.to && at - ends[low] > begins[low + 1] - at ? low + 1 : low;
};

function niceSteps(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const size = [1, 2, 5, 10].find((factor) => factor * power >= raw) * power;
  const ticks = [];
  // Each tick is computed from its index k: adding `size` again and again may not change a large value.
  for (let k = 0, first = Math.ceil(low / size) * size; k <= 2 * count + 2 && first + k * size <= high + size * 1e-9; k++) ticks.push(first + k * size);
  return ticks;
}

// Text of a value on an axis, with enough digits to distinguish it from the next tick.
function tick(value, ticks) {
  const size = ticks.length > 1 ? ticks[1] - ticks[0] : Math.abs(value) || 1;
  if (Math.abs(value) >= 1e9 || size < 1e-6) return number(value);
  const digits = Math.max(0, Math.ceil(-Math.log10(size) - 1e-9));
  return Number(value.toFixed(digits)) === 0 ? "0" : grouped(value, digits);
}

// Text of a time. Numbers lose digits that come from rounding: 0.1 + 0.2 becomes 0.3.
const roundTime = (t) => typeof t === "number" ? String(+t.toPrecision(12)) : String(t);
// Number of characters with which all times begin, if they are texts, such as those of the date.
const shared = (() => {
  const [first, last] = [time(0), time(Math.max(steps - 1, 0))];
  if (steps < 2 || typeof doc.times[0] === "number") return 0;
  let same = 0;
  while (same < first.length && first[same] === last[same]) same++;
  return Math.max(first.lastIndexOf("T", same - 1), first.lastIndexOf(" ", same - 1)) + 1;
})();

// Return positions of ticks at round times, their names, and the name of the axis, as show/time_axis.py does.
const DAY = 86400;
const CLOCK = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, ...[1, 2, 5, 7, 14, 28, 91, 182, 364].map((days) => days * DAY)];
function timeTicks(low, high, count) {
  const { kind, origin } = doc.axis;
  if (kind === "date") return dateTicks(low, high, count);
  if (kind === "step") {
    const first = Math.max(Math.ceil(low), 0), last = Math.min(Math.floor(high), steps - 1);
    const places = last - first < count ? Array.from({ length: last - first + 1 }, (_, k) => first + k) : niceSteps(first, last, count).filter(Number.isInteger);
    return [places, places.map((step) => roundTime(doc.times[step]).slice(shared)), `time${shared ? ` ${time(0).slice(0, shared)}…` : ""}, steps evenly spaced`];
  }
  const places = niceSteps(low, high, count).filter((at) => kind === "number" || (at >= 0 && Number.isInteger(at)));
  if (kind === "stamp") return [places, places.map((at) => at ? `+${grouped(at)}` : "0"), `time from ${origin}`];
  const size = 10 ** Math.ceil(Math.log10(high - low));
  const base = Math.max(Math.abs(low), Math.abs(high)) > Math.max(1e5, 1e3 * (high - low)) ? Math.floor(low / size) * size : 0;
  return [places, places.map((at) => String(+(at - base).toPrecision(10))), base ? `time − ${base}` : "time"];
}
function dateTicks(low, high, count) {
  const raw = (high - low) / count * (1 - 1e-9), round = raw > CLOCK[0] && CLOCK.find((size) => size >= raw);
  const places = round ? Array.from({ length: Math.floor(high / round + 1e-9) - Math.ceil(low / round - 1e-9) + 1 }, (_, k) => (Math.ceil(low / round - 1e-9) + k) * round) : niceSteps(low, high, count);
  const size = round || places[1] - places[0] || 1e-3, digits = size >= 1 ? 0 : Math.min(Math.ceil(-Math.log10(size) - 1e-9), 9);
  const dayOf = (at) => new Date(Date.parse(`${doc.axis.origin}T00:00:00Z`) + Math.floor(at / DAY) * DAY * 1000).toISOString().slice(0, 10);
  const days = [...places, low, high].map(dayOf), one = (end) => days.every((day) => day.slice(0, end) === days[0].slice(0, end));
  const from = one(10) ? 10 : one(4) ? 5 : 0;
  const names = places.map((at, k) => {
    const seconds = +(at - Math.floor(at / DAY) * DAY).toFixed(digits), two = (value) => String(Math.floor(value)).padStart(2, "0");
    const clock = `${two(seconds / 3600)}:${two(seconds / 60 % 60)}` + (size % 60 ? `:${(seconds % 60).toFixed(digits).padStart(digits ? 3 + digits : 2, "0")}` : "");
    return [days[k].slice(from), ...(size % DAY ? [clock] : [])].filter(Boolean).join(" ");
  });
  return [places, names, `time${from ? `, ${days[0].slice(0, from === 10 ? 10 : 4)}` : ""}`];
}

function timeAxis(context, width, bottom) {
  context.fillStyle = colour("soft");
  context.textAlign = "center";
  const [low, high] = [begins[state.from], ends[state.to]], room = width - LEFT - RIGHT;
  let [places, names, title] = [[], [], "time"];
  if (state.from === state.to) [places, names] = [[moments[state.from]], [roundTime(doc.times[state.from])]];
  else {
    for (let count = Math.max(2, Math.floor(room / 60)); count > 1; count--) {
      [places, names, title] = timeTicks(low, high, count);
      if (names.reduce((sum, name) => sum + context.measureText(name).width + 16, 0) <= room) break;
    }
  }
  let end = -1e9;
  places.forEach((at, k) => {
    const x = across(at, width), half = context.measureText(names[k]).width / 2;
    const middle = Math.min(Math.max(x, half), width - half);
    if (middle - half < end + 10) return;
    end = middle + half;
    context.fillRect(x, bottom, 1, 4);
    context.fillText(names[k], middle, bottom + 13);
  });
  context.fillText(title, LEFT + room / 2, bottom + 30);
}

// Write the name of the vertical axis next to it, from bottom to top.
function upright(context, text, top, bottom) {
  context.save();
  context.translate(LEFT - BESIDE, (top + bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.textAlign = "center";
  context.fillStyle = colour("soft");
  context.fillText(clipped(context, text, bottom - top + 30), 0, 0);
  context.restore();
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
  const x = left(state.step, width), wide = Math.max(right(state.step, width) - x, 1);
  context.fillStyle = colour("chosen");
  context.fillRect(x - 2, top, wide + 4, bottom - top);
  context.strokeStyle = colour("accent");
  context.lineWidth = 1.5;
  context.strokeRect(x - 2, top, wide + 4, bottom - top);
}

function clipped(context, text, width) {
  if (context.measureText(text).width <= width) return isolate(text);
  // A long text loses its middle, because the end of an id distinguishes more.
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

// Handle the pointer on a picture over time: a click selects a step, a drag selects a range of steps.
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

// Keys with Ctrl, Alt or Cmd belong to the browser, for its zoom and history.
const taken = (event) => event.ctrlKey || event.metaKey || event.altKey;
const bigger = ({ key }) => key === "+" || key === "="; // "=" is "+" without Shift on many keyboards
const smaller = ({ key }) => key === "-" || key === "_";
