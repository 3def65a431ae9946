// A lane for each true object, then one for each estimate with false steps; only visible lanes are drawn.
const FOLDED = 40; // number of true objects above which those without missed steps and switches are hidden
const lanes = {
  box: document.getElementById("lanes"),
  canvas: document.getElementById("lanes-canvas"),
  rows: [],
  names: 0,
  tall: 18,
  all: document.getElementById("all-truths"),

  arrange() {
    const by = document.getElementById("order").value, rows = [];
    for (const name of ["truth", "estimate"]) {
      const side = sides[name];
      let tracks = [...Array(side.count).keys()];
      const eventful = tracks.filter((k) => side.table.unassigned_count[k] > 0 || (name === "truth" && switchesOf.truth.has(k)));
      let folded = 0;
      if (name === "estimate") tracks = eventful;
      else {
        const folds = side.count > FOLDED && eventful.length > 0 && eventful.length < side.count;
        this.all.parentElement.hidden = !folds;
        if (folds && !this.all.checked) [folded, tracks] = [side.count - eventful.length, eventful];
      }
      const begin = (k) => side.run.begin[side.run.first[k]] ?? steps;
      if (by === "cost") tracks.sort((a, b) => side.table.total[b] - side.table.total[a]);
      if (by === "begin") tracks.sort((a, b) => begin(a) - begin(b));
      const [count, wrong] = PARTS.includes("switch") ? [plural(tracks.length + folded, name === "truth" ? "object" : name), "with false steps"] : [`${tracks.length + folded} of ${word(name)}`, "alone at some step"];
      const quiet = folded ? `, ${folded} of them without events and not shown` : "";
      rows.push({ title: name === "truth" ? count + quiet : `${count} ${wrong}` });
      for (const track of tracks) rows.push({ side, track });
    }
    this.rows = rows;
    this.tall = rows.length > 80 ? 15 : 20;
  },
  // Width of the longest name in pixels, in the bold type of a selected lane.
  widest() {
    if (this.names) return this.names;
    const labels = this.rows.filter((row) => !row.title).map(({ side, track }) => side.label[track]);
    const context = this.canvas.getContext("2d");
    context.font = "700 12px system-ui, sans-serif";
    this.names = Math.max(0, ...labels.sort((a, b) => b.length - a.length).slice(0, 200).map((label) => context.measureText(label).width));
    return this.names;
  },
  indexOf(name, track) {
    return this.rows.findIndex((row) => row.track === track && row.side?.name === name);
  },
  reveal() {
    const find = () => this.rows.findIndex((row) => !row.title && isChosen(row.side.name, row.track));
    let index = find();
    if (index < 0 && state.side === "truth" && state.track !== null && !this.all.checked) {
      this.all.checked = true;
      this.arrange();
      index = find();
    }
    if (index < 0) return;
    const y = index * this.tall, { scrollTop, clientHeight } = this.box;
    if (y < scrollTop) this.box.scrollTop = y - this.tall;
    else if (y + this.tall > scrollTop + clientHeight - FOOT) this.box.scrollTop = y - clientHeight + 3 * this.tall + FOOT;
  },

  draw() {
    const whole = this.rows.length * this.tall + FOOT;
    // A printed page cannot scroll, so it has as many lanes as fit.
    const shown = Math.min(whole, printing ? 720 : 480);
    this.box.style.height = printing ? "auto" : `${shown + 2}px`;
    document.getElementById("lanes-space").style.height = `${printing ? 0 : whole - shown}px`;
    const [context, width] = prepare(this.canvas, shown), bottom = shown - FOOT;
    const scroll = printing ? 0 : this.box.scrollTop;
    context.save();
    context.beginPath();
    context.rect(0, 0, width, bottom);
    context.clip();
    const first = Math.floor(scroll / this.tall), last = Math.ceil((scroll + shown) / this.tall);
    for (let k = Math.max(first, 0); k < Math.min(last, this.rows.length); k++) {
      const y = k * this.tall - scroll, row = this.rows[k];
      if (row.title) {
        context.fillStyle = colour("soft");
        context.font = "600 12px system-ui, sans-serif";
        context.textAlign = "left";
        context.fillText(row.title, 2, y + this.tall / 2 + 1);
        context.font = "12px system-ui, sans-serif";
        context.fillStyle = colour("line");
        context.fillRect(0, y + this.tall - 1, width, 1);
      } else this.drawLane(context, row, y, width);
    }
    chosenStep(context, width, 0, bottom);
    context.restore();
    context.fillStyle = colour("line");
    context.fillRect(LEFT, bottom, width - LEFT - RIGHT, 1);
    timeAxis(context, width, bottom);
    const crowded = span() > 1.5 * (width - LEFT - RIGHT), notes = [];
    if (crowded) notes.push("There are more steps than pixels, so bars from the top of a lane show the share of steps that are missed or false.");
    if (printing && shown < whole) notes.push(`${Math.floor(bottom / this.tall)} of ${this.rows.length} rows are printed, in the order that was chosen.`);
    document.getElementById("lanes-note").textContent = notes.join(" ");
  },

  drawLane(context, { side, track }, y, width) {
    const { run } = side, truth = side.name === "truth", tall = this.tall, middle = y + tall / 2;
    const chosen = isChosen(side.name, track);
    if (chosen) {
      context.fillStyle = colour("chosen");
      context.fillRect(0, y, width, tall);
      context.fillStyle = colour("accent");
      context.fillRect(0, y, 3, tall);
    }
    context.fillStyle = colour("ink");
    context.textAlign = "right";
    context.font = `${chosen ? "700 " : ""}12px system-ui, sans-serif`;
    context.fillText(clipped(context, side.label[track], LEFT - 14), LEFT - 8, middle + 0.5);
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.save();
    context.beginPath();
    context.rect(LEFT, y, width - LEFT - RIGHT, tall);
    context.clip();
    const inside = [];
    for (let r = run.first[track]; r < run.first[track + 1]; r++) {
      if (run.end[r] >= state.from && run.begin[r] <= state.to) inside.push(r);
    }
    for (const r of inside) {
      if (run.other[r] < 0) continue;
      const x = left(run.begin[r], width), wide = Math.max(right(run.end[r], width) - x, 0.7);
      const high = truth ? tall - 4 : 5;
      context.fillStyle = truth ? colourOf(run.other[r]) : colourOf(track);
      context.fillRect(x, truth ? y + 2 : middle - 2.5, wide, high);
    }
    if (truth) this.drawErrors(context, side, track, y, width);
    // Unassigned steps are drawn over assigned ones, and at least 1.5 pixels wide.
    const crowded = span() > 1.5 * (width - LEFT - RIGHT);
    if (crowded) this.drawShares(context, run, inside, truth ? "missed" : "false", y, width);
    for (const r of crowded ? [] : inside) {
      if (run.other[r] !== NONE) continue;
      const x = left(run.begin[r], width), wide = Math.max(right(run.end[r], width) - x, 1.5);
      const name = truth ? "missed" : "false";
      context.fillStyle = wide < 4 ? colour(name) : pattern(context, name);
      context.fillRect(x, y + 3, wide, tall - 6);
      if (wide >= 4) {
        context.strokeStyle = colour(name);
        context.lineWidth = 1;
        context.strokeRect(x + 0.5, y + 3.5, wide - 1, tall - 7);
      }
    }
    for (const r of run.unjudged ? inside : []) {
      if (!run.unjudged[r]) continue;
      const x = left(run.begin[r], width);
      context.fillStyle = pattern(context, run.other[r] < 0 ? "soft" : "paper");
      context.fillRect(x, y + 3, Math.max(right(run.end[r], width) - x, 1.5), tall - 6);
    }
    for (const r of inside) {
      if (run.other[r] < 0) continue;
      const x = Math.max(left(run.begin[r], width), LEFT), room = Math.min(right(run.end[r], width), width - RIGHT) - x - 8;
      let name = sides[side.other].label[run.other[r]];
      if (room < 14 || (room < 40 && context.measureText(name).width > room)) continue;
      name = clipped(context, name, room);
      context.fillStyle = truth ? colour("label") : colour("ink");
      if (truth) context.fillText(name, x + 5, middle + 0.5);
      else {
        const size = context.measureText(name).width;
        context.fillStyle = colour("paper");
        context.fillRect(x + 3, y + 1, size + 5, tall - 2);
        context.fillStyle = colour("ink");
        context.fillText(name, x + 5, middle + 0.5);
      }
    }
    context.restore();
    if (truth) for (const k of switchesOf.truth.get(track) || []) this.drawSwitch(context, k, y, width);
  },

  // Darken the foot of each bar; the height of this part is the error relative to the cutoff.
  drawErrors(context, side, track, y, width) {
    const { row } = side, tall = this.tall - 4;
    const from = rowFrom(side, track, state.from), to = rowFrom(side, track, state.to + 1);
    context.fillStyle = "rgb(0 0 0 / 0.25)";
    const wide = (width - LEFT - RIGHT) / span() * doc.stride;
    let last = -1, most = 0;
    for (let k = from; k < to; k++) {
      if (row.other[k] < 0) continue;
      const x = left(row.step[k], width), high = row.error[k] / doc.errors * tall;
      if (wide >= 1) context.fillRect(x, y + 2 + tall - high, right(row.step[k] + doc.stride - 1, width) - x, high);
      else if (Math.floor(x) !== last) {
        if (last >= 0) context.fillRect(last, y + 2 + tall - most, 1, most);
        last = Math.floor(x);
        most = high;
      } else most = Math.max(most, high);
    }
    if (wide < 1 && last >= 0) context.fillRect(last, y + 2 + tall - most, 1, most);
  },

  // For more steps than pixels: draw a bar in each pixel, whose height is the share of unassigned steps.
  drawShares(context, run, inside, name, y, width) {
    const tall = this.tall - 6, each = span() / (width - LEFT - RIGHT), wrong = new Float32Array(Math.ceil(width) + 1);
    for (const r of inside) {
      if (run.other[r] !== NONE) continue;
      for (let step = Math.max(run.begin[r], state.from); step <= Math.min(run.end[r], state.to); step++) wrong[Math.floor(left(step, width))]++;
    }
    context.fillStyle = colour(name);
    wrong.forEach((count, x) => {
      const high = count && Math.max(tall * Math.min(count / each, 1), 3);
      if (high) context.fillRect(x, y + 3, 1, high);
    });
  },

  drawSwitch(context, k, y, width) {
    const step = doc.switches.step[k];
    if (step < state.from || step > state.to) return;
    const x = left(step, width), small = span() > 300 ? 0.7 : 1;
    const size = (doc.switches.mass[k] >= 0.99 ? 5 : 3.5) * small;
    context.beginPath();
    context.moveTo(x - size, y + 0.5);
    context.lineTo(x + size, y + 0.5);
    context.lineTo(x, y + 0.5 + size * 1.5);
    context.closePath();
    context.fillStyle = colour("switch");
    context.strokeStyle = colour("paper");
    context.lineWidth = small < 1 ? 0.5 : 1;
    context.fill();
    context.stroke();
  },

  at(event) {
    const y = event.offsetY + (printing ? 0 : this.box.scrollTop);
    const row = this.rows[Math.floor(y / this.tall)];
    return row && !row.title && event.offsetY < this.canvas.clientHeight - FOOT ? row : null;
  },
};

