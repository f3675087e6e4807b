// The page: four steps beside a map. Everything it does is a request to the server, which works as the commands do.
import { CoverageMap, SORTIES, inside } from "/page/map.js";
import { t } from "/page/strings.js";
import { api, debounced, el, latest, number, percent } from "/page/dom.js";
import { profile, tradeoff } from "/page/charts.js";

const $ = (id) => document.getElementById(id);
const FORM = ["camera", "gsd", "overlap", "vehicle", "battery", "max_height", "speed", "autopilot", "vertical_datum"];
const state = {
  tab: "area", server: null, name: "", scene: null, layer: "", members: null,
  draft: { area: null, zones: [], home: null }, past: [], future: [], form: { name: "survey", gsd: "3cm", overlap: "75/70", dem: "" }, design: null,
  edit: null, jobs: new Map(), watched: new Map(), live: new Map(), background: "", contours: false,
};
const map = new CoverageMap($("map"));
window.uavcover = { state, map }; // for tests and for the curious

// ---------------------------------------------------------------- messages
function say(text, kind = "") {
  const line = el("p", { class: kind }, text);
  $("messages").append(line);
  while ($("messages").childElementCount > 300) $("messages").firstChild.remove();
  $("messages").scrollTop = $("messages").scrollHeight;
}
const fail = (error) => say(error.message ?? String(error), "error");
async function attempt(call) { try { return await call(); } catch (error) { fail(error); return null; } }

// ---------------------------------------------------------------- server
async function refresh() {
  state.server = await api("/api/state");
  for (const job of state.server.jobs) { const known = state.jobs.get(job.id); if (!known) state.jobs.set(job.id, { ...job, events: [], end: 0 }); } // news of known ones come by the socket
}

let socket = null, wait = 500;
function connect() {
  socket = new WebSocket(`ws://${location.host}/ws`);
  socket.onopen = () => {
    wait = 500;
    $("link").textContent = t("connected");
    for (const [run, from] of state.watched) send({ watch: run, from });
    for (const job of state.jobs.values()) if (job.code === null) send({ job: job.id, from: job.end ?? 0 });
  };
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onclose = () => { $("link").textContent = t("reconnecting"); setTimeout(connect, wait); wait = Math.min(5000, wait * 2); };
}
function send(message) { if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); }
function watch(run) { if (!state.watched.has(run)) { state.watched.set(run, 0); send({ watch: run, from: 0 }); } }

function take(message) {
  if (message.error) { say(message.error, "error"); return; }
  if (message.samples) {
    state.watched.set(message.run, message.from + message.samples.length);
    const number_ = [...state.watched.keys()].indexOf(message.run);
    const live = state.live.get(message.run) ?? {};
    Object.assign(live, { last: message.samples.at(-1), count: message.from + message.samples.length });
    state.live.set(message.run, live);
    map.live(message.run, message.from, message.samples, number_ ? SORTIES[number_ % SORTIES.length] : "#d000a0");
    drawOrders();
  }
  if (message.coverage) {
    const live = state.live.get(message.run) ?? {};
    live.covered = message.coverage.covered;
    state.live.set(message.run, live);
    if (message.run === state.name || message.run.startsWith(`${state.name}/`)) {
      map.cells(message.coverage.image, message.coverage.corners);
      legendOf(t("covered"), [["#009e73", t("seen")], ["#d55e00", t("unseen")]]);
    }
    drawOrders();
  }
  if (message.job && message.events) {
    const job = state.jobs.get(message.job);
    if (!job) return;
    job.end = message.end;
    for (const event of message.events) takeEvent(job, event);
    drawJob();
  }
  if (message.job && message.state) {
    const known = state.jobs.get(message.job), before = known?.code;
    state.jobs.set(message.job, { ...(known ?? { events: [] }), ...message.state, events: known?.events ?? [], end: known?.end ?? 0 });
    if (!known && message.state.code === null) { send({ job: message.job, from: 0 }); if (message.state.kind === "fly") watch(message.state.run); }
    if (known && before === null && message.state.code !== null) attempt(() => ended(state.jobs.get(message.job)));
    drawJob();
  }
}
function takeEvent(job, event) {
  if (event.progress) job.progress = event.progress;
  else if (event.status) job.status = event.status;
  else if (event.warn) { say(event.warn, "warn"); }
  else if (event.say !== undefined && event.say.trim() && !event.say.startsWith("{")) say(event.say, event.say.startsWith("error:") ? "error" : "");
  if (event.route) map.set("incumbent", [{ type: "Feature", properties: {}, geometry: { type: "LineString", coordinates: event.route } }]);
  job.events.push(event);
  if (job.events.length > 500) job.events.shift();
}
async function start(kind, asked) {
  const job = await api("/api/jobs", { kind, ...asked });
  follow(job);
  return job;
}
function follow(job) {
  state.jobs.set(job.id, { ...job, events: [], end: 0 });
  say(`$ ${job.command.filter((word) => word !== "--json" && word !== "--events").join(" ")}`);
  send({ job: job.id, from: 0 });
  if (job.kind === "fly") watch(job.run);
  drawJob();
}
const running = (kind) => [...state.jobs.values()].filter((job) => job.code === null && (!kind || job.kind === kind)).at(-1);
const signal = (job, action) => attempt(() => api(`/api/jobs/${job.id}/${action}`, {}));

