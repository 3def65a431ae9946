// Tables of tracks, and of the worst steps and tracks; the selection in words. Each name is a link that selects.
function make(tag, content, attributes = {}) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  for (const item of Array.isArray(content) ? content : [content]) if (item !== null) element.append(item);
  return element;
}
// Return a link that changes the selection; its address contains only the values that it changes.
function link(text, selection) {
  const element = make("a", make("bdi", text), { href: `#${address(selection)}` });
  element.addEventListener("click", (event) => {
    if (event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    choose(selection);
  });
  return element;
}
const stepLink = (step) => link(time(step), { step });
const trackLink = (name, track, step) => track < 0 ? "none"
  : link(sides[name].label[track], step === undefined ? { side: name, track } : { side: name, track, step });

const FEW = 50;
function trackTable(name) {
  const side = sides[name], { table } = side, kind = name === "truth" ? "missed" : "false";
  const columns = [
    [word(name), (k) => table.id[k]],
    ...(table.class ? [["class", (k) => table.class[k]]] : []),
    ["steps", (k) => table.steps[k]],
    [`${word(kind)} steps`, (k) => table.unassigned_count[k]],
    ...(table.switch ? [["switches", (k) => table.switch_count[k]]] : []),
    ["total cost", (k) => table.total[k]],
    [word("localisation"), (k) => table.localisation[k]],
    [word(kind), (k) => table.unassigned[k]],
    ...(table.switch ? [["switch", (k) => table.switch[k]]] : []),
  ];
  const box = document.getElementById(`${name}-table`);
  let sorted = "total cost", falling = true, all = side.count <= FEW;
  const compare = new Intl.Collator("en", { numeric: true }).compare;
  function draw() {
    const [, key] = columns.find(([title]) => title === sorted), order = [...Array(side.count).keys()];
    order.sort((a, b) => {
      const way = typeof key(a) === "string" ? compare(key(a), key(b)) : key(a) - key(b);
      return (falling ? -way : way) || a - b;
    });
    const shown = all ? order : order.slice(0, FEW);
    const head = columns.map(([title]) => {
      const button = make("button", title, { type: "button" });
      button.addEventListener("click", () => {
        falling = sorted === title ? !falling : title !== word(name) && title !== "class";
        sorted = title;
        draw();
        box.querySelectorAll("thead button")[columns.findIndex(([other]) => other === title)].focus();
      });
      return make("th", button, { scope: "col", "aria-sort": sorted === title ? (falling ? "descending" : "ascending") : "none" });
    });
    const rows = shown.map((k) => make("tr", columns.map(([title, value]) => title === word(name)
      ? make("th", link(value(k), { side: name, track: k }), { scope: "row" })
      : make("td", typeof value(k) === "number" ? number(value(k)) : make("bdi", value(k)))), { "data-side": name, "data-track": k }));
    const parts = [make("table", [make("thead", make("tr", head)), make("tbody", rows)])];
    if (!all) {
      const more = make("button", `show all ${side.count}`, { type: "button", class: "more" });
      more.addEventListener("click", () => { all = true; draw(); box.querySelector("a")?.focus(); });
      parts.push(make("p", [`The first ${FEW} of ${side.count} in this order. `, more], { class: "small" }));
    }
    box.replaceChildren(...parts);
    if (!side.count) box.replaceChildren(make("p", "none"));
    markRows();
  }
  box.addEventListener("click", (event) => {
    const row = event.target.closest("tbody tr");
    if (row && !event.target.closest("a")) choose({ side: name, track: +row.dataset.track });
  });
  draw();
}

function markRows() {
  for (const row of document.querySelectorAll("tr[data-track], tr[data-step], tr[data-repair]")) {
    const { step, repair } = row.dataset;
    const chosen = step !== undefined ? +step === state.step : repair !== undefined ? repair - 1 === state.repair
      : isChosen(row.dataset.side, +row.dataset.track);
    row.classList.toggle("chosen", chosen);
    if (chosen) row.setAttribute("aria-current", "true"); else row.removeAttribute("aria-current");
  }
}

const WORST = 8;
const dearest = (values) => [...values.keys()].filter((k) => values[k] > 0).sort((a, b) => values[b] - values[a] || a - b).slice(0, WORST);
const why = (parts) => {
  const [name] = parts.reduce((a, b) => b[1] > a[1] ? b : a);
  return name;
};
function worstTables() {
  const tables = [];
  const add = (title, head, rows) => tables.push(make("table", [
    make("caption", title),
    make("thead", make("tr", head.map((text) => make("th", text, { scope: "col" })))),
    make("tbody", rows.length ? rows : make("tr", make("td", "none", { colspan: head.length }))),
  ]));
  // If the costs are means of several steps, the single costliest steps are in doc.worst.
  const several = doc.together > 1, { costs, counts } = several ? doc.worst : doc;
  const each = several ? doc.worst.t.map((_, k) => PARTS.reduce((sum, name) => sum + costs[name][k], 0)) : total;
  const switches = PARTS.includes("switch");
  add("Steps", ["step", "cost", word("missed"), word("false"), ...(switches ? ["switches"] : []), "mostly"], dearest(each).map((k) => make("tr", [
    make("th", several ? make("bdi", String(doc.worst.t[k])) : stepLink(k), { scope: "row" }), make("td", number(each[k])), make("td", number(counts.missed[k])),
    make("td", number(counts.false[k])), ...(switches ? [make("td", number(counts.switch[k]))] : []), make("td", why(PARTS.map((name) => [word(name), costs[name][k]]))),
  ], several ? {} : { "data-step": k })));
  for (const [name, title, kind] of [["truth", doc.words.truth ?? "Ground-truth objects", "missed"], ["estimate", doc.words.estimate ?? "Estimates", "false"]]) {
    const { table } = sides[name];
    if (table.total.length <= 5) continue;  // so few tracks are all in the table of tracks
    add(title, [word(name), "cost", `${word(kind)} steps`, ...(switches ? ["switches"] : []), "mostly"], dearest(table.total).map((k) => make("tr", [
      make("th", trackLink(name, k), { scope: "row" }), make("td", number(table.total[k])), make("td", number(table.unassigned_count[k])),
      ...(switches ? [make("td", number(table.switch_count[k]))] : []),
      make("td", why([["localisation", table.localisation[k]], [kind, table.unassigned[k]], ["switch", table.switch?.[k] ?? 0]].map(([part, cost]) => [word(part), cost]))),
    ], { "data-side": name, "data-track": k })));
  }
  document.getElementById("worst").replaceChildren(...tables);
}

const MANY = 12;
function list(items) {
  const shown = items.slice(0, MANY).map((item) => make("li", item));
  if (items.length > MANY) shown.push(make("li", `and ${items.length - MANY} more`));
  return make("ul", shown);
}
function switchItem(k) {
  const { step, truth, from, to, mass, cost } = doc.switches, half = mass[k] === 1 ? "" : `, ${number(mass[k])} of a switch`;
  return ["at ", stepLink(step[k]), ": truth ", trackLink("truth", truth[k], step[k]), " from ", trackLink("estimate", from[k], step[k]),
    " to ", trackLink("estimate", to[k], step[k]), `${half}, cost ${number(cost[k])}`];
}
function aloneAt(name, step) {
  const side = sides[name], links = [];
  for (let track = 0; track < side.count; track++) {
    const r = runAt(side, track, step);
    if (r >= 0 && side.run.other[r] === NONE) links.push(trackLink(name, track, step));
  }
  return links;
}
function joined(links) {
  const shown = links.slice(0, MANY).flatMap((item, k) => k ? [", ", item] : [item]);
  return links.length > MANY ? [...shown, ` and ${links.length - MANY} more`] : shown;
}

function drawDetail() {
  const parts = [];
  if (about) {
    const items = ["estimate", "truth"].filter((name) => about[name].size)
      .map((name) => [`${name}: `, ...joined([...about[name]].map((track) => trackLink(name, track)))]);
    parts.push(make("h3", `Repair ${state.repair + 1}`), make("p", [make("bdi", repairs.text[state.repair]), "."]), list(items));
  }
  if (state.step !== null) {
    parts.push(make("h3", `Step ${time(state.step)}`), make("p", `Cost ${number(total[state.step])}: ` +
      (PARTS.filter((name) => doc.costs[name][state.step] > 0).map((name) => `${word(name)} ${number(doc.costs[name][state.step])}`).join(", ") || "nothing wrong") + "."));
    const items = [];
    for (const [name, kind] of [["truth", "missed"], ["estimate", "false"]]) {
      const alone = aloneAt(name, state.step);
      if (alone.length) items.push([`${word(kind)}: `, ...joined(alone)]);
    }
    items.push(...(switchesOf.step.get(state.step) || []).map((k) => ["switch ", ...switchItem(k)]));
    if (items.length) parts.push(list(items));
  }
  if (state.track !== null && !(about?.estimate.size > 1)) {
    const side = sides[state.side], { table, run } = side, k = state.track, truth = state.side === "truth", kind = truth ? "missed" : "false";
    parts.push(make("h3", [doc.words[state.side] ?? (truth ? "Truth" : "Estimate"), " ", make("bdi", side.label[k])]),
      make("p", `${plural(table.steps[k], "step")}, ${number(table.unassigned_count[k])} ${word(kind)}${table.switch ? `, ${plural(table.switch_count[k], "switch", "switches")}` : ""}; ` +
        `cost ${number(table.total[k])}: ${word("localisation")} ${number(table.localisation[k])}, ${word(kind)} ${number(table.unassigned[k])}${table.switch ? `, switch ${number(table.switch[k])}` : ""}.`));
    if (state.step !== null) {
      const r = rowFrom(side, k, state.step), at = runAt(side, k, state.step);
      const error = truth && doc.columns.length && at >= 0 && run.other[at] >= 0 && side.row.step[r] === state.step
        ? `, ${doc.words.localisation ?? "error"} ${withUnit(side.row.error[r] / doc.errors * doc.cutoff)}` : "";
      parts.push(make("p", laneWords({ side, track: k }, state.step).split("\n")[0] + error + "."));
    }
    const runs = [], first = run.first[k], end = run.first[k + 1];
    // Of many runs, only those around the selected step are listed.
    let begin = first;
    while (state.step !== null && begin < end && run.end[begin] < state.step) begin++;
    begin = Math.max(first, Math.min(begin - (MANY >> 1), end - MANY));
    if (begin > first) runs.push(`${begin - first} before`);
    for (let r = begin; r < Math.min(begin + MANY, end); r++) {
      const stretch = run.begin[r] === run.end[r] ? ["at ", stepLink(run.begin[r])] : [stepLink(run.begin[r]), " to ", stepLink(run.end[r])];
      runs.push([...stretch, ...(run.other[r] < 0 ? [`: ${run.other[r] === FREE ? "not judged" : word(kind)}`] : [`: ${paired[truth ? 0 : 1]} `, trackLink(side.other, run.other[r])])]);
    }
    if (begin + MANY < end) runs.push(`and ${end - begin - MANY} more`);
    parts.push(make("ul", runs.map((item) => make("li", item))));
  }
  const detail = document.getElementById("detail");
  detail.parentElement.classList.toggle("idle", !parts.length);
  if (!parts.length) parts.push(make("p", "Click a step, a lane, a point or a row."));
  detail.replaceChildren(...parts);
}