function laneWords({ side, track }, step) {
  const { run } = side, r = runAt(side, track, step), name = `${word(side.name)} ${isolate(side.label[track])}`;
  if (r < 0) return `${name} does not exist at ${time(step)}`;
  const stretch = run.begin[r] === run.end[r] ? `at ${time(run.begin[r])}` : `from ${time(run.begin[r])} to ${time(run.end[r])}`;
  const free = run.unjudged?.[r] ? "not judged" : "";
  const words = run.other[r] === FREE ? free : run.other[r] === NONE
    ? word(side.name === "truth" ? "missed" : "false")
    : `${free}${free && ", "}` + `${paired[side.name === "truth" ? 0 : 1]} ${labelOf(side.other, run.other[r])}`;
  const changes = side.name === "truth" ? (switchesOf.truth.get(track) || []).filter((k) => doc.switches.step[k] === step).map(switchWords) : [];
  return [`${name}: ${words} ${stretch}`, ...changes].join("\n");
}
function switchWords(k) {
  const { from, to, mass, cost } = doc.switches;
  const half = mass[k] === 1 ? "" : `, ${number(mass[k])} of a switch`;
  return `switch ${labelOf("estimate", from[k])} \u2192 ${labelOf("estimate", to[k])}${half}, cost ${number(cost[k])}`;
}