// A command has ended: show what it wrote.
async function ended(job) {
  map.set("incumbent", []);
  if (job.code !== 0) say(`${job.kind}: ${t("ended")} (${job.code})`, job.code === 130 || job.code === 1 ? "warn" : "error");
  await refresh();
  const isThere = state.server.files.runs.some((run) => run.name === job.run) || job.run === state.name;
  if (["plan", "edit"].includes(job.kind) && isThere) { state.edit = null; await openScene(job.run, "plan"); }
  else if (["select", "upload", "verify", "gaps"].includes(job.kind) && job.run === state.name) await openScene(job.run, state.tab, { keepView: true });
  else if (job.kind === "fly") { state.watched.delete(job.run); if (job.run === state.name || job.run.startsWith(`${state.name}/`)) await openScene(state.name, "judge", { keepView: true }); }
  else if (["export", "report"].includes(job.kind) && job.code === 0) offer(job);
  drawPanel();
}
function offer(job) {
  const files = job.result?.files ?? job.result?.written ?? [job.result?.file ?? job.result?.report ?? job.result?.out].filter(Boolean);
  for (const file of files.map((f) => f.file ?? f)) {
    const path = String(file);
    $("messages").append(el("p", {}, el("a", { href: `/files/${path.split("/").map(encodeURIComponent).join("/")}`, download: true }, `${t("download")}: ${path}`)));
  }
  $("messages").scrollTop = $("messages").scrollHeight;
}

// ---------------------------------------------------------------- what is open
async function openScene(name, tab, { keepView = false } = {}) {
  const scene = await api(`/api/scene?name=${encodeURIComponent(name)}`);
  Object.assign(state, { name, scene, edit: null, tab: tab ?? state.tab });
  map.scene(scene);
  map.heights(scene.onEarth || true ? `name=${encodeURIComponent(name)}` : "");
  if (!keepView) map.fit(scene.bounds);
  state.layer = scene.layers?.[0]?.key ?? "";
  showLayer();
  if (state.contours) await showContours(true);
  profile($("profile"), scene.profile ?? []);
  $("place").textContent = scene.description ? `${name} — ${scene.description}` : name;
  if (!scene.onEarth) say(t("local"), "warn");
  for (const warning of scene.warnings ?? []) say(warning, "warn");
  for (const job of state.jobs.values()) if (job.kind === "fly" && job.code === null && (job.run === name || job.run.startsWith(`${name}/`))) watch(job.run);
  if (runs().some((run) => run.name === name && run.flying)) watch(name);
  drawTabs(); drawPanel(); drawTools(); drawJob();
}
function showLayer() {
  const layer = state.scene?.layers?.find((each) => each.key === state.layer);
  map.cells(layer?.image ?? "", state.scene?.corners);
  legendOf(layer?.title ?? "", layer?.legend.map((entry) => [entry.color, entry.label]) ?? []);
}
function legendOf(title, entries) {
  $("legend").hidden = !title;
  $("legend").replaceChildren(el("strong", {}, title), ...entries.map(([color, label]) => { const box = el("i"); box.style.background = color; return el("div", {}, box, label); }));
}
async function showContours(on) {
  state.contours = on;
  map.contours([]);
  if (on && state.name) { const found = await attempt(() => api(`/api/contours?name=${encodeURIComponent(state.name)}`)); if (found) map.contours(found.lines); }
}
const runs = () => state.server?.files.runs ?? [];
const ofRun = () => state.scene && state.scene.plan ? state.name : "";

// ---------------------------------------------------------------- tabs and tools
function drawTabs() {
  $("tabs").replaceChildren(...["area", "plan", "fly", "judge"].map((tab) => el("button", {
    type: "button", role: "tab", id: `tab-${tab}`, "aria-selected": String(state.tab === tab), "aria-controls": "panel", onclick: () => { state.tab = tab; drawTabs(); drawPanel(); },
  }, t(`tab${tab[0].toUpperCase()}${tab.slice(1)}`))));
}
function toggle(label, on, call) { return el("button", { type: "button", "aria-pressed": String(on), onclick: () => { call(!on); drawTools(); } }, label); }
function drawTools() {
  const layers = state.scene?.layers ?? [], backgrounds = state.server?.files.backgrounds ?? [];
  $("tools").replaceChildren(
    el("button", { type: "button", onclick: () => map.fit(state.scene?.bounds ?? boundsOfDraft()) }, t("fit")),
    toggle(t("terrain3d"), map.terrain, (on) => map.show3d(on)),
    toggle(t("contours"), state.contours, (on) => attempt(() => showContours(on))),
    ...(layers.length ? [select(t("layers"), [["", t("layerNone")], ...layers.map((l) => [l.key, l.title])], state.layer, (key) => { state.layer = key; showLayer(); })] : []),
    ...(backgrounds.length ? [select(t("background"), [["", t("noBackground")], ...backgrounds.map((b) => [b.name, b.name])], state.background, (file) => { state.background = file; map.background(file); })] : []),
  );
}
function select(label, options, value, onchange) {
  return el("select", { "aria-label": label, onchange: (event) => onchange(event.target.value) }, options.map(([key, text]) => el("option", { value: key, selected: key === value }, text)));
}
function field(name, label, input, error) {
  return el("label", { for: `f-${name}` }, el("span", {}, label), input, error ? el("span", { class: "error", role: "alert", id: `e-${name}` }, error) : null);
}

