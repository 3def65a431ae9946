// Stacked cost of each step, the normalised cumulative cost, windows and NEES.
const costs = {
  canvas: document.getElementById("costs"),
  // If there are more steps than pixels, each pixel shows its costliest step, which a click selects.
  together: (width) => Math.max(1, Math.ceil(span() / (width - LEFT - RIGHT))),
  dearest(step, width) {
    const size = this.together(width), first = step - (step - state.from) % size;
    let peak = first;
    for (let k = first; k < Math.min(first + size, state.to + 1); k++) if (total[k] > total[peak]) peak = k;
    return peak;
  },

  draw() {
    alignWithLanes(this.canvas);
    const [context, width, height] = prepare(this.canvas, 210), top = 8, bottom = height - FOOT;
    let high = 0;
    for (let k = state.from; k <= state.to; k++) high = Math.max(high, total[k]);
    high = high || 1;
    valueAxis(context, width, top, bottom, high);
    const together = this.together(width);
    for (let first = state.from; first <= state.to; first += together) {
      const step = this.dearest(first, width);
      const begin = left(first, width), end = right(Math.min(first + together - 1, state.to), width), fine = end - begin < 4;
      // Thin bars begin and end at pixels. Otherwise they show a pattern that is not in the data.
      const x = fine ? Math.floor(begin) : begin, wide = fine ? Math.max(Math.floor(end) - x, 1) : end - begin;
      let y = bottom;
      for (const name of PARTS) {
        const tall = doc.costs[name][step] / high * (bottom - top);
        if (tall <= 0) continue;
        context.fillStyle = wide < 4 ? colour(name) : fillOf(context, name);
        context.fillRect(x, y - tall, Math.max(wide - (wide > 4 ? 1 : 0), 0.8), tall);
        if (wide >= 4 && (name === "missed" || name === "false") && tall > 1.5) {
          context.strokeStyle = colour(name);
          context.lineWidth = 1;
          context.strokeRect(x + 0.5, y - tall + 0.5, wide - 2, tall - 1);
        }
        const pale = name === "localisation" && doc.costs.localisation_spread;
        if (pale) {
          context.globalAlpha = 0.6;
          context.fillStyle = colour("paper");
          context.fillRect(x, y - tall, Math.max(wide - (wide > 4 ? 1 : 0), 0.8), pale[step] / high * (bottom - top));
          context.globalAlpha = 1;
        }
        y -= tall;
      }
    }
    context.fillStyle = colour("line");
    context.fillRect(LEFT, bottom, width - LEFT - RIGHT, 1);
    timeAxis(context, width, bottom);
    upright(context, `cost${costUnit && ` (${costUnit})`}`, top, bottom);
    chosenStep(context, width, top, bottom);
    const mean = doc.together > 1 ? `each bar is the mean of ${grouped(doc.together)} steps` : "";
    document.getElementById("costs-note").textContent = together > 1 ? `each bar is the costliest of ${together}${mean ? " means" : " steps"}` : mean;
  },
};

// Draw a line for each part and for the total: its values over the times at(k), for each index k from low to high.
function drawLines(canvas, { at, values, low, high, title }) {
  alignWithLanes(canvas);
  const [context, width, height] = prepare(canvas, 180), top = 8, bottom = height - FOOT;
  let most = 0;
  for (let k = low; k <= high; k++) most = Math.max(most, values.total[k]);
  most = most * 1.05 || 1;
  valueAxis(context, width, top, bottom, most);
  const dashes = { missed: [7, 3], false: [2, 3], switch: [10, 3, 2, 3] };
  for (const name of low <= high ? [...PARTS, "total"] : []) {
    context.strokeStyle = name === "total" ? colour("ink") : colour(name);
    context.lineWidth = name === "total" ? 2.4 : name === "switch" ? 1.2 : 1.7;
    context.setLineDash(dashes[name] || []);
    context.beginPath();
    const stride = Math.max(1, Math.floor((high - low + 1) / width));
    const point = (k) => [across(at(k), width), bottom - values[name][k] / most * (bottom - top)];
    for (let k = low; k < high; k += stride) context.lineTo(...point(k));
    context.lineTo(...point(high));
    if (low === high) context.arc(...point(high), 3, 0, 7); // a single point needs a mark
    context.stroke();
  }
  context.setLineDash([]);
  context.fillStyle = colour("line");
  context.fillRect(LEFT, bottom, width - LEFT - RIGHT, 1);
  timeAxis(context, width, bottom);
  upright(context, `${title}${doc.unit && ` (${doc.unit})`}`, top, bottom);
  chosenStep(context, width, top, bottom);
}

