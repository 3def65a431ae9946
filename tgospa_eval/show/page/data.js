// The data: a JSON document (show/plot_data.py), and arrays of integers in one encoded text (show/html.py).
const doc = JSON.parse(document.getElementById("data").textContent);
const NONE = -1, FREE = -2;
const PARTS = doc.parts;
const word = (name) => doc.words[name] ?? name; // displayed name of a side or a part
const paired = PARTS.includes("switch") ? ["followed by", "follows"] : ["with", "with"];
const steps = doc.times.length;
const total = doc.times.map((_, k) => PARTS.reduce((sum, name) => sum + doc.costs[name][k], 0));
const stepOf = new Map(doc.times.map((t, k) => [String(t), k]));
const sides = { truth: null, estimate: null };

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function readArrays() {
  const text = atob(document.getElementById("arrays").textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
  const size = doc.arrays.reduce((sum, [, n]) => sum + 4 * n, 0);
  const flat = bytes.length === size ? bytes : await inflated(bytes);
  const arrays = {};
  let at = 0;
  for (const [name, n] of doc.arrays) {
    const values = new Int32Array(n);
    let value = 0;
    for (let k = at; k < at + n; k++) {
      const code = flat[k] | flat[k + n] << 8 | flat[k + 2 * n] << 16 | flat[k + 3 * n] << 24;
      value = (value + ((code >>> 1) ^ -(code & 1))) | 0;
      values[k - at] = value;
    }
    arrays[name] = values;
    at += 4 * n;
  }
  return arrays;
}

// Possible axes of the plane: the columns, the centres of boxes, and the time.
const moments = Float64Array.from(doc.axis.kind === "step" ? doc.times.keys() : doc.axis.values || doc.times);
const derived = doc.boxes ? [["centre x", 0, 2], ["centre y", 1, 3]] : [];
const TIME = doc.columns.length + derived.length;
const axisNames = [...doc.columns, ...derived.map(([name]) => name), doc.axis.kind === "step" ? "number of the step" : "t"];

// Name of an axis with its unit. doc.unit is the unit of distances; latitude and longitude are in degrees.
const titleOf = (axis) => {
  const name = axisNames[axis], angle = name === "lat" || name === "lon";
  return isolate(name + (angle ? " / °" : doc.unit && +axis !== TIME ? ` / ${doc.unit}` : ""));
};

// Index of the first entry of each track in an array that is sorted by track.
function firsts(track, count) {
  const first = new Int32Array(count + 1);
  for (const value of track) first[value + 1]++;
  for (let k = 0; k < count; k++) first[k + 1] += first[k];
  return first;
}

function makeSide(name, arrays) {
  const table = doc.tracks[name], count = table.id.length;
  const run = {}, row = {};
  for (const field of ["track", "begin", "end", "other"]) run[field] = arrays[`${name}/run/${field}`];
  run.unjudged = arrays[`${name}/run/unjudged`];
  for (const field of ["track", "step", "error"]) row[field] = arrays[`${name}/row/${field}`];
  row.axes = doc.columns.map((_, axis) => {
    const levels = arrays[`${name}/row/${axis}`], values = new Float64Array(levels.length);
    for (let k = 0; k < levels.length; k++) values[k] = doc.low[axis] + levels[k] * doc.quantum[axis];
    return values;
  });
  for (const [, corner, size] of derived) row.axes.push(row.axes[corner].map((value, k) => value + row.axes[size][k] / 2));
  row.axes.push(Float64Array.from(row.step, (step) => moments[step]));
  run.first = firsts(run.track, count);
  row.first = firsts(row.track, count);
  // Partner of each row: that of its run. Rows and runs have the same order.
  row.other = new Int32Array(row.track.length);
  for (let k = 0, r = 0; k < row.track.length; k++) {
    while (run.track[r] < row.track[k] || run.end[r] < row.step[k]) r++;
    row.other[k] = run.other[r];
  }
  const around = (what) => {
    const told = arrays[`${name}/${what}/row`];
    return told && {
      row: told, first: firsts(told.map((k) => row.track[k]), count), how: doc[what],
      levels: Array.from({ length: doc.columns.length * (doc.columns.length + 1) / 2 }, (_, entry) => arrays[`${name}/${what}/${entry}`]),
    };
  };
  // Particles are sorted by the row of their cloud.
  const held = arrays[`${name}/particles/row`];
  const particles = {
    first: firsts(held, row.track.length), weight: arrays[`${name}/particles/weight`],
    axes: doc.columns.map((_, axis) => Float64Array.from(arrays[`${name}/particles/${axis}`], (level) => doc.low[axis] + level * doc.quantum[axis])),
  };
  for (const [, corner, size] of derived) particles.axes.push(particles.axes[corner].map((value, k) => value + particles.axes[size][k] / 2));
  particles.axes.push(Float64Array.from(held, (k) => moments[row.step[k]]));
  const label = table.id.map((id, k) => table.class ? `${table.class[k]}: ${id}` : id);
  return { name, table, count, run, row, spread: around("spread"), gate: around("gate"), particles, label, other: name === "truth" ? "estimate" : "truth" };
}

// Index of the run of a track that contains a step, or -1.
function runAt(side, track, step) {
  const { first, begin, end } = side.run;
  let low = first[track], high = first[track + 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (end[middle] < step) low = middle + 1; else high = middle;
  }
  return low < first[track + 1] && begin[low] <= step ? low : -1;
}

// Index of the first row of a track at this step or a later one.
function rowFrom(side, track, step) {
  let low = side.row.first[track], high = side.row.first[track + 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (side.row.step[middle] < step) low = middle + 1; else high = middle;
  }
  return low;
}

// Coordinates of a track at a step, or null if it does not exist there. They are interpolated if the page lacks the row.
function placeAt(side, track, step) {
  if (!doc.columns.length || runAt(side, track, step) < 0) return null;
  const { row } = side, k = rowFrom(side, track, step);
  if (k >= row.first[track + 1]) return null;
  if (row.step[k] === step || k === row.first[track]) return row.axes.map((axis) => axis[k]);
  const share = (step - row.step[k - 1]) / (row.step[k] - row.step[k - 1]);
  return row.axes.map((axis) => axis[k - 1] + share * (axis[k] - axis[k - 1]));
}

const switchesOf = { step: new Map(), truth: new Map() };
doc.switches.step.forEach((step, k) => {
  for (const [map, key] of [[switchesOf.step, step], [switchesOf.truth, doc.switches.truth[k]]]) {
    if (!map.has(key)) map.set(key, []);
    map.get(key).push(k);
  }
});
const switchSteps = [...switchesOf.step.keys()].sort((a, b) => a - b);

// Isolate a text from the words around it, because ids may have another writing direction.
const isolate = (text) => `\u2068${text}\u2069`;
const labelOf = (name, track) => track < 0 ? "none" : isolate(sides[name].label[track]);
const grouped = (value, digits) => value.toLocaleString("en-US", { maximumFractionDigits: digits ?? 12, minimumFractionDigits: digits ?? 0 });
const number = (value) => {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e9 || size < 1e-4 ? value.toExponential(3) : grouped(+value.toPrecision(size >= 1000 ? 6 : 4));
};
const costUnit = doc.unit + (doc.unit && { 1: "", 2: "²", 3: "³" }[doc.order] || (doc.unit && doc.order !== 1 ? `^${doc.order}` : ""));
const withUnit = (value) => number(value) + (doc.unit ? ` ${doc.unit}` : "");
const time = (step) => String(doc.times[step]);
const plural = (count, word, many = `${word}s`) => `${number(count)} ${count === 1 ? word : many}`;