// ---------------------------------------------------------------- panel
function drawPanel() {
  const panel = $("panel"), focused = document.activeElement?.id, at = panel.scrollTop;
  panel.replaceChildren(...({ area: areaPanel, plan: planPanel, fly: flyPanel, judge: judgePanel }[state.tab]()).filter(Boolean));
  panel.scrollTop = at;
  if (focused && focused !== "panel") $(focused)?.focus();
  drawJob();
}
const heading = (text) => el("h2", {}, text);
const button = (label, onclick, more = {}) => el("button", { type: "button", onclick, ...more }, label);

function areaPanel() {
  const files = state.server?.files ?? { scenarios: [], runs: [], areas: [], elevation: [] };
  const choices = [["", t("openChoose")], ...files.runs.map((r) => [r.name, r.name]), ...files.scenarios.map((s) => [s.name, s.name])];
  const opener = select(t("open"), choices, state.name, (name) => name && attempt(() => openScene(name, runs().some((r) => r.name === name) ? "plan" : "area")));
  opener.id = "f-open";
  const chooser = el("input", { type: "file", multiple: true, id: "f-files", onchange: (event) => attempt(() => takeFiles([...event.target.files])) });
  const drop = el("div", { class: "drop", ondragover: (e) => { e.preventDefault(); drop.classList.add("over"); }, ondragleave: () => drop.classList.remove("over"), ondrop: (e) => { e.preventDefault(); drop.classList.remove("over"); attempt(() => takeFiles([...e.dataTransfer.files])); } },
    el("label", { for: "f-files" }, t("drop")), chooser, el("p", { class: "hint" }, t("dropHint")));
  return [
    heading(t("open")), el("label", { for: "f-open" }, el("span", {}, t("openChoose")), opener), button(t("newSurvey"), newSurvey), drop,
    ...(state.scene ? [sceneFigures()] : surveyForm(files)),
  ];
}
function sceneFigures() {
  const s = state.scene;
  return el("dl", {}, ...[[t("areaSize"), `${number(s.areaM2 / 1e4, 2)} ${t("ha")}`], [t("band"), `${number(s.band[0])} – ${number(s.band[1])} m`], [t("camera"), s.camera], [t("autopilot"), s.vehicle.autopilot], [t("speed"), `${number(s.vehicle.speed, 1)} m/s`]].flatMap(([k, v]) => [el("dt", {}, k), el("dd", {}, v)]));
}
function surveyForm(files) {
  const error = state.design?.error, of = state.design?.field ?? "", wrong = (name) => (error && of === name ? error : "");
  const text = (name, label, more = {}) => field(name, label, el("input", { id: `f-${name}`, value: state.form[name] ?? "", oninput: (e) => { state.form[name] = e.target.value; redesign(); }, "aria-invalid": wrong(name) ? "true" : null, ...more }), wrong(name));
  const list = (name, label, options) => field(name, label, el("select", { id: `f-${name}`, onchange: (e) => { state.form[name] = e.target.value; if (name === "dem") map.heights(e.target.value ? `dem=${encodeURIComponent(e.target.value)}` : ""); redesign(); } }, [["", t("none")], ...options].map(([key, title]) => el("option", { value: key, selected: key === (state.form[name] ?? "") }, title))), wrong(name));
  return [
    heading(t("drawArea")),
    el("div", { class: "row" }, button(t("drawArea"), () => drawShape("area")), button(t("drawHole"), () => drawShape("hole"), { disabled: !state.draft.area }), button(t("drawZone"), () => drawShape("zone")),
      button(t("editShapes"), editShapes), button(t("setHome"), placeHome), button(t("undo"), undo, { disabled: !state.past.length, id: "undo" }), button(t("redo"), redo, { disabled: !state.future.length, id: "redo" })),
    el("p", { class: "hint" }, t("drawHint")),
    positionInput(),
    ...zoneTable(),
    heading(t("planWith")),
    list("dem", `${t("dem")} (${t("required")})`, files.elevation.map((f) => [f.name, f.name])),
    list("vertical_datum", t("datum"), ["EGM96", "EGM2008", "ellipsoid"].map((d) => [d, d])),
    list("camera", `${t("camera")} (${t("required")})`, (state.server?.cameras ?? []).map((c) => [c.name, c.title || c.name])),
    el("div", { class: "row" }, text("gsd", t("gsd")), text("overlap", t("overlap"))),
    list("vehicle", t("vehicle"), (state.server?.vehicles ?? []).map((v) => [v.name, v.title || v.name])),
    el("div", { class: "row" }, text("battery", t("battery"), { placeholder: "25min" }), text("max_height", t("maxHeight"), { placeholder: "120m" }), text("speed", t("speed"), { placeholder: "10m/s" })),
    list("autopilot", t("autopilot"), [["ardupilot", "ArduPilot"], ["px4", "PX4"]]),
    el("div", { id: "design", "aria-live": "polite" }, ...designFigures()),
    text("name", t("name")),
    button(t("save"), () => attempt(saveScenario), { class: "main", id: "save" }),
  ];
}
function designFigures() {
  const d = state.design;
  if (!d) return [];
  if (d.error) return [el("p", { class: "error" }, d.error)];
  const flight = d.flights[0], f = d.figures;
  return [heading(t("follows")), el("dl", {}, ...[
    [t("areaSize"), `${number(f.area_m2 / 1e4, 2)} ${t("ha")}`], [t("band"), `${number(f.min_height_agl_m)} – ${number(f.max_height_agl_m)} m`], [t("lines"), `${number(f.line_distance_m, 1)} m`], [t("photoEvery"), `${number(f.picture_distance_m, 1)} m, ${number(f.speed_m_s, 1)} m/s`],
    [t("photos"), number(flight.pictures)], [t("minutes"), number(flight.flight_time_s / 60, 1)], ...(flight.batteries ? [[t("batteries"), number(flight.batteries)]] : []),
  ].flatMap(([k, v]) => [el("dt", {}, k), el("dd", {}, v)])), ...d.messages.filter((m) => m.warn).map((m) => el("p", { class: "warn" }, m.warn))];
}
function zoneTable() {
  if (!state.draft.zones.length) return [];
  const cell = (zone, key, label) => el("td", {}, el("input", { "aria-label": `${label}, ${zone.name}`, value: zone[key] ?? "", onchange: (e) => { remember(); zone[key] = e.target.value; drawDraft(); redesign(); } }));
  return [heading(t("zones")), el("table", {}, el("tr", {}, ...["zoneName", "zoneFloor", "zoneCeiling"].map((k) => el("th", { scope: "col" }, t(k))), el("td", {})),
    ...state.draft.zones.map((zone, n) => el("tr", {}, cell(zone, "name", t("zoneName")), cell(zone, "floor_agl_m", t("zoneFloor")), cell(zone, "ceiling_agl_m", t("zoneCeiling")), el("td", {}, button("✕", () => { remember(); state.draft.zones.splice(n, 1); drawDraft(); redesign(); drawPanel(); }, { "aria-label": `${t("remove")}: ${zone.name}` })))))];
}
function positionInput() {
  const input = el("input", { id: "f-position", placeholder: "47.37, 8.54", "aria-describedby": "position-hint" });
  const place = async () => (await api(`/api/place?text=${encodeURIComponent(input.value)}`)).place;
  return el("div", {}, field("position", t("position"), input), el("p", { class: "hint", id: "position-hint" }, t("positionHint")), el("div", { class: "row" },
    button(t("go"), () => attempt(async () => map.map.jumpTo({ center: await place(), zoom: 14 }))), button(t("here"), () => attempt(async () => { remember(); state.draft.home = await place(); drawDraft(); redesign(); }))));
}
function newSurvey() {
  Object.assign(state, { name: "", scene: null, draft: { area: null, zones: [], home: null }, past: [], future: [], design: null, edit: null, layer: "" });
  map.scene(null); map.cells(""); map.contours([]); map.heights(state.form.dem ? `dem=${encodeURIComponent(state.form.dem)}` : "");
  profile($("profile"), []); $("place").textContent = ""; showLayer(); drawPanel(); drawTools();
}

