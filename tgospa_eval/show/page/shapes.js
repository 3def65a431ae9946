// Shapes around a state: its box, or the ellipse of its covariance in the two displayed columns; and its particles.
const CLOSE = 60; // largest number of states in view that all have shapes
const SPECK = 1.2; // radius of a particle of average weight, in pixels
const shapes = {
  control: document.getElementById("shapes"),
  dots: document.getElementById("particles"),
  shownAlong: [0, 0], // numbers of drawn shapes and particles along trajectories
  any: doc.boxes || Boolean(doc.spread.largest),

  // Return whether shapes in these two columns are known and requested.
  shown(across, up) {
    if (!this.control.checked) return false;
    if (doc.boxes) return (across === 0 && up === 1) || (across === doc.columns.length && up === across + 1);
    return this.any && across !== up;
  },
  note() {
    const axes = [+plane.axisX.value, +plane.axisY.value], known = doc.particles.truth[1] + doc.particles.estimate[1];
    const all = doc.boxes ? doc.rows.truth[1] + doc.rows.estimate[1] : doc.spread.states, parts = [];
    const what = doc.boxes ? "boxes" : axes.includes(TIME) ? "95 % intervals" : "95 % ellipses";
    if (this.shown(...axes)) parts.push(`${number(this.shownAlong[0])} of ${number(all)} ${what}${!doc.boxes && doc.spread.stride > doc.stride ? ` (those of one in ${doc.spread.stride} steps are known)` : ""}`);
    if (known && this.dots.checked) {
      parts.push(`${number(this.shownAlong[1])} of ${number(known)} particles (of ${number(doc.particles.truth[0] + doc.particles.estimate[0])} in the page${doc.every > doc.stride ? `, from one in ${doc.every} steps` : ""}), their area by weight`);
    }
    return parts.length ? `Drawn along trajectories (more after zooming in): ${parts.join("; ")}. All of the selected step are drawn.` : "";
  },

  // Standard deviations of two columns at a step, and the angle whose sine is their correlation; null if unknown.
  // They are interpolated between the rows with known covariances.
  spread(side, spread, track, step, across, up) {
    const { row } = side;
    if (!spread) return null;
    let low = spread.first[track], high = spread.first[track + 1];
    const [begin, end] = [low, high];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (row.step[spread.row[middle]] < step) low = middle + 1; else high = middle;
    }
    if (begin === end) return null;
    const after = Math.min(low, end - 1), before = Math.max(after - (row.step[spread.row[after]] > step ? 1 : 0), begin);
    const [t0, t1] = [row.step[spread.row[before]], row.step[spread.row[after]]], share = t1 > t0 ? (step - t0) / (t1 - t0) : 0;
    const level = (entry) => spread.levels[entry][before] + share * (spread.levels[entry][after] - spread.levels[entry][before]);
    const diagonal = (i) => i * (i + 3) / 2, { largest, fine, faint, angle } = spread.how;
    const [s, t] = [across, up].map((i) => i === TIME || level(diagonal(i)) >= faint ? 0 : largest[i] * Math.exp(-level(diagonal(i)) / fine));
    const [i, j] = [Math.max(across, up), Math.min(across, up)];
    return s || t ? [s, t, i === TIME ? 0 : level(i * (i + 1) / 2 + j) / angle] : null;
  },

  // Corners of the outline of a shape in the units of the columns, or null without a shape.
  outline(side, track, step, at, across, up) {
    if (!this.shown(across, up)) return null;
    if (doc.boxes) return [[0, 0], [1, 0], [1, 1], [0, 1]].map(([right, low]) => [at[0] + right * at[2], at[1] + low * at[3]]);
    return this.ellipse(side, side.spread, track, step, at, across, up);
  },
  ellipse(side, spread, track, step, at, across, up) {
    const ellipse = this.spread(side, spread, track, step, across, up);
    if (!ellipse) return null;
    const [s, t, turn] = ellipse, points = [], { radius: [one, two], power = 2 } = spread.how;
    for (let k = 0; k < 48; k++) {
      const u = k * Math.PI / 24;
      const [x, y] = [Math.cos(u), Math.sin(u)].map(Math.abs), norm = power === null ? Math.max(x, y) : power === 2 ? 1 : (x ** power + y ** power) ** (1 / power);
      const radius = (across === TIME || up === TIME ? one : two) / norm;
      points.push([at[across] + radius * s * Math.cos(u), at[up] + radius * t * Math.sin(u + turn)]);
    }
    return points;
  },

  stroke(context, side, track, points, name = "ink", dashes = [5, 3]) {
    const truth = side.name === "truth";
    context.strokeStyle = truth ? colour(name) : colourOf(track);
    context.setLineDash(truth ? dashes : []);
    context.beginPath();
    for (const point of points) context.lineTo(...point);
    context.closePath();
    context.stroke();
    context.setLineDash([]);
  },

  // Draw the particles of a row, and return their number.
  specks(context, side, k, across, up, width, height) {
    const { first, weight, axes } = side.particles, count = first[k + 1] - first[k];
    if (!this.dots.checked || across === up) return 0;
    context.fillStyle = side.name === "truth" ? colour("ink") : colourOf(side.row.track[k]);
    context.beginPath();
    for (let p = first[k]; p < first[k + 1]; p++) {
      const [x, y] = plane.place(axes[across][p], axes[up][p], width, height);
      const size = SPECK * Math.sqrt(Math.min(Math.max(weight[p] * count / doc.shares, 0.05), 20));
      context.moveTo(x + size, y);
      context.arc(x, y, size, 0, 7);
    }
    context.fill();
    return count;
  },

  // Draw shapes along trajectories. If at most CLOSE states are in view, all have shapes. Otherwise the
  // next shape is at least twice the size of the last one away; and if there are more than FEW_TRACKS
  // tracks, only those of the selection have shapes.
  along(context, only, width, height) {
    const axes = [+plane.axisX.value, +plane.axisY.value], timed = axes.includes(TIME);
    const inside = (x, y) => x >= 56 && x <= width - 4 && y >= 4 && y <= height - 26;
    const both = [sides.truth, sides.estimate], shown = this.shown(...axes);
    this.shownAlong = [0, 0];
    if (!shown && !this.dots.checked) return;
    let near = 0;
    for (const side of both) {
      const [xs, ys] = plane.coordinates(side);
      for (let k = 0; k < xs.length; k++) if (side.row.step[k] >= state.from && side.row.step[k] <= state.to && inside(...plane.place(xs[k], ys[k], width, height))) near++;
    }
    if (near > CLOSE && state.track === null && both[0].count + both[1].count > FEW_TRACKS) return;
    context.lineWidth = 1;
    for (const side of both) {
      const { row } = side, [xs, ys] = plane.coordinates(side);
      for (let track = 0; track < side.count; track++) {
        if (only[side.name] && !only[side.name].has(track)) continue;
        let last = null, reach = 0;
        for (let k = rowFrom(side, track, state.from); k < rowFrom(side, track, state.to + 1); k++) {
          const [x, y] = plane.place(xs[k], ys[k], width, height);
          if (near > CLOSE && last && (timed ? Math.abs(x - last[0]) < 24 : Math.hypot(x - last[0], y - last[1]) < reach)) continue;
          const ring = this.outline(side, track, row.step[k], row.axes.map((axis) => axis[k]), ...axes);
          const points = (ring || []).map((point) => plane.place(...point, width, height));
          const size = Math.max(0, ...points.map((point) => Math.hypot(point[0] - x, point[1] - y)));
          context.globalAlpha = 0.4;
          const dots = inside(x, y) ? this.specks(context, side, k, ...axes, width, height) : 0;
          if (!ring && !dots) continue;
          [last, reach] = [[x, y], Math.max(2 * size, 24)];
          if (inside(x, y)) this.shownAlong[1] += dots;
          if (size <= 3) continue;
          context.globalAlpha = state.track === null ? 0.4 : 0.7;
          this.stroke(context, side, track, points);
          if (inside(x, y)) this.shownAlong[0]++;
        }
      }
    }
    context.globalAlpha = 1;
  },
};
const FEW_TRACKS = 30;