const curve = {
  canvas: document.getElementById("curve"),
  draw() {
    drawLines(this.canvas, { at: (k) => moments[k], values: doc.curve, low: state.from, high: state.to, title: "per step, so far" });
  },
};

const windows = doc.windows && {
  canvas: document.getElementById("windows"),
  middle: (k) => (moments[doc.windows.first[k]] + moments[doc.windows.last[k]]) / 2,
  // First and last index of the windows whose middle is in the selected range of steps.
  shown() {
    const count = doc.windows.first.length;
    let low = 0, high = count - 1;
    while (low < count && this.middle(low) < begins[state.from]) low++;
    while (high >= low && this.middle(high) > ends[state.to]) high--;
    return [low, high];
  },
  nearest(x) {
    const [low, high] = this.shown(), width = this.canvas.clientWidth;
    let nearest = null, least = Infinity;
    for (let k = low; k <= high; k++) {
      const far = Math.abs(across(this.middle(k), width) - x);
      if (far < least) [nearest, least] = [k, far];
    }
    return nearest;
  },
  draw() {
    const [low, high] = this.shown();
    drawLines(this.canvas, { at: (k) => this.middle(k), values: doc.windows.lines, low, high, title: "per step of a window" });
  },
};

// NEES of each step over its band, with gaps at steps without pairs. Below it are the ranks of the truth in its clouds.
const nees = doc.nees && {
  canvas: document.getElementById("nees"),
  words(step) {
    const [value, low, high] = Object.values(doc.nees.lines).map((line) => line[step]);
    return value === null ? `step ${time(step)}: no NEES` : `step ${time(step)}: NEES ${number(value)}, band ${number(low)} to ${number(high)}`;
  },
  draw() {
    alignWithLanes(this.canvas);
    const [context, width, height] = prepare(this.canvas, 180), top = 8, bottom = height - FOOT;
    const [values, low, high] = Object.values(doc.nees.lines);
    let most = doc.nees.ideal;
    for (let k = state.from; k <= state.to; k++) most = Math.max(most, values[k] ?? 0, high[k] ?? 0);
    most *= 1.05;
    const up = (value) => bottom - value / most * (bottom - top);
    valueAxis(context, width, top, bottom, most);
    context.fillStyle = colour("chosen");
    for (let k = state.from; k <= state.to; k++) {
      if (low[k] !== null) context.fillRect(left(k, width), up(high[k]), right(k, width) - left(k, width), up(low[k]) - up(high[k]));
    }
    const line = (name, dash, draw) => {
      context.strokeStyle = colour(name);
      context.lineWidth = 1.5;
      context.setLineDash(dash);
      context.beginPath();
      draw();
      context.stroke();
    };
    line("missed", [7, 3], () => { context.moveTo(LEFT, up(doc.nees.ideal)); context.lineTo(width - RIGHT, up(doc.nees.ideal)); });
    line("localisation", [], () => {
      for (let k = state.from, alone = true; k <= state.to; k++) {
        if (values[k] === null) { alone = true; continue; }
        const place = [across(moments[k], width), up(values[k])];
        if (alone && (values[k + 1] ?? null) === null) context.rect(place[0] - 1, place[1] - 1, 2, 2);
        else if (alone) context.moveTo(...place); else context.lineTo(...place);
        alone = false;
      }
    });
    context.setLineDash([]);
    timeAxis(context, width, bottom);
    upright(context, "NEES", top, bottom);
    chosenStep(context, width, top, bottom);
    if (doc.nees.ranks.length) this.ranks(document.getElementById("ranks"));
  },
  ranks(canvas) {
    alignWithLanes(canvas);
    const [context, width, height] = prepare(canvas, 150), top = 8, bottom = height - FOOT;
    const shares = doc.nees.ranks.map((row) => row.map((count) => count * row.length / (row.reduce((sum, each) => sum + each, 0) || 1)));
    const most = 1.05 * Math.max(1.9, ...shares.flat()), wide = (width - LEFT - RIGHT) / shares[0].length;
    const up = (value) => bottom - value / most * (bottom - top);
    valueAxis(context, width, top, bottom, most);
    context.fillStyle = colour("missed");
    for (let x = LEFT; x < width - RIGHT; x += 10) context.fillRect(x, up(1), 7, 1.5);
    shares.forEach((row, axis) => {
      context.strokeStyle = colourOf(axis);
      context.lineWidth = 2;
      context.beginPath();
      row.forEach((share, k) => { context.lineTo(LEFT + k * wide, up(share)); context.lineTo(LEFT + (k + 1) * wide, up(share)); });
      context.stroke();
    });
    context.fillStyle = colour("soft");
    context.textAlign = "center";
    for (let k = 0; k < 10; k += 2) context.fillText(`${k * 10} %`, LEFT + k / 10 * (width - LEFT - RIGHT), bottom + 13);
    context.fillText("weight of the particles below the truth", LEFT + (width - LEFT - RIGHT) / 2, bottom + 30);
    upright(context, "/ expected", top, bottom);
  },
};