// ---------------------------------------------------------------- drawing
const copyOf = (value) => JSON.parse(JSON.stringify(value));
function remember() { state.past.push(copyOf(state.draft)); state.future = []; if (state.past.length > 100) state.past.shift(); }
function undo() { if (state.edit) { moveInTime(state.edit, "past", "future"); return; } if (!state.past.length) return; state.future.push(copyOf(state.draft)); state.draft = state.past.pop(); drawDraft(); redesign(); drawPanel(); }
function redo() { if (state.edit) { moveInTime(state.edit, "future", "past"); return; } if (!state.future.length) return; state.past.push(copyOf(state.draft)); state.draft = state.future.pop(); drawDraft(); redesign(); drawPanel(); }
function drawDraft() {
  const polygons = (geometry) => (geometry?.type === "MultiPolygon" ? geometry.coordinates : geometry ? [geometry.coordinates] : []);
  map.set("area", polygons(state.draft.area).map((rings) => ({ type: "Feature", properties: {}, geometry: { type: "Polygon", coordinates: rings } })));
  map.set("zones", state.draft.zones.map((zone) => ({ type: "Feature", properties: { name: zone.name }, geometry: zone.geometry })));
  map.set("home", state.draft.home ? [{ type: "Feature", properties: {}, geometry: { type: "Point", coordinates: state.draft.home } }] : []);
}
function boundsOfDraft() {
  const flat = JSON.stringify(state.draft.area ?? "").match(/-?\d+(?:\.\d+)?(?:e-?\d+)?,-?\d+(?:\.\d+)?(?:e-?\d+)?/g);
  if (!flat) return null;
  const places = flat.map((pair) => pair.split(",").map(Number));
  return [Math.min(...places.map((p) => p[0])), Math.min(...places.map((p) => p[1])), Math.max(...places.map((p) => p[0])), Math.max(...places.map((p) => p[1]))];
}
function drawShape(what) {
  stopDrawing();
  map.draw.setMode("polygon");
  map.map.getCanvas().focus();
  const finished = (id) => {
    const shape = map.draw.getSnapshotFeature(id);
    stopDrawing();
    if (!shape) return;
    remember();
    const ring = shape.geometry.coordinates[0];
    if (what === "zone") state.draft.zones.push({ name: `zone ${state.draft.zones.length + 1}`, geometry: { type: "Polygon", coordinates: [ring] } });
    else if (what === "hole") addHole(ring);
    else addArea(ring);
    drawDraft(); redesign(); drawPanel();
  };
  map.draw.on("finish", finished);
  state.drawing = finished;
}
function addArea(ring) {
  const before = state.draft.area;
  const polygons = before?.type === "MultiPolygon" ? before.coordinates : before ? [before.coordinates] : [];
  state.draft.area = { type: "MultiPolygon", coordinates: [...polygons, [ring]] };
}
function addHole(ring) {
  const polygons = state.draft.area.type === "MultiPolygon" ? state.draft.area.coordinates : [state.draft.area.coordinates];
  const owner = polygons.find((rings) => inside(ring[0], rings[0]));
  if (owner) owner.push(ring); else say(t("drawHole"), "warn");
  state.draft.area = { type: "MultiPolygon", coordinates: polygons };
}
function stopDrawing() {
  if (state.drawing) map.draw.off("finish", state.drawing);
  state.drawing = null;
  map.draw.clear();
  map.draw.setMode("static");
}
function editShapes() {
  stopDrawing();
  const polygons = state.draft.area?.type === "MultiPolygon" ? state.draft.area.coordinates : state.draft.area ? [state.draft.area.coordinates] : [];
  const features = [
    ...polygons.map((rings, n) => ({ type: "Feature", properties: { mode: "polygon", of: "area", n }, geometry: { type: "Polygon", coordinates: [rings[0]] } })),
    ...state.draft.zones.map((zone, n) => ({ type: "Feature", properties: { mode: "polygon", of: "zone", n }, geometry: zone.geometry })),
  ];
  if (!features.length) return;
  map.draw.setMode("select");
  map.draw.addFeatures(copyOf(features));
  const finished = () => {
    remember();
    for (const each of map.draw.getSnapshot()) {
      if (each.properties.of === "area") polygons[each.properties.n][0] = each.geometry.coordinates[0];
      if (each.properties.of === "zone") state.draft.zones[each.properties.n].geometry = each.geometry;
    }
    state.draft.area = polygons.length ? { type: "MultiPolygon", coordinates: polygons } : null;
    drawDraft(); redesign(); drawPanel();
  };
  map.draw.on("finish", finished);
  state.drawing = finished;
}
function placeHome() {
  stopDrawing();
  say(t("homeHint"));
  map.map.once("click", (event) => { remember(); state.draft.home = [event.lngLat.lng, event.lngLat.lat]; drawDraft(); redesign(); drawPanel(); });
}
function formBody() {
  const { home, area, zones } = state.draft, body = { ...state.form, area, zones, dem: state.form.dem ? [state.form.dem] : [] };
  if (home) body.home = `${home[1]},${home[0]}`;
  return body;
}
const askDesign = latest(async () => {
  if (!state.draft.area || !state.form.dem || !state.form.camera) { state.design = null; return; }
  state.design = await attempt(() => api("/api/design", formBody()));
  const place = $("design");
  if (state.tab === "area" && !state.scene && place) { place.replaceChildren(...designFigures()); for (const name of FORM) $(`f-${name}`)?.setAttribute("aria-invalid", String(state.design?.field === name)); }
});
const redesign = debounced(askDesign, 350);
async function saveScenario() {
  const saved = await api("/api/scenarios", formBody());
  for (const message of saved.messages) say(message.warn ?? message.say, message.warn ? "warn" : "");
  say(`${t("saved")}: ${saved.scenarios.join(", ")}`);
  await refresh();
  await openScene(saved.scenarios[0], "plan");
}
async function takeFiles(files) {
  for (const file of files) {
    say(`${file.name}…`);
    const answer = await fetch(`/api/files/${encodeURIComponent(file.name)}`, { method: "PUT", body: file, credentials: "same-origin" });
    const { name, error } = await answer.json();
    if (!answer.ok) { say(error, "error"); continue; }
    await refresh();
    const is = (list) => state.server.files[list].some((entry) => entry.name === name);
    if (is("elevation")) { state.form.dem = name; map.heights(`dem=${encodeURIComponent(name)}`); }
    else if (is("scenarios")) { await openScene(name, "plan"); continue; }
    else if (is("areas")) { if (state.scene) newSurvey(); await loadArea(name); }
    redesign();
  }
  drawPanel(); drawTools();
}
async function loadArea(name) {
  const found = await api(`/api/area?name=${encodeURIComponent(name)}`);
  for (const note of found.notes) say(note, "warn");
  remember();
  state.draft.area = found.geometry;
  if (found.name) state.form.name = found.name.replace(/[^A-Za-z0-9._ -]/g, "-").replace(/^[^A-Za-z0-9]+/, "").slice(0, 60) || "survey";
  drawDraft(); map.fit(boundsOfDraft());
}

