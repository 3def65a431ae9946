// Stacked cost of each step, and the normalised cumulative cost.
const costs = {
  canvas: document.getElementById("costs"),
  // Where there are more steps than pixels the dearest of each pixel stands for it, also in a click.
  together: (width) => Math.max(1, Math.ceil(span() / (width - LEFT - RIGHT))),
  dearest(step, width) {
    const size = this.together(width), first = step - (step - state.from) % size;
    let found = first;
    for (let k = first; k < Math.min(first + size, state.to + 1); k++) if (total[k] > total[found]) found = k;
    return found;
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
      // Thin bars begin and end at pixels, else they show a pattern that is not in the data.
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
        y -= tall;
      }
    }
    context.fillStyle = colour("line");
    context.fillRect(LEFT, bottom, width - LEFT - RIGHT, 1);
    timeAxis(context, width, bottom);
    upright(context, `cost${costUnit && ` (${costUnit})`}`, top, bottom);
    chosenStep(context, width, top, bottom);
    document.getElementById("costs-note").textContent = together > 1 ? `each bar is the dearest of ${together} steps` : "";
  },
};

const curve = {
  canvas: document.getElementById("curve"),
  draw() {
    alignWithLanes(this.canvas);
    const [context, width, height] = prepare(this.canvas, 180), top = 8, bottom = height - FOOT;
    let high = 0;
    for (let k = state.from; k <= state.to; k++) high = Math.max(high, doc.curve.total[k]);
    high = high * 1.05 || 1;
    valueAxis(context, width, top, bottom, high);
    const dashes = { missed: [7, 3], false: [2, 3], switch: [10, 3, 2, 3] };
    for (const name of [...PARTS, "total"]) {
      context.strokeStyle = name === "total" ? colour("ink") : colour(name);
      context.lineWidth = name === "total" ? 2.4 : name === "switch" ? 1.2 : 1.7;
      context.setLineDash(dashes[name] || []);
      context.beginPath();
      const stride = Math.max(1, Math.floor(span() / width));
      const point = (k) => [across(moments[k], width), bottom - doc.curve[name][k] / high * (bottom - top)];
      for (let k = state.from; k < state.to; k += stride) context.lineTo(...point(k));
      context.lineTo(...point(state.to));
      if (span() === 1) context.arc(...point(state.to), 3, 0, 7); // one point is no line
      context.stroke();
    }
    context.setLineDash([]);
    context.fillStyle = colour("line");
    context.fillRect(LEFT, bottom, width - LEFT - RIGHT, 1);
    timeAxis(context, width, bottom);
    upright(context, `per step, so far${doc.unit && ` (${doc.unit})`}`, top, bottom);
    chosenStep(context, width, top, bottom);
  },
};

function costWords(step) {
  const parts = PARTS.filter((name) => doc.costs[name][step] > 0).map((name) => {
    const count = doc.counts[name] ? ` (${number(doc.counts[name][step])})` : "";
    return `${name} ${number(doc.costs[name][step])}${count}`;
  });
  return `step ${time(step)}: cost ${number(total[step])}${parts.length ? `\n${parts.join(", ")}` : ""}`;
}

const barAt = (step) => costs.dearest(step, costs.canvas.clientWidth);
timePointer(costs.canvas, (event) => costWords(barAt(stepAt(event.offsetX, costs.canvas.clientWidth))), (_, step) => choose({ step: barAt(step) }));
timePointer(curve.canvas, (event) => {
  const step = stepAt(event.offsetX, curve.canvas.clientWidth);
  return `steps up to ${time(step)}: ${withUnit(doc.curve.total[step])} per step\n${PARTS.map((name) => `${name} ${number(doc.curve[name][step])}`).join(", ")}`;
}, (_, step) => choose({ step }));

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
