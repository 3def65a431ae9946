// The selection: how it is changed by buttons, kept in the address of the page, and shown.
function address({ step = null, side = null, track = null, repair = null, from = 0, to = steps - 1 }) {
  const parts = [];
  if (repair !== null) parts.push(`repair=${repair + 1}`);
  if (step !== null) parts.push(`step=${encodeURIComponent(time(step))}`);
  if (track !== null && repair === null) parts.push(`${side}=${encodeURIComponent(sides[side].label[track])}`);
  if (from > 0 || to < steps - 1) parts.push(`range=${encodeURIComponent(time(from))}..${encodeURIComponent(time(to))}`);
  return parts.join("&");
}
function decoded(text) {
  try { return decodeURIComponent(text); } catch { return text; }
}
function readAddress() {
  const chosen = { step: null, side: null, track: null, repair: null, from: 0, to: Math.max(steps - 1, 0) };
  for (const part of location.hash.slice(1).split("&")) {
    const cut = part.indexOf("="), key = part.slice(0, cut), value = decoded(part.slice(cut + 1));
    if (key === "repair" && repairs.text[value - 1] !== undefined) Object.assign(chosen, selectRepair(value - 1));
    if (key === "step" && stepOf.has(value)) chosen.step = stepOf.get(value);
    if (key === "truth" || key === "estimate") {
      const track = sides[key].label.indexOf(value);
      if (track >= 0) Object.assign(chosen, { side: key, track, repair: null });
    }
    if (key === "range") {
      const [from, to] = part.slice(cut + 1).split("..").map((text) => stepOf.get(decoded(text)));
      if (from !== undefined && to !== undefined && from <= to) Object.assign(chosen, { from, to });
    }
  }
  Object.assign(state, chosen);
}

function refresh() {
  const { step } = state;
  about = state.repair === null ? null : concerned(state.repair);
  document.getElementById("step").value = step === null ? "" : time(step);
  const { canvas } = costs;
  canvas.setAttribute("aria-valuemin", 0);
  canvas.setAttribute("aria-valuemax", Math.max(steps - 1, 0));
  canvas.setAttribute("aria-valuenow", step ?? state.from);
  canvas.setAttribute("aria-valuetext", step === null ? "no step selected" : costWords(step));
  const lane = state.track === null ? -1 : lanes.indexOf(state.side, state.track);
  lanes.canvas.setAttribute("aria-valuemin", 0);
  lanes.canvas.setAttribute("aria-valuemax", Math.max(lanes.rows.length - 1, 0));
  lanes.canvas.setAttribute("aria-valuenow", Math.max(lane, 0));
  lanes.canvas.setAttribute("aria-valuetext", state.track === null ? "no lane selected"
    : `${word(state.side)} ${sides[state.side].label[state.track]}, cost ${number(sides[state.side].table.total[state.track])}`);
  drawDetail();
  markRows();
  lanes.reveal();
  redraw();
}

// Change some values of the selection; the others stay.
function choose(change) {
  Object.assign(state, "track" in change ? { repair: null } : {}, change);
  if (state.step !== null && (state.step < state.from || state.step > state.to)) {
    const size = span(), from = Math.min(Math.max(state.step - (size >> 1), 0), steps - size);
    Object.assign(state, { from, to: from + size - 1 });
  }
  const hash = `#${address(state)}`;
  // The entry in the history is replaced, so that going back leaves the page.
  if (hash !== location.hash) history.replaceState(null, "", hash === "#" ? location.pathname + location.search : hash);
  refresh();
}
function setRange(from, to) {
  const low = Math.max(Math.min(from, steps - 1), 0), high = Math.min(Math.max(to, low), steps - 1);
  choose({ from: low, to: high, step: state.step !== null && state.step >= low && state.step <= high ? state.step : null });
}

function act(name) {
  const { step, from, to } = state, middle = step ?? Math.round((from + to) / 2);
  if (name === "back") choose({ step: Math.max((step ?? 1) - 1, 0) });
  if (name === "forth") choose({ step: Math.min((step ?? from - 1) + 1, steps - 1) });
  if (name === "next" || name === "previous") {
    const mine = state.side === "truth" ? (switchesOf.truth.get(state.track) || []).map((k) => doc.switches.step[k]) : switchSteps;
    const jump = name === "next" ? mine.find((k) => k > (step ?? -1)) : mine.findLast((k) => k < (step ?? steps));
    if (jump !== undefined) choose({ step: jump });
  }
  if (name === "in" || name === "out") {
    const size = Math.min(Math.max(Math.round(span() * (name === "in" ? 0.5 : 2)), 4), steps);
    const low = Math.min(Math.max(middle - (size >> 1), 0), steps - size);
    setRange(low, low + size - 1);
  }
  if (name === "all") setRange(0, steps - 1);
  if (name === "clear") choose({ step: null, side: null, track: null });
}
for (const button of document.querySelectorAll("[data-do]")) button.addEventListener("click", () => act(button.dataset.do));
document.getElementById("step").addEventListener("change", (event) => {
  const step = stepOf.get(event.target.value.trim());
  event.target.setCustomValidity(step === undefined && event.target.value.trim() ? "no step has this time" : "");
  event.target.reportValidity();
  if (step !== undefined) choose({ step });
});
document.addEventListener("keydown", (event) => { if (event.key === "Escape") act("clear"); });
addEventListener("hashchange", () => { if (location.hash !== "#main") { readAddress(); refresh(); } });
addEventListener("resize", redraw);
// The width of a picture also changes if a scroll bar appears.
const resized = new ResizeObserver(redraw);
for (const view of [lanes.box, plane.canvas]) resized.observe(view);
const forget = () => { style = null; patterns.clear(); plane.drawn = null; };
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { forget(); redraw(); });
for (const [name, on] of [["beforeprint", true], ["afterprint", false]]) {
  addEventListener(name, () => {
    printing = on;
    document.documentElement.classList.toggle("printing", on);
    forget();
    drawNow();
  });
}

function say(text) {
  const notice = document.getElementById("notice");
  notice.textContent = text;
  notice.hidden = false;
}
async function begin() {
  if (!steps) {
    document.getElementById("main").hidden = true;
    say("Neither file has a row: there is nothing to draw.");
    document.documentElement.dataset.ready = "yes";
    return;
  }
  const arrays = await readArrays();
  for (const name of ["truth", "estimate"]) sides[name] = makeSide(name, arrays);
  lanes.arrange();
  plane.arrange();
  views.push(lanes, costs, plane, curve, ...[nees, windows].filter(Boolean));
  readAddress();
  worstTables();
  for (const name of ["truth", "estimate"]) trackTable(name);
  fitMargin();
  lanes.draw(); // before refresh(), which scrolls to a lane and needs its height
  refresh();
  drawNow();
  document.documentElement.dataset.ready = "yes";
}
begin().catch((error) => {
  say(`The pictures could not be drawn: ${error.message}. The page needs a browser of 2023 or later.`);
  throw error;
});