// ---------------------------------------------------------------- plan
function planPanel() {
  if (!state.name) return [heading(t("planWith")), el("p", { class: "hint" }, t("noScenario"))];
  const s = state.scene, out = [heading(t("planWith"))], budget = select(t("budget"), ["5s", "10s", "30s", "60s", "5m"].map((b) => [b, b]), state.budget ?? "30s", (b) => { state.budget = b; });
  budget.id = "f-budget";
  const scenario = s.plan ? `${state.name}/scenario.toml` : state.name;
  out.push(sceneFigures(), field("budget", t("budget"), budget), el("div", { class: "row" }, button(t("plan"), () => attempt(() => start("plan", { scenario, budget: state.budget ?? "30s", seed: state.seed })), { class: "main", id: "plan", disabled: Boolean(running("plan")) })), el("div", { id: "job" }));
  if (!s.plan) return out;
  const m = s.plan.metrics;
  out.push(el("dl", { id: "figures" }, ...[[t("coverage"), percent(m.coverage_of_coverable, 2)], [t("waypoints"), m.waypoint_count], [t("length"), `${number(m.path_length_m)} m`], [t("time"), `${number((m.mission_time_s ?? m.flight_time_s) / 60, 1)} min`], [t("flights"), s.sorties.length], [t("rule"), `${s.plan.select}: ${s.plan.rule_met ? t("ruleMet") : t("ruleNotMet")}`], ...(s.plan.made_by === "edited" ? [["", t("edited")]] : [])].flatMap(([k, v]) => [el("dt", {}, k), el("dd", {}, v)])));
  if (s.members.length > 1) out.push(el("figure", { class: "chart" }, el("figcaption", { class: "hint" }, t("tradeoff")), tradeoff(s.members, (member) => attempt(() => start("select", { run: state.name, rule: `index:${member.index}` })))));
  out.push(...waypointEditor(), ...exporter());
  return out;
}
function exporter() {
  const formats = ["waypoints", "plan", "kml", "geojson", "csv", "gpx", "wpml", "litchi", "print"];
  const format = select(t("exportAs"), formats.map((f) => [f, f]), state.format ?? "plan", (f) => { state.format = f; });
  return [heading(t("exportAs")), el("div", { class: "row" }, format, button(t("export"), () => attempt(() => start("export", { run: state.name, format: state.format ?? "plan", drone: state.format === "wpml" ? "dji-m3e" : "" })), { id: "export" }), button(t("report"), () => attempt(() => start("report", { run: state.name, force: true }))))];
}
function waypointEditor() {
  const edit = state.edit;
  if (!edit) return [heading(t("points")), button(t("edit"), beginEdit, { id: "edit", disabled: state.scene.sorties.length > 1 || Boolean(running()) })];
  const rows = edit.points.map((p, n) => el("tr", {}, el("th", { scope: "row" }, button(String(n + 1), () => { edit.chosen = n; showEdit(); drawPanel(); }, { "aria-pressed": String(edit.chosen === n), "aria-label": `${t("point")} ${n + 1}` })),
    ...[[1, "lat", 6], [0, "lon", 6], [2, "agl", 1]].map(([axis, label, digits]) => el("td", {}, el("input", { "aria-label": `${t(label)}, ${t("point")} ${n + 1}`, inputmode: "decimal", value: number(p[axis], digits), onchange: (e) => { const value = Number(e.target.value); if (!Number.isFinite(value)) return; keep(edit); p[axis] = value; checkEdit(); } })))));
  return [heading(t("points")), el("p", { class: "hint" }, t("editHint")), el("p", { id: "edit-state", class: edit.bad.length ? "error" : "hint", role: "status" }, editState()),
    el("div", { class: "row" }, button(t("undo"), undo, { id: "undo", disabled: !edit.past.length }), button(t("redo"), redo, { id: "redo", disabled: !edit.future.length }), button(t("addAfter"), addPoint), button(t("deletePoint"), deletePoint)),
    el("div", { class: "scroll" }, el("table", {}, el("tr", {}, el("th", { scope: "col" }, t("point")), el("th", { scope: "col" }, t("lat")), el("th", { scope: "col" }, t("lon")), el("th", { scope: "col" }, t("agl"))), ...rows)),
    el("div", { class: "row" }, button(t("saveEdited"), () => attempt(async () => follow(await api("/api/route/save", { run: state.name, waypoints: edit.points }))), { class: "main", id: "save-edited", disabled: edit.bad.length > 0 }), button(t("cancelEdit"), () => { state.edit = null; attempt(() => openScene(state.name, "plan", { keepView: true })); }))];
}
const editState = () => state.edit.bad.length ? `${state.edit.bad.length} ${t("broken")}: ${state.edit.texts[0] ?? ""}` : `${t("allLegsHold")} ${Number.isFinite(state.edit.coverage) ? `${t("coverage")} ${percent(state.edit.coverage, 2)}` : ""}`;
function beginEdit() { state.edit = { points: copyOf(state.scene.route), past: [], future: [], chosen: 0, bad: [], texts: [], coverage: NaN }; showEdit(); drawPanel(); checkEdit(); }
function keep(edit) { edit.past.push(copyOf(edit.points)); edit.future = []; }
function moveInTime(edit, from, to) { if (!edit[from].length) return; edit[to].push(copyOf(edit.points)); edit.points = edit[from].pop(); edit.chosen = Math.min(edit.chosen, edit.points.length - 1); showEdit(); drawPanel(); checkEdit(); }
function addPoint() { const e = state.edit, a = e.points[e.chosen], b = e.points[e.chosen + 1] ?? a; keep(e); e.points.splice(e.chosen + 1, 0, a.map((v, k) => (v + b[k]) / 2)); e.chosen += 1; showEdit(); drawPanel(); checkEdit(); }
function deletePoint() { const e = state.edit; if (e.points.length < 2) return; keep(e); e.points.splice(e.chosen, 1); e.chosen = Math.min(e.chosen, e.points.length - 1); showEdit(); drawPanel(); checkEdit(); }
function showEdit() {
  const { points, chosen, bad } = state.edit;
  map.waypoints(points, chosen);
  map.route([points.map((p) => [p[0], p[1]])], bad.map((leg) => points.slice(Math.max(0, leg - 1), leg + 1).map((p) => [p[0], p[1]])).filter((leg) => leg.length === 2));
}
const askLegs = latest(async () => {
  const edit = state.edit, found = edit && await attempt(() => api("/api/route/check", { run: state.name, waypoints: edit.points }));
  if (!found || state.edit !== edit) return;
  edit.bad = found.legs; edit.texts = found.problems.map((p) => p.text);
  showEdit(); profile($("profile"), [found.profile]);
  const line = $("edit-state");
  if (line) { line.textContent = editState(); line.className = edit.bad.length ? "error" : "hint"; }
  const save = $("save-edited");
  if (save) save.disabled = edit.bad.length > 0;
});
const askCoverage = latest(async () => {
  const edit = state.edit, found = edit && await attempt(() => api("/api/route/coverage", { run: state.name, waypoints: edit.points }));
  if (!found || state.edit !== edit) return;
  edit.coverage = found.coverage; map.cells(found.image, found.corners);
  const line = $("edit-state");
  if (line) line.textContent = editState();
});
function checkEdit() { askLegs(); askCoverage(); }
map.ready.then(() => {
  const canvas = map.map;
  let dragged = null;
  const down = (event) => {
    if (!state.edit) return;
    event.preventDefault();
    dragged = { n: event.features[0].properties.number, before: copyOf(state.edit.points) };
    state.edit.chosen = dragged.n;
  };
  const move = (event) => {
    if (!dragged || !state.edit) return;
    const p = state.edit.points[dragged.n];
    [p[0], p[1]] = [event.lngLat.lng, event.lngLat.lat];
    showEdit(); checkEdit();
  };
  const up = () => { if (!dragged) return; if (state.edit) { state.edit.past.push(dragged.before); state.edit.future = []; drawPanel(); checkEdit(); } dragged = null; };
  canvas.on("mousedown", "waypoints", down); canvas.on("touchstart", "waypoints", down);
  canvas.on("mousemove", move); canvas.on("touchmove", move);
  for (const end of ["mouseup", "touchend", "touchcancel"]) window.addEventListener(end, up); // also outside of the map
  for (const layer of ["zones-fill", "unsafe"]) canvas.on("click", layer, (event) => say(Object.values(event.features[0].properties).join(": ")));
});
document.addEventListener("keydown", (event) => {
  const typing = ["INPUT", "TEXTAREA", "SELECT"].includes(event.target.tagName);
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !typing) { event.preventDefault(); event.shiftKey ? redo() : undo(); }
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "y" && !typing) { event.preventDefault(); redo(); }
  if (event.key === "Escape") stopDrawing();
  if (event.key === "Delete" && state.edit && !typing) deletePoint();
});

