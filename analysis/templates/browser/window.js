// The live page and the session: what the server says of each kind is written into the page, as text and never as HTML.
"use strict";

const STALE_MS = 2000;
const byId = (id) => document.getElementById(id);
const root = byId("live") || byId("session") || byId("moved");
const texts = root ? JSON.parse(root.dataset.texts) : {};
const known = {};
let heardAt = 0;

function words(key, values = {}) {
  return (texts[key] ?? key).replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
}

function put(id, text) {
  const element = byId(id);
  if (element && element.textContent !== text) element.textContent = text;
}

// Formats a number, without the sign of a value that rounds to zero.
function fixed(value, digits) {
  if (value === null || value === undefined) return "–";
  return value.toFixed(digits).replace(/^-(?=[0.]+$)/, "");
}

// Puts rows of cells into a table's body, keeping what is there already; a cell is a text, or [text, class].
function rows(id, list) {
  const body = byId(id);
  if (!body) return;
  while (body.rows.length > list.length) body.deleteRow(-1);
  list.forEach((cells, at) => {
    const row = body.rows[at] ?? body.insertRow();
    while (row.cells.length > cells.length) row.deleteCell(-1);
    cells.forEach((cell, place) => {
      const [text, kind] = Array.isArray(cell) ? cell : [cell, place ? "" : "word"];
      const there = row.cells[place] ?? row.insertCell();
      if (there.textContent !== text) there.textContent = text;
      if (there.className !== kind) there.className = kind;
    });
  });
}

function items(id, list) {
  const holder = byId(id);
  if (!holder) return;
  while (holder.children.length > list.length) holder.lastChild.remove();
  list.forEach((text, at) => {
    const item = holder.children[at] ?? holder.appendChild(document.createElement("li"));
    if (item.textContent !== text) item.textContent = text;
  });
}

// ---------------------------------------------------------------------------------------------------------------------
// The figures of now, ten times a second.

function gauge(name, at, told) {
  const one = told.gauges[name], figure = byId(name);
  if (!figure) return;
  const zero = told.zero_mm ? told.zero_mm[at] : 0;
  put(name, one ? fixed(one.mm - zero, 4) : "–");
  figure.classList.toggle("old", !one || one.age_s > told.old_s);
  if (!one) return;
  const trend = one.trend_mm_s;
  const moves = trend === null || Math.abs(trend) < 0.0005 ? words("steady") : `${trend > 0 ? "▲ +" : "▼ "}${trend.toFixed(3)} mm/s`;
  const old = one.age_s > told.old_s ? words("old", { seconds: one.age_s.toFixed(0) }) : moves;
  put(`${name}-trend`, zero ? `${old} · ${words("less", { mm: fixed(zero, 4) })}` : old);
  put(`${name}-min`, `min ${fixed(one.min_mm === null ? null : one.min_mm - zero, 4)}`);
  put(`${name}-max`, `max ${fixed(one.max_mm === null ? null : one.max_mm - zero, 4)}`);
  const range = known.cell?.range_mm?.[at] ?? [one.min_mm ?? 0, one.max_mm ?? 1], bar = byId(`${name}-bar`);
  const span = Math.max(range[1] - range[0], 1e-9);
  bar.value = Math.min(Math.max((one.mm - range[0]) / span, 0), 1);
}

function lapWords(lap, sense) {
  const turn = sense === "acw" ? "acw ↺ " : sense === "cw" ? "cw ↻ " : "";
  const of = known.now.direction ? ` / ${known.cell?.laps ?? ""}` : "";
  return turn + words(`lap_${lap.place}`, { number: `${lap.number}${of}`, share: (100 * lap.share).toFixed(0) });
}

function showNow(told) {
  gauge("g1", 0, told);
  gauge("g2", 1, told);
  put("angle-name", `${words(told.angle_name)} °`);
  put("angle", fixed(told.angle_deg, 4));
  put("phi", `φ ${told.phi_deg === null ? "–" : `${fixed(told.phi_deg, 1)}°`}`);
  byId("lap-bar").value = told.lap.place === "lap" ? told.lap.share : 0;
  put("lap", known.cell ? lapWords(told.lap, told.sense) : "–");
  const recording = byId("recording");
  recording.classList.toggle("on", Boolean(told.recording));
  const what = [told.recording, told.test, told.direction].filter(Boolean).join(" ");
  put("recording", told.recording ? `● ${words("recording", { what })} ${fixed(told.seconds, 0)} s` : words("not_recording"));
  const tool = byId("tool");
  tool.setAttribute("visibility", told.phi_deg === null ? "hidden" : "visible");
  if (told.phi_deg !== null) {
    const [x, y] = placed(told.phi_deg, 0);
    tool.setAttribute("cx", x);
    tool.setAttribute("cy", y);
  }
  const axes = known.cell?.axes ?? told.joints_deg.map((_, at) => `${at + 1}`);
  rows("joints", told.joints_deg.map((deg, at) => [
    `${at + 1} ${axes[at] ?? ""}`, fixed(deg, 3), ["▼", "■", "▲"][1 + (told.joints_sense[at] ?? 0)], `${told.joints_reversals[at] ?? 0}`,
  ]));
}

