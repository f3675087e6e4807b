// The area step: what is open, the survey form, drawing.
import { $, attempt, button, copyOf, emptyDraft, field, heading, map, refresh, runs, say, select, state } from "/page/core.js";
import { drawPanel, drawTools, legendOf, openScene, showLayer } from "/page/app.js";
import { api, debounced, el, latest, number } from "/page/dom.js";
import { inside } from "/page/map.js";
import { moveInTime } from "/page/plan.js";
import { t } from "/page/strings.js";
import { profile } from "/page/charts.js";

export const FORM = ["area", "fence", "rally", "home", "max_alt", "name", "camera", "gsd", "overlap", "vehicle", "battery", "max_height", "speed", "autopilot", "vertical_datum"];
export function areaPanel() {
  const files = state.server?.files ?? { scenarios: [], runs: [], areas: [], elevation: [] };
  const choices = [["", t("openChoose")], ...files.runs.map((r) => [r.name, r.name]), ...files.scenarios.map((s) => [s.name, s.name])];
  const opener = select(t("open"), choices, state.name, (name) => name && attempt(() => openScene(name, runs().some((r) => r.name === name) ? "plan" : "area")));
  opener.id = "f-open";
  const chooser = el("input", { type: "file", multiple: true, id: "f-files", onchange: (event) => attempt(() => takeFiles([...event.target.files])) });
  const drop = el("div", { class: "drop", ondragover: (e) => { e.preventDefault(); drop.classList.add("over"); }, ondragleave: () => drop.classList.remove("over"), ondrop: (e) => { e.preventDefault(); drop.classList.remove("over"); attempt(() => takeFiles([...e.dataTransfer.files])); } },
    el("label", { for: "f-files" }, t("drop")), chooser, el("p", { class: "hint" }, t("dropHint")));
  return [
    heading(t("open")), el("label", { for: "f-open" }, el("span", {}, t("openChoose")), opener), button(t("newSurvey"), newSurvey), drop,
    ...(state.scene ? [sceneFigures(), ...(state.draft.area && state.savedAs === state.name ? [button(t("changeSurvey"), changeSurvey, { id: "change-survey" })] : [])] : surveyForm(files)),
  ];
}
export function sceneFigures() {
  const s = state.scene;
  return el("dl", {}, ...[[t("areaSize"), `${number(s.areaM2 / 1e4, 2)} ${t("ha")}`], [t("band"), `${number(s.band[0])} – ${number(s.band[1])} m ${t("height")}`], [t("camera"), t(`sensor_${s.camera}`)], [t("autopilot"), t(s.vehicle.autopilot)], [t("speed"), `${number(s.vehicle.speed, 1)} m/s`]].flatMap(([k, v]) => [el("dt", {}, k), el("dd", {}, v)]));
}
function surveyForm(files) {
  const error = state.design?.error, of = state.design?.field ?? "", wrong = (name) => (error && of === name ? error : "");
  const text = (name, label, more = {}) => field(name, label, el("input", { id: `f-${name}`, value: state.form[name] ?? "", oninput: (e) => { state.form[name] = e.target.value; redesign(); }, "aria-invalid": wrong(name) ? "true" : null, ...more }), wrong(name));
  const list = (name, label, options) => field(name, label, el("select", { id: `f-${name}`, onchange: (e) => { state.form[name] = e.target.value; if (name === "dem") map.heights(e.target.value ? `dem=${encodeURIComponent(e.target.value)}` : ""); redesign(); } }, [["", t("none")], ...options].map(([key, title]) => el("option", { value: key, selected: key === (state.form[name] ?? "") }, title))), wrong(name));
  return [
    heading(t("draw")),
    el("div", { class: "row" }, button(t("drawArea"), () => drawShape("area")), button(t("drawHole"), () => drawShape("hole"), { disabled: !state.draft.area }), button(t("drawZone"), () => drawShape("zone")),
      button(t("drawFence"), () => drawShape("fence")), button(t("editShapes"), editShapes), button(t("setHome"), () => placePoint("home")), button(t("addRally"), () => placePoint("rally")), button(t("undo"), undo, { disabled: !state.past.length, id: "undo" }), button(t("redo"), redo, { disabled: !state.future.length, id: "redo" })),
    el("p", { class: "hint" }, t("drawHint")),
    positionInput(),
    ...shapeList(files), ...pointTable(), ...zoneTable(),
    heading(t("survey")),
    list("dem", `${t("dem")} (${t("required")})`, files.elevation.map((f) => [f.name, f.name])),
    list("vertical_datum", t("datum"), ["EGM96", "EGM2008", "ellipsoid"].map((d) => [d, d])),
    list("camera", `${t("camera")} (${t("required")})`, (state.server?.cameras ?? []).map((c) => [c.name, c.title || c.name])),
    el("div", { class: "row" }, text("gsd", t("gsd")), text("overlap", t("overlap"))),
    list("vehicle", t("vehicle"), (state.server?.vehicles ?? []).map((v) => [v.name, v.title || v.name])),
    el("div", { class: "row" }, text("battery", t("battery"), { placeholder: "25min" }), text("max_height", t("maxHeight"), { placeholder: "120m" }), text("max_alt", t("maxAlt"), { placeholder: "900m" }), text("speed", t("speed"), { placeholder: "10m/s" })),
    list("autopilot", t("autopilot"), [["ardupilot", "ArduPilot"], ["px4", "PX4"]]),
    el("div", { id: "design", "aria-live": "polite" }, ...designFigures()),
    text("name", t("name")),
    button(t("save"), () => attempt(saveScenario), { class: "main", id: "save" }),
  ];
}
function designFigures() {
  const d = state.design;
  if (!d) return [];
  if (d.error) return [el("p", { class: "error" }, $(`e-${d.field}`) ? t("seeField") : d.error)];
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
// Area and fence, each with a way to take it away; a fence can also come from a file of the folder.
function shapeList(files) {
  const { area, fence } = state.draft, from = [["", t("fenceDefault")], ...(fence ? [["drawn", t("fenceDrawn")]] : []), ...files.areas.map((f) => [f.name, f.name])];
  const choose = select(t("fence"), from, fence ? "drawn" : "", (name) => attempt(async () => {
    if (name === "drawn") return;
    const found = name ? await api(`/api/area?name=${encodeURIComponent(name)}`) : null;
    change(() => { state.draft.fence = found ? { type: "Polygon", coordinates: [found.geometry.coordinates[0][0]] } : null; });
  }));
  choose.id = "f-fence";
  return [field("fence", t("fence"), choose), el("div", { class: "row" },
    ...(area ? [button(t("removeArea"), () => change(() => { state.draft.area = null; }), { id: "remove-area" })] : []),
    ...(fence ? [button(t("removeFence"), () => change(() => { state.draft.fence = null; }), { id: "remove-fence" })] : [])), el("p", { class: "error", role: "alert", id: "e-area" })];
}
// Take-off and rally points as numbers, for the keyboard and for exact positions.
function pointTable() {
  const { home, rally } = state.draft, rows = [...(home ? [[t("home"), home, () => { state.draft.home = null; }]] : []), ...rally.map((point, n) => [`${t("rally")} ${n + 1}`, point, () => { state.draft.rally.splice(n, 1); }])];
  const cell = (name, point, axis, label) => el("td", {}, el("input", { "aria-label": `${label}, ${name}`, inputmode: "decimal", value: number(point[axis], 6), onchange: (e) => { const value = Number(e.target.value); if (Number.isFinite(value)) change(() => { point[axis] = value; }); } }));
  return [...(rows.length ? [el("table", { id: "points" }, el("tr", {}, el("td", {}), el("th", { scope: "col" }, t("lat")), el("th", { scope: "col" }, t("lon")), el("td", {})),
    ...rows.map(([name, point, remove]) => el("tr", {}, el("th", { scope: "row" }, name), cell(name, point, 1, t("lat")), cell(name, point, 0, t("lon")), el("td", {}, button("✕", () => change(remove), { "aria-label": `${t("remove")}: ${name}` })))))] : []),
    el("p", { class: "error", role: "alert", id: "e-home" }), el("p", { class: "error", role: "alert", id: "e-rally" })];
}
function positionInput() {
  const input = el("input", { id: "f-position", placeholder: "47.37, 8.54", "aria-describedby": "position-hint" });
  const place = async () => (await api(`/api/place?text=${encodeURIComponent(input.value)}`)).place;
  return el("div", {}, field("position", t("position"), input), el("p", { class: "hint", id: "position-hint" }, t("positionHint")), el("div", { class: "row" },
    button(t("go"), () => attempt(async () => map.map.jumpTo({ center: await place(), zoom: 14 }))), button(t("here"), () => attempt(async () => { const at = await place(); change(() => { state.draft.home = at; }); })),
    ...(state.corners ? [button(t("cornerHere"), () => attempt(async () => { const at = await place(); map.map.jumpTo({ center: at, zoom: Math.max(14, map.map.getZoom()) }); addCorner(at); }), { id: "corner" }), button(t("finishDraw"), finishCorners, { id: "finish" })] : []),
    button(t("rallyHere"), () => attempt(async () => { const at = await place(); change(() => { state.draft.rally.push(at); }); }))));
}
function newSurvey() {
  Object.assign(state, { name: "", scene: null, draft: emptyDraft(), past: [], future: [], design: null, edit: null, layer: "" });
  map.scene(null); map.cells(""); map.contours([]); map.heights(state.form.dem ? `dem=${encodeURIComponent(state.form.dem)}` : "");
  profile($("profile"), []); $("place").textContent = ""; showLayer(); drawPanel(); drawTools();
}

// ---------------------------------------------------------------- drawing
function remember() { state.past.push(copyOf(state.draft)); state.future = []; if (state.past.length > 100) state.past.shift(); }
function change(call) { remember(); call(); drawDraft(); redesign(); drawPanel(); }
export function undo() { if (state.edit) { moveInTime(state.edit, "past", "future"); return; } if (state.scene || !state.past.length) return; state.future.push(copyOf(state.draft)); state.draft = state.past.pop(); drawDraft(); redesign(); drawPanel(); }
export function redo() { if (state.edit) { moveInTime(state.edit, "future", "past"); return; } if (state.scene || !state.future.length) return; state.past.push(copyOf(state.draft)); state.draft = state.future.pop(); drawDraft(); redesign(); drawPanel(); }
function drawDraft() {
  const polygons = (geometry) => (geometry?.type === "MultiPolygon" ? geometry.coordinates : geometry ? [geometry.coordinates] : []);
  map.set("area", polygons(state.draft.area).map((rings) => ({ type: "Feature", properties: {}, geometry: { type: "Polygon", coordinates: rings } })));
  map.set("zones", state.draft.zones.map((zone) => ({ type: "Feature", properties: { name: zone.name }, geometry: zone.geometry })));
  map.set("fence", state.draft.fence ? [{ type: "Feature", properties: {}, geometry: { type: "LineString", coordinates: state.draft.fence.coordinates[0] } }] : []);
  map.set("rally", state.draft.rally.map((point) => ({ type: "Feature", properties: {}, geometry: { type: "Point", coordinates: point } })));
  if (!state.scene) legendOf("", []);
  map.set("home", state.draft.home ? [{ type: "Feature", properties: {}, geometry: { type: "Point", coordinates: state.draft.home } }] : []);
}
export function boundsOfDraft() {
  const flat = JSON.stringify([state.draft.area, state.draft.fence, state.draft.home, state.draft.rally]).match(/-?\d+(?:\.\d+)?(?:e-?\d+)?,-?\d+(?:\.\d+)?(?:e-?\d+)?/g);
  if (!flat) return null;
  const places = flat.map((pair) => pair.split(",").map(Number));
  return [Math.min(...places.map((p) => p[0])), Math.min(...places.map((p) => p[1])), Math.max(...places.map((p) => p[0])), Math.max(...places.map((p) => p[1]))];
}
function drawShape(what) {
  stopDrawing();
  map.draw.setMode("polygon");
  say(t("drawHint"));
  const take = (ring) => {
    remember();
    if (what === "fence") state.draft.fence = { type: "Polygon", coordinates: [ring] };
    else if (what === "zone") state.draft.zones.push({ name: `zone ${state.draft.zones.length + 1}`, geometry: { type: "Polygon", coordinates: [ring] } });
    else if (what === "hole") addHole(ring);
    else addArea(ring);
    drawDraft(); redesign(); drawPanel();
  };
  const finished = (id) => { const shape = map.draw.getSnapshotFeature(id); stopDrawing(); if (shape) take(shape.geometry.coordinates[0]); };
  map.draw.on("finish", finished);
  Object.assign(state, { drawing: finished, corners: [], take });
  $("view").classList.add("drawing");
  drawPanel();
  map.map.getCanvas().focus();
}
// Corners that are typed, or set at the cross with the keyboard: exact, and without a pointer.
export function addCorner(place) {
  if (!state.corners) return;
  state.corners.push(place);
  map.waypoints(state.corners, state.corners.length - 1);
  map.set("incumbent", [{ type: "Feature", properties: {}, geometry: { type: "LineString", coordinates: state.corners } }]);
  say(`${t("cornersSet")} ${state.corners.length}`);
}
// Enter on the map finishes what a finger or the mouse drew, too.
export function finishCorners() {
  const { corners, take } = state;
  if (!corners?.length) { for (const type of ["keydown", "keyup"]) map.map.getCanvas().dispatchEvent(new KeyboardEvent(type, { key: "Enter", bubbles: false })); return; }
  if (corners.length < 3) return;
  stopDrawing();
  take([...corners, corners[0]]);
}
function addArea(ring) {
  const before = state.draft.area;
  const polygons = before?.type === "MultiPolygon" ? before.coordinates : before ? [before.coordinates] : [];
  state.draft.area = { type: "MultiPolygon", coordinates: [...polygons, [ring]] };
}
function addHole(ring) {
  const polygons = state.draft.area.type === "MultiPolygon" ? state.draft.area.coordinates : [state.draft.area.coordinates];
  const owner = polygons.find((rings) => inside(ring[0], rings[0]));
  if (owner) owner.push(ring); else say(t("holeOutside"), "warn");
  state.draft.area = { type: "MultiPolygon", coordinates: polygons };
}
export function stopDrawing() {
  if (state.drawing) map.draw.off("finish", state.drawing);
  const was = state.corners;
  Object.assign(state, { drawing: null, placing: "", corners: null, take: null });
  if (was) { map.waypoints([], 0); map.set("incumbent", []); $("view").classList.remove("drawing"); drawPanel(); }
  map.map.getCanvas().style.cursor = "";
  map.draw.clear();
  map.draw.setMode("static");
}
function editShapes() {
  stopDrawing();
  const polygons = state.draft.area?.type === "MultiPolygon" ? state.draft.area.coordinates : state.draft.area ? [state.draft.area.coordinates] : [];
  const features = [
    ...polygons.map((rings, n) => ({ type: "Feature", properties: { mode: "polygon", of: "area", n }, geometry: { type: "Polygon", coordinates: [rings[0]] } })),
    ...state.draft.zones.map((zone, n) => ({ type: "Feature", properties: { mode: "polygon", of: "zone", n }, geometry: zone.geometry })),
    ...(state.draft.fence ? [{ type: "Feature", properties: { mode: "polygon", of: "fence", n: 0 }, geometry: state.draft.fence }] : []),
  ];
  if (!features.length) return;
  map.draw.setMode("select");
  map.draw.addFeatures(copyOf(features));
  const finished = () => {
    remember();
    for (const each of map.draw.getSnapshot()) {
      if (each.properties.of === "area") polygons[each.properties.n][0] = each.geometry.coordinates[0];
      if (each.properties.of === "fence") state.draft.fence = each.geometry;
      if (each.properties.of === "zone") state.draft.zones[each.properties.n].geometry = each.geometry;
    }
    state.draft.area = polygons.length ? { type: "MultiPolygon", coordinates: polygons } : null;
    drawDraft(); redesign(); drawPanel();
  };
  map.draw.on("finish", finished);
  state.drawing = finished;
}
// The next click on the map is the take-off position or a rally point; both can be dragged afterwards.
function placePoint(what) {
  stopDrawing();
  state.placing = what;
  map.map.getCanvas().style.cursor = "crosshair";
  say(t(what === "home" ? "homeHint" : "rallyHint"));
}
map.ready.then(() => {
  const canvas = map.map;
  let held = null;
  canvas.on("click", (event) => {
    const what = state.placing, at = [event.lngLat.lng, event.lngLat.lat];
    if (!what) return;
    stopDrawing();
    change(() => { if (what === "home") state.draft.home = at; else state.draft.rally.push(at); });
  });
  for (const layer of ["home", "rally"]) for (const begin of ["mousedown", "touchstart"]) canvas.on(begin, layer, (event) => {
    if (state.scene || state.drawing || state.placing) return;
    event.preventDefault();
    const near = layer === "home" ? [state.draft.home] : state.draft.rally, [lng, lat] = event.features[0].geometry.coordinates;
    remember();
    held = near.reduce((best, point) => (Math.hypot(point[0] - lng, point[1] - lat) < Math.hypot(best[0] - lng, best[1] - lat) ? point : best));
  });
  for (const move of ["mousemove", "touchmove"]) canvas.on(move, (event) => { if (held) { [held[0], held[1]] = [event.lngLat.lng, event.lngLat.lat]; drawDraft(); } });
  for (const end of ["mouseup", "touchend", "touchcancel"]) window.addEventListener(end, () => { if (held) { held = null; redesign(); drawPanel(); } });
});
function formBody() {
  const { home, area, zones, fence, rally } = state.draft, body = { ...state.form, area, zones, fence, rally, dem: state.form.dem ? [state.form.dem] : [] };
  if (home) body.home = `${home[1]},${home[0]}`;
  return body;
}
const askDesign = latest(async () => {
  if (!state.draft.area || !state.form.dem || !state.form.camera) { state.design = null; return; }
  state.design = await attempt(() => api("/api/design", formBody()));
  const place = $("design");
  if (state.tab === "area" && !state.scene && place) { place.replaceChildren(...designFigures()); sayAtField(state.design); }
});
// What is wrong is said at its field.
// An error without the key or option that it begins with: the field says that; a point keeps its number.
const plain = (error) => error.replace(/^(?:--)?[a-z_-]+(?:\.[a-z_]+)*(?:\.([0-9]+))?: /, (_, n) => (n === undefined ? "" : `${Number(n) + 1}: `)).replace("limits.fence", t("fence").toLowerCase());
function sayAtField(found) {
  for (const name of FORM) {
    const is = found?.error && found.field === name, line = $(`e-${name}`);
    $(`f-${name}`)?.setAttribute("aria-invalid", String(Boolean(is)));
    if (line) line.textContent = is ? plain(found.error) : "";
  }
}
const redesign = debounced(askDesign, 350);
async function saveScenario() {
  let saved;
  try { saved = await api("/api/scenarios", formBody()); } catch (error) { sayAtField({ error: error.message, field: error.field }); throw error; }
  for (const message of saved.messages) say(message.warn ?? message.say, message.warn ? "warn" : "");
  say(`${t("saved")}: ${saved.scenarios.join(", ")}`);
  await refresh();
  await openScene(saved.scenarios[0], "plan");
  state.savedAs = saved.scenarios[0];
}
// Back to what was drawn and typed; it is saved under another name.
function changeSurvey() {
  Object.assign(state, { name: "", scene: null, edit: null, layer: "" });
  map.scene(null); map.cells(""); showLayer(); profile($("profile"), []);
  $("place").textContent = "";
  drawDraft(); map.fit(boundsOfDraft()); drawPanel(); drawTools(); redesign();
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
export async function loadArea(name) {
  const found = await api(`/api/area?name=${encodeURIComponent(name)}`);
  for (const note of found.notes) say(note, "warn");
  remember();
  state.draft.area = found.geometry;
  if (found.name) state.form.name = found.name.replace(/[^A-Za-z0-9._ -]/g, "-").replace(/^[^A-Za-z0-9]+/, "").slice(0, 60) || "survey";
  drawDraft(); map.fit(boundsOfDraft());
}