// ---------------------------------------------------------------- fly
function flyPanel() {
  const run = ofRun();
  if (!run) return [heading(t("fly")), el("p", { class: "hint" }, t("noRun"))];
  const s = state.scene, to = el("input", { id: "f-to", value: state.to ?? "mock:", oninput: (e) => { state.to = e.target.value; } });
  const real = () => !(state.to ?? "mock:").startsWith("mock:");
  const sorties = s.plan.sorties ?? [], asked = () => ({ run, to: state.to ?? "mock:", ...(sorties.length ? { sortie: state.sortie ?? "1" } : {}) });
  const confirm = el("input", { id: "f-confirm", autocomplete: "off" });
  const upload = s.upload && Object.keys(s.upload).length ? el("p", { class: s.upload.passed ? "hint" : "error", id: "uploaded" }, s.upload.passed ? t("uploadPassed") : t("uploadFailed")) : null;
  const flown = s.tracks?.length > 0;
  return [
    heading(t("fly")), field("to", t("to"), to),
    ...(sorties.length ? [field("sortie", t("sortie"), select(t("sortie"), sorties.map((_, n) => [String(n + 1), `${n + 1} ${t("of")} ${sorties.length}`]), state.sortie ?? "1", (n) => { state.sortie = n; }))] : []),
    field("mock", t("mockSpeed"), el("input", { id: "f-mock", inputmode: "decimal", value: state.mockSpeed ?? "20", oninput: (e) => { state.mockSpeed = e.target.value; } })),
    state.server.flightsAllowed ? field("confirm", t("confirmReal"), confirm) : el("p", { class: "hint" }, t("simulatedOnly")),
    upload, preflight(s.upload),
    ...(flown ? [el("label", {}, el("input", { type: "checkbox", id: "f-replace", style: "width:auto;min-height:0" }), ` ${t("replace")}`)] : []),
    el("div", { class: "row" },
      button(t("upload"), () => attempt(() => start("upload", asked())), { id: "upload" }),
      button(t("fly"), () => attempt(() => start("fly", { ...asked(), mock_speed: state.mockSpeed ?? "20", force: Boolean($("f-replace")?.checked), confirmed: real() ? confirm.value : "" })), { class: "main", id: "fly", disabled: Boolean(running("fly")) }),
      ...(flown ? [button(t("resume"), () => attempt(() => start("fly", { ...asked(), mock_speed: state.mockSpeed ?? "20", resume: true })))] : [])),
    el("div", { id: "job" }),
  ];
}
function preflight(upload) {
  const rows = upload?.checks ?? upload?.parts ?? [];
  if (!Array.isArray(rows) || !rows.length) return null;
  return el("table", {}, ...rows.map((row) => el("tr", {}, el("td", {}, String(row.name ?? row.type ?? row.what ?? "")), el("td", {}, String(row.passed ?? row.outcome ?? row.equal ?? "")))));
}
function drawOrders() {
  const job = running("fly"), box = $("orders");
  box.hidden = !job;
  if (!job) return;
  const live = state.live.get(job.run) ?? {}, last = live.last;
  const lines = [el("strong", {}, `${t("flying")}: ${job.run}`), el("div", { id: "live-status" }, job.status ?? job.progress?.what ?? ""), el("div", { id: "live" }, last ? `${job.status ? "" : `${number(last[2], 1)} m ${t("height")} · ${percent(live.covered ?? 0)} ${t("covered")} · `}${live.count} ${t("samples")}` : "")];
  if (box.dataset.job !== job.id) {
    box.dataset.job = job.id;
    box.replaceChildren(...lines, el("div", { class: "row" }, button(t("hold"), () => signal(job, "pause"), { id: "hold" }), button(t("back"), () => signal(job, "stop"), { id: "back", class: "danger" })));
  } else { for (let n = 0; n < 3; n += 1) box.children[n].replaceWith(lines[n]); }
}