// ---------------------------------------------------------------------------------------------------------------------
// Curves, trace, links, twice a second.

const MIDDLE = 66, REACH = 30;

function placed(deg, share) {
  const radius = MIDDLE + REACH * share, at = (deg * Math.PI) / 180;
  return [(radius * Math.cos(at)).toFixed(2), (-radius * Math.sin(at)).toFixed(2)];
}

function showCurve(name) {
  const told = known[name], scale = known.circle?.scale;
  if (!told || !scale) return;
  const path = told.pieces.map(([phi, error]) =>
    phi.map((deg, at) => `${at ? "L" : "M"}${placed(deg / 10, error[at] / 1e5 / scale).join(" ")}`).join("")).join("");
  byId(`${name}-path`).setAttribute("d", path);
  const unit = known.cell?.unit ?? "";
  put(`${name}-band`, told.band === null ? "–" : `${fixed(told.band, 4)} ${unit}${told.whole ? "" : "…"}`);
}

function showCircle() {
  showCurve("acw");
  showCurve("cw");
  const drawn = ["acw", "cw"].some((name) => known[name]?.band !== null && known[name]?.band !== undefined);
  put("reach", drawn ? words("reach", { size: `${Number(known.circle.scale.toPrecision(2))} ${known.cell?.unit ?? ""}` }) : "");
  const turns = byId("turns"), list = known.circle.turned, taken = [];
  while (turns.children.length > list.length) turns.lastChild.remove();
  list.forEach(([axis, deg, sense], at) => {
    const mark = turns.children[at] ?? turns.appendChild(document.createElementNS("http://www.w3.org/2000/svg", "text"));
    // Where another number stands already, this one moves along the circle to the next free place.
    const free = [0, 7, -7, 14, -14, 21, -21, 28, -28].map((by) => deg + by).find((one) =>
      taken.every((other) => Math.abs(((one - other + 540) % 360) - 180) >= 7)) ?? deg;
    taken.push(free);
    const [x, y] = placed(free, 1.2);
    mark.setAttribute("x", x);
    mark.setAttribute("y", y);
    mark.textContent = `${axis}`;
    mark.setAttribute("class", sense > 0 ? "acw" : sense < 0 ? "cw" : "");
  });
}

function showTrace(told) {
  const lines = told.g.map((line) => line.filter((value) => value !== null).map(Math.abs));
  const reach = Math.max(5, ...lines.flat());
  told.g.forEach((line, at) => {
    let pen = "M", path = "";
    line.forEach((value, place) => {
      if (value === null) { pen = "M"; return; }
      path += `${pen}${(300 + told.t[place] / 10).toFixed(1)} ${(50 - (48 * value) / reach).toFixed(1)}`;
      pen = "L";
    });
    byId(`trace-g${at + 1}`).setAttribute("d", path);
  });
  put("trace-scale", `±${(reach / 10).toFixed(1)} µm, 30 s`);
}

function showLinks(told) {
  rows("streams", told.streams.map((one) => [
    one.name,
    [words(known.now?.lost ? "last_known" : one.connected ? "connected" : "lost_link"), one.connected ? "word" : "word failed"],
    one.rate_hz.toFixed(1),
    [one.faults ? `${one.faults}; ${one.last_fault}` : words("no_faults"), "word"],
  ]));
  if (told.disk) {
    const share = (100 * told.disk.free) / Math.max(told.disk.size, 1);
    put("disk", words("disk", { free: (told.disk.free / 1e9).toFixed(1), share: share.toFixed(0) }));
    byId("disk").classList.toggle("failed", share < 5);
  }
  const now = known.now?.at_s ?? 0;
  items("events", told.events.map(([at, what]) => `${words("ago", { seconds: Math.max(0, now - at).toFixed(0) })} ${what}`));
}

// ---------------------------------------------------------------------------------------------------------------------
// The movement check: how far each joint is from the proposed posture.

function showToGo(told) {
  const now = byId("moved-now"), toGo = byId("moved-to-go");
  if (!now) return;
  document.querySelectorAll("[data-target]").forEach((cell, at) => {
    const deg = told.joints_deg[at];
    now.cells[at + 1].textContent = fixed(deg, 2);
    toGo.cells[at + 1].textContent = fixed(deg === null || deg === undefined ? null : Number(cell.dataset.target) - deg, 2);
  });
}

// ---------------------------------------------------------------------------------------------------------------------
// The session.

// Headline and tiles: each text as the server sends it; the segments of the bar are as long as their shares.
function showSummary(summary) {
  byId("summary").hidden = !summary;
  if (!summary) {
    byId("found-details").open = true;
    return;
  }
  put("summary-badge", summary.badge);
  byId("summary-badge").className = `badge ${summary.tone}`;
  put("summary-headline", summary.headline);
  items("summary-unknowns", summary.unknowns);
  put("summary-title", summary.error.title);
  put("summary-size", summary.error.size);
  put("summary-basis", summary.error.basis);
  items("summary-causes", summary.causes.map((cause) => `${cause.name} ${cause.percent}`));
  const bar = byId("summary-bar");
  while (bar.children.length > summary.causes.length) bar.lastChild.remove();
  summary.causes.forEach((cause, at) => {
    const segment = bar.children[at] ?? bar.appendChild(document.createElement("i"));
    segment.className = `c${at + 1}`;
    segment.style.flexGrow = cause.share;
  });
  put("summary-next", summary.next || "–");
  put("summary-command", summary.command);
}