timePointer(lanes.canvas, (event) => {
  const row = lanes.at(event);
  return row ? laneWords(row, stepAt(event.offsetX, lanes.canvas.clientWidth)) : "";
}, (event, step) => {
  const row = lanes.at(event);
  if (!row) return;
  if (event.offsetX < LEFT) choose({ side: row.side.name, track: row.track });
  else choose({ side: row.side.name, track: row.track, step });
});
lanes.box.addEventListener("scroll", () => { if (!pending) pending = requestAnimationFrame(() => { pending = 0; lanes.draw(); }); });
lanes.canvas.addEventListener("keydown", (event) => {
  if (taken(event)) return;
  const way = { ArrowUp: -1, ArrowDown: 1, PageUp: -10, PageDown: 10, Home: -1e9, End: 1e9 }[event.key];
  if (way !== undefined) {
    const lots = lanes.rows.filter((row) => !row.title);
    const now = lots.findIndex((row) => row.side.name === state.side && row.track === state.track);
    const row = lots[Math.min(Math.max(now + way, 0), lots.length - 1)];
    if (row) choose({ side: row.side.name, track: row.track });
  } else if (event.key === "ArrowLeft") act("back");
  else if (event.key === "ArrowRight") act("forth");
  else if (bigger(event)) act("in");
  else if (smaller(event)) act("out");
  else if (event.key === "0") act("all");
  else return;
  event.preventDefault();
});
for (const control of [document.getElementById("order"), lanes.all]) {
  control.addEventListener("change", () => {
    lanes.arrange();
    lanes.box.scrollTop = 0;
    if (control !== lanes.all) lanes.reveal();
    redraw();
  });
}