// ---------------------------------------------------------------- judge
function judgePanel() {
  const run = ofRun();
  if (!run) return [heading(t("tabJudge")), el("p", { class: "hint" }, t("noRun"))];
  const v = state.scene.verdict, out = [heading(t("tabJudge"))];
  if (!state.scene.tracks?.length) out.push(el("p", { class: "hint" }, t("notFlown")));
  if (v) {
    out.push(el("p", { id: "verdict", class: `verdict ${v.verdict === "passed" ? "passed" : v.verdict === "failed" ? "failed" : "unproved"}` }, `${t(v.verdict)} — ${percent(v.coverageOfCoverable, 2)} ${t("coverage")}`));
    out.push(...[...v.reasons, ...v.doubts].map((line) => el("p", { class: "warn" }, line)));
    const place = (where) => button(t("show"), () => map.map.jumpTo({ center: where, zoom: Math.max(15, map.map.getZoom()) }), {});
    out.push(heading(t("findings")), v.violations.length ? el("table", {}, ...v.violations.slice(0, 100).map((each) => el("tr", {}, el("td", {}, place(each.place)), el("td", {}, each.kind), el("td", {}, each.worst), el("td", {}, each.limit)))) : el("p", { class: "hint" }, t("noFindings")));
    out.push(heading(t("gaps")), v.gaps.length ? el("table", {}, ...v.gaps.slice(0, 100).map((gap) => el("tr", {}, el("td", {}, place(gap.place)), el("td", {}, `${gap.area} ${t("m2")}`), el("td", {}, gap.reason)))) : el("p", { class: "hint" }, t("noGaps")));
  }
  const entry = runs().find((each) => each.name === run);
  out.push(el("div", { class: "row" },
    button(t("verify"), () => attempt(() => start("verify", { run })), { class: "main", id: "verify", disabled: !state.scene.tracks?.length }),
    button(t("makeGaps"), () => attempt(() => start("gaps", { run, force: true })), { id: "gaps", disabled: !state.scene.tracks?.length }),
    ...(entry?.gaps ? [button(t("openGaps"), () => attempt(() => openScene(`${run}/gaps`, "plan")), { id: "open-gaps" })] : []),
    button(t("report"), () => attempt(() => start("report", { run, force: true })))));
  const folder = el("input", { id: "f-photos" });
  out.push(field("photos", t("photosHint"), folder), button(t("judgePhotos"), () => attempt(() => start("photos", { run, photos: folder.value }))), el("div", { id: "job" }));
  return out;
}

