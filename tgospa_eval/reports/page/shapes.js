// What is around a state: its box, or the 2-sigma ellipse of the two components that are shown.
const SIGMAS = 2;
const shapes = {
  control: document.getElementById("shapes"),
  any: doc.boxes || Boolean(doc.spread.largest),

  // A shape is known of these two columns, and it is wanted.
  shown(across, up) {
    if (!this.control.checked) return false;
    if (doc.boxes) return (across === 0 && up === 1) || (across === doc.columns.length && up === across + 1);
    return this.any && across !== up && Math.max(across, up) < doc.columns.length;
  },
  note() {
    if (!this.shown(+plane.axisX.value, +plane.axisY.value)) return "";
    const many = sides.truth.count + sides.estimate.count > FEW_TRACKS;
    return `${doc.boxes ? "Boxes" : "2-sigma ellipses"} are drawn at the selected step${many ? " and along the selected trajectory" : " and here and there along trajectories"}` +
      `${!doc.boxes && doc.spread.stride > doc.stride ? `, from one in ${doc.spread.stride} steps` : ""}.`;
  },

  // Deviations of two components at a step and the angle between them; on a line between those that are told.
  spread(side, track, step, across, up) {
    const { spread, row } = side;
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
    const diagonal = (i) => i * (i + 3) / 2, { largest, fine, faint, angle } = doc.spread;
    const [s, t] = [across, up].map((i) => level(diagonal(i)) >= faint ? 0 : largest[i] * Math.exp(-level(diagonal(i)) / fine));
    const [i, j] = [Math.max(across, up), Math.min(across, up)];
    return s || t ? [s, t, level(i * (i + 1) / 2 + j) / angle] : null;
  },

  // The outline as points in the units of the columns, or null.
  outline(side, track, step, at, across, up) {
    if (!this.shown(across, up)) return null;
    if (doc.boxes) return [[0, 0], [1, 0], [1, 1], [0, 1]].map(([right, low]) => [at[0] + right * at[2], at[1] + low * at[3]]);
    const found = this.spread(side, track, step, across, up);
    if (!found) return null;
    const [s, t, turn] = found, points = [];
    for (let k = 0; k < 48; k++) {
      const u = k * Math.PI / 24;
      points.push([at[across] + SIGMAS * s * Math.cos(u), at[up] + SIGMAS * t * Math.sin(u + turn)]);
    }
    return points;
  },

  stroke(context, side, track, points) {
    const truth = side.name === "truth";
    context.strokeStyle = truth ? colour("ink") : colourOf(track);
    context.setLineDash(truth ? [5, 3] : []);
    context.beginPath();
    for (const point of points) context.lineTo(...point);
    context.closePath();
    context.stroke();
    context.setLineDash([]);
  },

  // Along trajectories, each as far from the last as both are large: of what is selected, or of few.
  along(context, only, width, height) {
    const axes = [+plane.axisX.value, +plane.axisY.value];
    if (!this.shown(...axes) || (state.track === null && sides.truth.count + sides.estimate.count > FEW_TRACKS)) return;
    context.lineWidth = 1;
    for (const side of [sides.truth, sides.estimate]) {
      const { row } = side, [xs, ys] = plane.coordinates(side);
      for (let track = 0; track < side.count; track++) {
        if (only[side.name] && !only[side.name].has(track)) continue;
        context.globalAlpha = state.track === null ? 0.4 : 0.7;
        let last = null, reach = 0;
        for (let k = rowFrom(side, track, state.from); k < rowFrom(side, track, state.to + 1); k++) {
          const [x, y] = plane.place(xs[k], ys[k], width, height);
          if (last && Math.hypot(x - last[0], y - last[1]) < reach) continue;
          const found = this.outline(side, track, row.step[k], row.axes.map((axis) => axis[k]), ...axes);
          if (!found) continue;
          const points = found.map((point) => plane.place(...point, width, height));
          const size = Math.max(...points.map((point) => Math.hypot(point[0] - x, point[1] - y)));
          [last, reach] = [[x, y], Math.max(2 * size, 24)];
          if (size > 3) this.stroke(context, side, track, points);
        }
      }
    }
    context.globalAlpha = 1;
  },
};
const FEW_TRACKS = 30;