function costWords(step) {
  const parts = PARTS.filter((name) => doc.costs[name][step] > 0).map((name) => {
    const count = doc.counts[name] ? ` (${number(doc.counts[name][step])})` : "";
    return `${word(name)} ${number(doc.costs[name][step])}${count}`;
  });
  return `${doc.together > 1 ? `mean step from ${time(step)} on` : `step ${time(step)}`}: cost ${number(total[step])}${parts.length ? `\n${parts.join(", ")}` : ""}`;
}

const barAt = (step) => costs.dearest(step, costs.canvas.clientWidth);
timePointer(costs.canvas, (event) => costWords(barAt(stepAt(event.offsetX, costs.canvas.clientWidth))), (_, step) => choose({ step: barAt(step) }));
timePointer(curve.canvas, (event) => {
  const step = stepAt(event.offsetX, curve.canvas.clientWidth);
  return `steps up to ${time(step)}: ${withUnit(doc.curve.total[step])} per step\n${PARTS.map((name) => `${word(name)} ${number(doc.curve[name][step])}`).join(", ")}`;
}, (_, step) => choose({ step }));
if (nees) timePointer(nees.canvas, (event) => nees.words(stepAt(event.offsetX, nees.canvas.clientWidth)), (_, step) => choose({ step }));
if (windows) {
  timePointer(windows.canvas, (event) => {
    const k = windows.nearest(event.offsetX), { first, last, tgospa, lines } = doc.windows;
    if (k === null) return "";
    return `${time(first[k])} to ${time(last[k])}: TGOSPA ${withUnit(tgospa[k])}, ${withUnit(lines.total[k])} per step\n${PARTS.map((name) => `${name} ${number(lines[name][k])}`).join(", ")}`;
  }, (event) => {
    const k = windows.nearest(event.offsetX);
    if (k !== null) setRange(doc.windows.first[k], doc.windows.last[k]);
  });
}

costs.canvas.addEventListener("keydown", (event) => {
  if (taken(event)) return;
  const now = state.step ?? state.from - (event.key === "ArrowRight" ? 1 : 0), jump = event.shiftKey ? 10 : 1;
  const target = {
    ArrowLeft: now - jump, ArrowDown: now - jump, ArrowRight: now + jump, ArrowUp: now + jump, Home: 0, End: steps - 1,
  }[event.key];
  if (target !== undefined) choose({ step: Math.min(Math.max(target, 0), steps - 1) });
  else if (event.key === "PageDown") act("next");
  else if (event.key === "PageUp") act("previous");
  else if (bigger(event)) act("in");
  else if (smaller(event)) act("out");
  else if (event.key === "0") act("all");
  else return;
  event.preventDefault();
});