// ---------------------------------------------------------------- progress of commands
function drawJob() {
  drawOrders();
  const place = $("job"), job = running();
  for (const [id, kind] of [["plan", "plan"], ["fly", "fly"]]) if ($(id)) $(id).disabled = Boolean(running(kind));
  if ($("edit")) $("edit").disabled = state.scene.sorties.length > 1 || Boolean(job);
  if (!place) return;
  if (!job) { place.replaceChildren(); return; }
  const p = job.progress, share = p && p.total ? Math.min(1, p.done / p.total) : null;
  if (place.dataset.job !== job.id || !place.firstChild) {
    place.dataset.job = job.id;
    place.replaceChildren(el("p", { id: "job-text" }), el("progress", { max: 1, "aria-label": t("progress") }), ...(job.kind === "fly" ? [] : [button(t("stop"), () => signal(job, "stop"), { id: "stop" })]));
  }
  $("job-text").textContent = `${p?.what ?? job.kind} ${p?.note ?? t("busy")}`;
  const bar = place.querySelector("progress");
  if (share === null) bar.removeAttribute("value"); else bar.value = share;
}

// ---------------------------------------------------------------- begin
for (const each of document.querySelectorAll("[data-text]")) each.textContent = t(each.dataset.text);
for (const each of document.querySelectorAll("[data-label]")) each.setAttribute("aria-label", t(each.dataset.label));
$("profile").dataset.label = t("profile");
const dark = localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
const setTheme = (theme) => { document.documentElement.classList.toggle("dark", theme === "dark"); localStorage.setItem("theme", theme); };
setTheme(dark);
$("theme").addEventListener("click", () => setTheme(document.documentElement.classList.contains("dark") ? "light" : "dark"));
if (location.search) history.replaceState(null, "", "/"); // the token is in the cookie now
drawTabs();
attempt(async () => {
  await Promise.all([map.ready, refresh()]);
  connect();
  drawPanel(); drawTools();
  const first = state.server.first;
  if (!first) { const only = runs()[0]; if (only) map.map.jumpTo({ center: [0, 20], zoom: 1.2 }); }
  else if (state.server.files.areas.some((area) => area.name === first)) { await loadArea(first); drawPanel(); }
  else await openScene(first, runs().some((run) => run.name === first) ? "plan" : "area");
  document.documentElement.dataset.ready = "yes";
  // A flight that another program began, or a file that came into the folder.
  setInterval(() => { if (!document.hidden) refresh().then(() => { for (const run of runs()) if (run.flying && run.name === state.name) watch(run.name); }).catch(() => {}); }, 5000);
});
