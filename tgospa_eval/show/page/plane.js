// Trajectories in the plane of any two axes: state columns, centres of boxes or the time. Only the selected steps are drawn.
const GROUPED = 1500; // number of events (missed, false, switch) above which a mark means several events
const CELL = 12; // size in pixels of the cells in which marks are grouped
const COVERED = 0.08; // largest share of the plane that marks of one kind cover
const NAMED = 30; // largest number of tracks of a side whose ids are written
const FAINT = 50; // number of tracks above which lines are fainter
const plane = {
  canvas: document.getElementById("plane"),
  axisX: document.getElementById("axis-x"),
  axisY: document.getElementById("axis-y"),
  downward: document.getElementById("downward"),
  equal: document.getElementById("equal"),
  view: null, // the shown part: its centre, and pixels per unit of each axis
  mark: 1, // size of marks, relative to the default
  crowded: false,
  kept: document.createElement("canvas"),
  drawn: null,

  arrange() {
    axisNames.forEach((name, axis) => {
      for (const select of [this.axisX, this.axisY]) select.add(new Option(name, axis));
    });
    const across = doc.boxes ? doc.columns.length : doc.columns.includes("lon") ? doc.columns.indexOf("lon") : 0;
    const up = doc.boxes ? across + 1 : doc.columns.includes("lat") ? doc.columns.indexOf("lat") : 1;
    // A single state column is shown over time.
    [this.axisX.value, this.axisY.value] = doc.columns.length > 1 ? [across, up] : [TIME, 0];
    this.downward.checked = doc.boxes;
    this.scales();
    document.getElementById("plane-section").hidden = !doc.columns.length;
  },

  // Choose equal scales, unless one axis is the time, or only one is an angle of a map.
  scales() {
    const names = this.shownNames(), angles = names.filter((name) => name === "lat" || name === "lon");
    this.equal.checked = !names.includes(axisNames[TIME]) && angles.length !== 1;
  },
  shownNames() {
    return [this.axisX, this.axisY].map((select) => axisNames[select.value]);
  },

  // Tracks of a side that belong to the selected track or repair, or null if nothing is selected.
  chosenTracks(name) {
    if (state.track === null) return null;
    if (about) return about[name];
    const side = sides[state.side], { run } = side;
    if (state.side === name) return new Set([state.track]);
    const followed = new Set();
    for (let r = run.first[state.track]; r < run.first[state.track + 1]; r++) if (run.other[r] >= 0) followed.add(run.other[r]);
    return followed;
  },
  coordinates(side) {
    return [side.row.axes[this.axisX.value], side.row.axes[this.axisY.value]];
  },

  fit(chosen) {
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (const side of [sides.truth, sides.estimate]) {
      const only = chosen ? this.chosenTracks(side.name) : null, axes = this.coordinates(side), { row } = side;
      for (let k = 0; k < row.track.length; k++) {
        if (row.step[k] < state.from || row.step[k] > state.to || (only && !only.has(row.track[k]))) continue;
        if (chosen && !only && state.step !== null && Math.abs(row.step[k] - state.step) > 5) continue;
        for (const axis of [0, 1]) {
          low[axis] = Math.min(low[axis], axes[axis][k]);
          high[axis] = Math.max(high[axis], axes[axis][k]);
        }
      }
    }
    if (low[0] > high[0]) return;
    const size = [this.canvas.clientWidth - 70, this.canvas.clientHeight - 50];
    const scale = [0, 1].map((axis) => Math.max(size[axis], 40) / (high[axis] - low[axis] || 1) * 0.94);
    if (this.equal.checked) {
      // A degree of longitude is shorter than a degree of latitude.
      const long = this.shownNames().map((name) => (name === "lon" ? 1 / (doc.stretch ?? 1) : 1));
      const least = Math.min(scale[0] / long[0], scale[1] / long[1]);
      for (const axis of [0, 1]) scale[axis] = least * long[axis];
    }
    this.view = { centre: [0, 1].map((axis) => (low[axis] + high[axis]) / 2), scale, chosen };
  },
  place(x, y, width, height) {
    const { centre, scale } = this.view, up = this.downward.checked ? 1 : -1;
    return [(width + 44) / 2 + (x - centre[0]) * scale[0], (height - 22) / 2 + up * (y - centre[1]) * scale[1]];
  },

  draw() {
    if (!doc.columns.length) return;
    const [context, width, height] = prepare(this.canvas, 460);
    if (!width) return;
    if (!this.view) this.fit(false);
    if (!this.view) return;
    this.still(context, width, height);
    context.save();
    context.beginPath();
    context.rect(56, 4, width - 60, height - 30);
    context.clip();
    if (state.step !== null) this.moment(context, width, height);
    context.restore();
    document.getElementById("plane-note").textContent =
      (span() < steps ? `Steps ${time(state.from)} to ${time(state.to)}. ` : "") +
      (doc.stride > 1 ? `Drawn are one in ${doc.stride} positions, and all missed targets, false targets and changes of assignment. ` : "") +
      (this.most > 1 ? `One mark stands for all events of a kind near each other, at most ${number(this.most)}; its area shows their number. ` : "") +
      shapes.note();
  },

  // Draw everything that does not depend on the selected step. It is kept as an image, so that another step is shown quickly.
  still(context, width, height) {
    const ways = [this.axisX.value, this.axisY.value, this.downward.checked, shapes.control.checked, shapes.dots.checked, printing];
    const drawn = JSON.stringify([this.view, state.from, state.to, state.step === null, state.side, state.track, state.repair, this.canvas.width, ways]);
    if (drawn !== this.drawn) {
      this.kept.width = this.canvas.width;
      this.kept.height = this.canvas.height;
      const pen = this.kept.getContext("2d");
      pen.setTransform(context.getTransform());
      for (const name of ["font", "textBaseline", "direction"]) pen[name] = context[name];
      this.paint(pen, width, height);
      this.drawn = drawn;
    }
    context.drawImage(this.kept, 0, 0, width, height);
  },
  paint(context, width, height) {
    this.axes(context, width, height);
    context.save();
    context.beginPath();
    context.rect(56, 4, width - 60, height - 30);
    context.clip();
    // Marks become smaller and thinner if they would hide one another.
    let count = 0;
    for (let k = state.from; k <= state.to; k++) count += doc.counts.missed[k] + doc.counts.false[k] + (doc.counts.switch?.[k] ?? 0);
    this.crowded = count >= 400;
    this.most = 0;
    this.mark = !this.crowded || state.track !== null ? 1 : Math.max(0.45, 1 - Math.log10(count / 400) * 0.4);
    const only = { truth: this.chosenTracks("truth"), estimate: this.chosenTracks("estimate") };
    for (const name of ["truth", "estimate"]) this.lines(context, sides[name], only[name], width, height);
    shapes.along(context, only, width, height);
    if (count > GROUPED && state.track === null) this.groups(context, width, height);
    else {
      for (const name of ["truth", "estimate"]) this.events(context, sides[name], only[name], width, height);
      this.switches(context, only.truth, width, height);
    }
    for (const name of ["truth", "estimate"]) this.ends(context, sides[name], only[name], width, height);
    context.restore();
  },

  axes(context, width, height) {
    const { centre, scale } = this.view;
    context.strokeStyle = colour("line");
    context.strokeRect(56.5, 4.5, width - 61, height - 31);
    const halfX = (width - 60) / 2 / scale[0], halfY = (height - 30) / 2 / scale[1];
    context.textAlign = "center";
    for (const [value, name] of this.ticks(this.axisX.value, centre[0] - halfX, centre[0] + halfX, width / 110)) {
      const [x] = this.place(value, centre[1], width, height);
      if (x < 58 || x + context.measureText(name).width / 2 > width - 4) continue;
      context.fillStyle = colour("grid");
      context.fillRect(x, 5, 1, height - 32);
      context.fillStyle = colour("soft");
      context.fillText(name, x, height - 16);
    }
    context.textAlign = "right";
    for (const [value, name] of this.ticks(this.axisY.value, centre[1] - halfY, centre[1] + halfY, height / 80)) {
      const [, y] = this.place(centre[0], value, width, height);
      if (y < 26 || y > height - 40) continue;
      context.fillStyle = colour("grid");
      context.fillRect(57, y, width - 62, 1);
      context.fillStyle = colour("soft");
      context.fillText(name, 52, y);
    }
    context.fillStyle = colour("ink");
    context.fillText(titleOf(this.axisX.value), width - 8, height - 5);
    context.textAlign = "left";
    context.fillText(titleOf(this.axisY.value), 62, 14);
  },

  ticks(axis, low, high, count) {
    if (+axis === TIME) {
      const [places, names] = timeTicks(low, high, Math.max(2, Math.floor(count)));
      return places.map((value, k) => [value, names[k]]);
    }
    const places = niceSteps(low, high, count);
    return places.map((value) => [value, tick(value, places)]);
  },

  // Draw a line through each sequence of consecutive steps of a track. Points near the one before are left out, more in faded lines.
  lines(context, side, only, width, height) {
    const { row } = side, [xs, ys] = this.coordinates(side), truth = side.name === "truth";
    context.lineJoin = "round";
    for (let track = 0; track < side.count; track++) {
      const dim = only && !only.has(track);
      context.globalAlpha = dim ? 0.13 : only ? 1 : Math.min(1, FAINT / side.count + 0.05);
      context.strokeStyle = truth ? colour("truth") : colourOf(track);
      context.lineWidth = truth ? (only && !dim ? 1.8 : 1) : only && !dim ? 2.4 : 1.6 * this.mark;
      context.setLineDash(truth && row.track.length < 20000 ? [4, 2] : []); // with many points, dashes are slow
      const near = dim ? 4 : 1;
      context.beginPath();
      let lastStep = -2, lastX = 0, lastY = 0, lastTold = -2, begun = -1, drawnX = 0, drawnY = 0;
      const from = rowFrom(side, track, state.from), to = rowFrom(side, track, state.to + 1);
      for (let k = from; k < to; k++) {
        const [x, y] = this.place(xs[k], ys[k], width, height);
        // Rows within one stride are joined: the page may lack the rows of the steps between them.
        const joined = row.step[k] - lastStep <= 1 || (row.step[k] - lastStep <= doc.stride && lastStep >= 0);
        if (!joined) {
          if (lastTold !== lastStep && lastStep >= 0) context.lineTo(lastX, lastY);
          else if (lastStep === begun) this.dot(context, lastX, lastY);
          context.moveTo(x, y);
          begun = row.step[k];
          lastTold = row.step[k];
          [drawnX, drawnY] = [x, y];
        } else if (Math.abs(x - drawnX) + Math.abs(y - drawnY) > near || k === to - 1) {
          context.lineTo(x, y);
          lastTold = row.step[k];
          [drawnX, drawnY] = [x, y];
        }
        [lastStep, lastX, lastY] = [row.step[k], x, y];
      }
      if (lastStep === begun) this.dot(context, lastX, lastY);
      context.stroke();
    }
    context.setLineDash([]);
    context.globalAlpha = 1;
  },

  // Draw arrowheads at the ends of the costliest tracks, and their ids: of estimates at the ends, of truths at the begins.
  ends(context, side, only, width, height) {
    const [xs, ys] = this.coordinates(side), truth = side.name === "truth", taken = [];
    const tracks = [...Array(side.count).keys()].filter((k) => !only || only.has(k));
    tracks.sort((a, b) => side.table.total[b] - side.table.total[a]);
    context.textAlign = "left";
    context.lineWidth = 3;
    context.strokeStyle = colour("paper");
    for (const track of tracks.slice(0, NAMED)) {
      const from = rowFrom(side, track, state.from), to = rowFrom(side, track, state.to + 1);
      if (from >= to) continue;
      const at = (k) => this.place(xs[k], ys[k], width, height), [x, y] = at(to - 1), [u, v] = at(Math.max(from, to - 4));
      context.fillStyle = truth ? colour("truth") : colourOf(track);
      if ((x !== u || y !== v) && !this.shownNames().includes(axisNames[TIME])) {
        const turn = Math.atan2(y - v, x - u);
        context.beginPath();
        context.moveTo(x + 3 * Math.cos(turn), y + 3 * Math.sin(turn));
        for (const side of [2.5, -2.5]) context.lineTo(x + 7 * Math.cos(turn + side), y + 7 * Math.sin(turn + side));
        context.closePath();
        context.fill();
      }
      const [p, q] = truth ? at(from) : [x, y], name = clipped(context, side.label[track], 110);
      const right = p + 5 + context.measureText(name).width;
      if (state.step !== null || taken.some(([a, b, c]) => p < c && right > a && Math.abs(q - b) < 13)) continue;
      taken.push([p, q, right]);
      context.strokeText(name, p + 5, q - 8);
      context.fillText(name, p + 5, q - 8);
    }
  },

  // Draw a dot for a sequence of a single step.
  dot(context, x, y) {
    context.moveTo(x + 1.5, y);
    context.arc(x, y, 1.5, 0, 7);
  },

  events(context, side, only, width, height) {
    const { row } = side, [xs, ys] = this.coordinates(side), missed = side.name === "truth";
    context.strokeStyle = colour(missed ? "missed" : "false");
    context.lineWidth = 1.6 * this.mark;
    const path = [new Path2D(), new Path2D()], arm = (missed ? 3.5 : 4.2) * this.mark;
    for (let k = 0; k < row.track.length; k++) {
      if (row.other[k] !== NONE || row.step[k] < state.from || row.step[k] > state.to) continue;
      const [x, y] = this.place(xs[k], ys[k], width, height), dim = only && !only.has(row.track[k]) ? 1 : 0;
      if (dim && this.crowded) continue;
      if (x < 40 || x > width + 10 || y < -10 || y > height) continue;
      if (missed) {
        path[dim].moveTo(x - arm, y - arm); path[dim].lineTo(x + arm, y + arm);
        path[dim].moveTo(x + arm, y - arm); path[dim].lineTo(x - arm, y + arm);
      } else {
        path[dim].moveTo(x, y - arm); path[dim].lineTo(x + arm, y + arm * 0.8); path[dim].lineTo(x - arm, y + arm * 0.8); path[dim].closePath();
      }
    }
    context.stroke(path[0]);
    context.globalAlpha = 0.15;
    context.stroke(path[1]);
    context.globalAlpha = 1;
  },

  switches(context, only, width, height) {
    const { step, truth, mass } = doc.switches;
    for (let k = 0; k < step.length; k++) {
      if (step[k] < state.from || step[k] > state.to) continue;
      if (this.crowded && only && !only.has(truth[k])) continue;
      const at = placeAt(sides.truth, truth[k], step[k]) || placeAt(sides.truth, truth[k], step[k] - 1);
      if (!at) continue;
      const [x, y] = this.place(at[this.axisX.value], at[this.axisY.value], width, height), size = (mass[k] >= 0.99 ? 6 : 4) * this.mark;
      context.globalAlpha = only && !only.has(truth[k]) ? 0.15 : this.mark > 0.5 ? 1 : 0.5;
      context.beginPath();
      context.moveTo(x, y - size); context.lineTo(x + size, y); context.lineTo(x, y + size); context.lineTo(x - size, y);
      context.closePath();
      context.fillStyle = colour("switch");
      context.strokeStyle = colour("paper");
      context.lineWidth = 1.2 * this.mark;
      context.fill();
      if (this.mark > 0.5) context.stroke();
    }
    context.globalAlpha = 1;
  },

  // Draw a mark for all events of a kind in a cell of the plane; its area shows their number.
  groups(context, width, height) {
    const byKind = { missed: new Map(), false: new Map(), switch: new Map() };
    const add = (name, x, y) => {
      if (x < 50 || x > width || y < 0 || y > height - 20) return;
      const key = Math.floor(x / CELL) * 4096 + Math.floor(y / CELL), group = byKind[name].get(key) || [0, 0, 0];
      byKind[name].set(key, [group[0] + x, group[1] + y, group[2] + 1]);
    };
    for (const [side, name] of [[sides.truth, "missed"], [sides.estimate, "false"]]) {
      const { row } = side, [xs, ys] = this.coordinates(side);
      for (let k = 0; k < row.track.length; k++) {
        if (row.other[k] === NONE && row.step[k] >= state.from && row.step[k] <= state.to) add(name, ...this.place(xs[k], ys[k], width, height));
      }
    }
    doc.switches.step.forEach((step, k) => {
      const track = doc.switches.truth[k];
      const at = step >= state.from && step <= state.to && (placeAt(sides.truth, track, step) || placeAt(sides.truth, track, step - 1));
      if (at) add("switch", ...this.place(at[this.axisX.value], at[this.axisY.value], width, height));
    });
    this.most = Math.max(1, ...Object.values(byKind).flatMap((groups) => [...groups.values()].map((group) => group[2])));
    const sums = Object.values(byKind).map((groups) => [...groups.values()].reduce((sum, group) => sum + group[2], 0));
    const largest = Math.min(CELL * 0.75, Math.sqrt((COVERED * width * height * this.most) / (2 * Math.max(1, ...sums))));
    context.globalAlpha = 0.8;
    context.lineWidth = 1.2;
    for (const [name, groups] of Object.entries(byKind)) {
      const path = new Path2D();
      for (const [xs, ys, count] of groups.values()) {
        const x = xs / count, y = ys / count, arm = Math.max(Math.sqrt(count / this.most) * largest, 1);
        if (name === "missed") {
          path.moveTo(x - arm, y - arm); path.lineTo(x + arm, y + arm);
          path.moveTo(x + arm, y - arm); path.lineTo(x - arm, y + arm);
        } else if (name === "false") {
          path.moveTo(x, y - arm); path.lineTo(x + arm, y + arm * 0.8); path.lineTo(x - arm, y + arm * 0.8); path.closePath();
        } else {
          path.moveTo(x, y - arm); path.lineTo(x + arm, y); path.lineTo(x, y + arm); path.lineTo(x - arm, y); path.closePath();
        }
      }
      context.strokeStyle = context.fillStyle = colour(name);
      if (name === "switch") context.fill(path); else context.stroke(path);
    }
    context.globalAlpha = 1;
  },

  // Draw the selected step: all states, and lines between assigned pairs.
  moment(context, width, height) {
    const places = { truth: new Map(), estimate: new Map() };
    const only = { truth: this.chosenTracks("truth"), estimate: this.chosenTracks("estimate") };
    const fade = (name, track) => { context.globalAlpha = only[name] && !only[name].has(track) ? 0.3 : 1; };
    for (const side of [sides.truth, sides.estimate]) {
      for (let track = 0; track < side.count; track++) {
        const at = placeAt(side, track, state.step);
        if (!at) continue;
        const [x, y] = this.place(at[this.axisX.value], at[this.axisY.value], width, height);
        places[side.name].set(track, [x, y]);
        fade(side.name, track);
        const k = rowFrom(side, track, state.step);
        if (side.row.step[k] === state.step) {
          context.globalAlpha *= 0.5;
          shapes.specks(context, side, k, +this.axisX.value, +this.axisY.value, width, height);
          context.globalAlpha *= 2;
        }
        const around = shapes.outline(side, track, state.step, at, +this.axisX.value, +this.axisY.value);
        context.lineWidth = 2;
        if (around) shapes.stroke(context, side, track, around.map((point) => this.place(...point, width, height)));
        const axes = [+this.axisX.value, +this.axisY.value];
        if (side.gate && axes[0] !== axes[1] && axes.every((axis) => axis === TIME || axis < doc.columns.length)) {
          const gate = shapes.ellipse(side, side.gate, track, state.step, at, ...axes);
          context.lineWidth = 1.5;
          if (gate) shapes.stroke(context, side, track, gate.map((point) => this.place(...point, width, height)), "missed", [2, 3]);
        }
        context.beginPath();
        context.arc(x, y, side.name === "truth" ? 6 : 3.5, 0, 7);
        if (side.name === "truth") {
          context.strokeStyle = colour("ink");
          context.stroke();
        } else {
          context.fillStyle = colourOf(track);
          context.fill();
          context.strokeStyle = colour("ink");
          context.lineWidth = 1;
          context.stroke();
        }
      }
    }
    context.strokeStyle = colour("ink");
    context.lineWidth = 1.5;
    for (const [track, [x, y]] of places.truth) {
      const r = runAt(sides.truth, track, state.step), other = places.estimate.get(sides.truth.run.other[r]);
      if (!other) continue;
      fade("truth", track);
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(...other);
      context.stroke();
    }
    context.globalAlpha = 1;
    // Names of all tracks if there is room, otherwise names of the selected track and its partner.
    const few = places.truth.size + places.estimate.size <= 60, named = { truth: new Set(), estimate: new Set() };
    if (!few && state.track !== null) {
      const side = sides[state.side], r = runAt(side, state.track, state.step);
      named[side.name].add(state.track);
      if (r >= 0) named[side.other].add(side.run.other[r]);
    }
    context.lineWidth = 3;
    for (const side of [sides.truth, sides.estimate]) {
      const truth = side.name === "truth";
      context.textAlign = truth ? "right" : "left";
      for (const [track, [x, y]] of places[side.name]) {
        if (!few && !named[side.name].has(track)) continue;
        context.strokeStyle = colour("paper");
        context.fillStyle = truth ? colour("ink") : colour("accent");
        const name = clipped(context, side.label[track], 110);
        context.strokeText(name, x + (truth ? -9 : 9), y + (truth ? -8 : 8));
        context.fillText(name, x + (truth ? -9 : 9), y + (truth ? -8 : 8));
      }
    }
  },
  nearest(event) {
    if (!this.view) return null;
    let best = 14 ** 2, nearest = null;
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    for (const side of [sides.truth, sides.estimate]) {
      const { row } = side, [xs, ys] = this.coordinates(side), only = this.chosenTracks(side.name);
      for (let k = 0; k < row.track.length; k++) {
        if (row.step[k] < state.from || row.step[k] > state.to) continue;
        const [x, y] = this.place(xs[k], ys[k], width, height);
        let far = (x - event.offsetX) ** 2 + (y - event.offsetY) ** 2;
        // Unassigned states and states of selected tracks count as nearer than others.
        if (row.other[k] === NONE) far *= 0.6;
        if (only && !only.has(row.track[k])) far = far * 3 + 20;
        if (far < best) [best, nearest] = [far, { side, track: row.track[k], step: row.step[k] }];
      }
    }
    return nearest;
  },
  zoom(factor, x = null, y = null) {
    const { view } = this, { clientWidth: width, clientHeight: height } = this.canvas, up = this.downward.checked ? 1 : -1;
    if (!view) return;
    const away = x === null ? [0, 0] : [x - (width + 44) / 2, up * (y - (height - 22) / 2)];
    for (const axis of [0, 1]) {
      view.centre[axis] += away[axis] / view.scale[axis] * (1 - 1 / factor);
      view.scale[axis] *= factor;
    }
    redraw();
  },
  move(dx, dy) {
    if (!this.view) return;
    const up = this.downward.checked ? 1 : -1;
    this.view.centre[0] -= dx / this.view.scale[0];
    this.view.centre[1] -= up * dy / this.view.scale[1];
    redraw();
  },
};

function planeAct(name) {
  if (name === "in") plane.zoom(1.5);
  else if (name === "out") plane.zoom(1 / 1.5);
  else {
    plane.fit(name === "selected");
    redraw();
  }
}
for (const button of document.querySelectorAll("[data-plane]")) button.addEventListener("click", () => planeAct(button.dataset.plane));
for (const control of [plane.axisX, plane.axisY, plane.equal]) {
  control.addEventListener("change", () => {
    if (control !== plane.equal) plane.scales();
    planeAct("all");
  });
}
for (const control of [plane.downward, shapes.control, shapes.dots]) control.addEventListener("change", redraw);
