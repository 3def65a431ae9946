// Repairs of the estimate: a click on a row selects the tracks that its repair concerns.
const { repairs } = doc;

// Tracks that a repair concerns: the estimates that it changes, and the truths assigned to them.
// These are the truths during the steps of the repair, the last one before, and the first one after.
function concerned(k) {
  const involved = { truth: new Set(), estimate: new Set(repairs.tracks[k]) }, { run } = sides.estimate;
  const from = repairs.from[k], to = repairs.to[k] === NONE ? from : repairs.to[k];
  for (const track of repairs.tracks[k]) {
    let before = NONE, after = NONE;
    for (let r = run.first[track]; r < run.first[track + 1]; r++) {
      if (run.other[r] < 0) continue;
      if (run.end[r] < from) before = run.other[r];
      else if (run.begin[r] <= to) involved.truth.add(run.other[r]);
      else if (after === NONE) after = run.other[r];
    }
    for (const other of [before, after]) if (other !== NONE) involved.truth.add(other);
  }
  involved.truth = new Set([...involved.truth].sort((a, b) => a - b));
  return involved;
}
let about = null;
function selectRepair(k) {
  const [track] = repairs.tracks[k], whole = track === undefined;
  return { repair: k, side: whole ? null : "estimate", track: whole ? null : track, step: repairs.from[k] === NONE ? null : repairs.from[k] };
}
// Return whether a track belongs to the selection.
function isChosen(name, track) {
  return about ? about[name].has(track) : state.side === name && state.track === track;
}
document.getElementById("repairs")?.addEventListener("click", (event) => {
  const row = event.target.closest("tr[data-repair]");
  if (!row || event.ctrlKey || event.metaKey || event.shiftKey) return;
  event.preventDefault();
  choose(selectRepair(row.dataset.repair - 1));
});