function showSession(told) {
  const next = told.next, key = `next_${next.key}`;
  put("next-words", words(key, next));
  const line = byId("next");
  if (line) line.hidden = next.key === "none" && Boolean(byId("live"));
  if (!byId("session")) return;
  byId("found").hidden = !told.headline;
  showSummary(told.summary);
  put("headline", told.headline ?? "");
  put("accuracy", told.accuracy ?? "");
  items("remedies", told.remedies ?? []);
  rows("parts", (told.parts ?? []).map((one) => [
    `${one.fault ? "● " : ""}${one.part}`, `${(100 * one.share).toFixed(0)} %`, one.um.toFixed(1),
  ]));
  byId("corrected").hidden = !told.correction;
  put("correction", told.correction ?? "");
  byId("report").hidden = !told.report;
  const size = (one) => (one ? [one.um, one.u_um].filter((um) => um !== null).map((um) => um.toFixed(1)).join(" ± ") + " µm" : "–");
  items("before-after", (told.before_after ?? []).map((one) =>
    words(`where_${one.where}`, { before: size(one.before), after: size(one.after), expected: size(one.expected) })));
  rows("steps", (told.steps ?? []).map((one, at) => [
    `${at + 1} ${one.program}`, [words(`step_${one.state}`) + (one.why ? `: ${one.why}` : ""), "word"], [one.run, "word"],
  ]));
}

// ---------------------------------------------------------------------------------------------------------------------
// Hearing, and saying that nothing is heard.

const SHOW = {
  cell: (told) => { if (byId("live")) put("rig", told.name ?? words("no_cell")); drawStart(told); },
  now: (told) => { if (byId("live")) showNow(told); else showToGo(told); },
  acw: () => {}, cw: () => {},
  circle: () => { if (byId("live")) showCircle(); },
  trace: (told) => { if (byId("live")) showTrace(told); },
  links: (told) => { if (byId("live")) showLinks(told); },
  session: showSession,
  label: (told) => {
    for (const key of ["name", "test", "direction"]) {
      const field = byId(`label-${key}`);
      if (field && document.activeElement !== field) field.value = told[key] ?? "";
    }
  },
};

function drawStart(told) {
  const start = byId("start");
  if (!start || !told.circle) return;
  const [a, b] = placed(told.start_deg, -0.35), [c, d] = placed(told.start_deg, -0.1);
  start.setAttribute("d", `M${a} ${b}L${c} ${d}`);
}

function say() {
  const silent = performance.now() - heardAt;
  const stale = heardAt === 0 || silent > STALE_MS;
  const lost = (byId("live") || byId("moved")) && known.now?.lost;
  const state = byId("state");
  state.classList.toggle("stale", (stale && heardAt > 0) || Boolean(lost));
  root.classList.toggle("stale-all", stale || Boolean(lost));
  if (heardAt === 0) put("state", words("connecting"));
  else if (stale) put("state", words("stale", { seconds: (silent / 1000).toFixed(0) }));
  else if (lost) put("state", words("lost", { why: lost }));
  else put("state", known.now?.cut || words("fresh"));
}

let source = null;

function listen() {
  source?.close();
  source = new EventSource("/events");
  for (const kind of Object.keys(SHOW)) {
    source.addEventListener(kind, (event) => {
      known[kind] = JSON.parse(event.data);
      const isFirst = heardAt === 0;
      heardAt = performance.now();
      SHOW[kind](known[kind]);
      if (isFirst) say();
      if ((kind === "acw" || kind === "cw") && known.circle && byId("live")) showCircle();
    });
  }
  // A browser gives up where the answer is an error; it is asked again as long as the page is open.
  source.addEventListener("error", () => {
    if (source.readyState === EventSource.CLOSED && !document.hidden) setTimeout(listen, 2000);
  });
}

// A browser keeps six connections to one place: pages that nobody sees leave theirs to the one that is looked at.
document.addEventListener("visibilitychange", () => {
  if (!root) return;
  if (document.hidden) source?.close();
  else listen();
});

function control(form) {
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const button = form.querySelector("button");
    button.disabled = true;
    try {
      const answer = await fetch(form.action, { method: "POST", body: new URLSearchParams(new FormData(form)) });
      const told = (answer.headers.get("content-type") ?? "").includes("json") ? await answer.json() : { said: words("refused") };
      put("said", told.said || words("done"));
      if (told.ok && "reload" in form.dataset) location.reload();
    } catch {
      put("said", words("unreached"));
    }
    button.disabled = false;
  });
}

if (root) {
  listen();
  say();
  setInterval(say, 500);
  document.querySelectorAll("[data-control]").forEach(control);
}

// The button is for a browser without scripts.
byId("language")?.addEventListener("change", (event) => event.target.form.submit());
