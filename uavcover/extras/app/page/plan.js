// The plan step: search, trade-off, waypoints, export.
import { $, attempt, button, copyOf, field, heading, map, say, select, state } from "/page/core.js";
import { drawPanel, follow, openScene, running, start } from "/page/app.js";
import { addCorner, finishCorners, redo, sceneFigures, stopDrawing, undo } from "/page/area.js";
import { api, el, latest, number, percent } from "/page/dom.js";
import { SORTIES } from "/page/map.js";
import { t } from "/page/strings.js";
import { profile, tradeoff } from "/page/charts.js";

export function planPanel() {
  if (!state.name) return [heading(t("planWith")), el("p", { class: "hint" }, t("noScenario"))];
  const s = state.scene, out = [heading(t("planWith"))], budget = select(t("budget"), ["5s", "10s", "30s", "60s", "5m"].map((b) => [b, b]), state.budget ?? "30s", (b) => { state.budget = b; });
  budget.id = "f-budget";
  const scenario = s.plan ? `${state.name}/scenario.toml` : state.name;
  const vehicles = () => state.vehicles ?? String(s.plan?.fleet?.vehicles ?? s.vehicles ?? 1);
  out.push(sceneFigures(), field("budget", t("budget"), budget), field("vehicles", t("vehicles"), el("input", { id: "f-vehicles", type: "number", min: 1, max: 20, value: vehicles(), oninput: (e) => { state.vehicles = e.target.value; } })), el("div", { class: "row" }, button(t("plan"), () => attempt(() => start("plan", { scenario, budget: state.budget ?? "30s", seed: state.seed, ...(Number(vehicles()) > 1 ? { vehicles: vehicles() } : {}) })), { class: "main", id: "plan", disabled: Boolean(running("plan")) })), el("div", { id: "job" }));
  if (!s.plan) return out;
  const m = s.plan.metrics;
  out.push(el("dl", { id: "figures" }, ...[[t("coverage"), percent(m.coverage_of_coverable, 2)], [t("waypoints"), m.waypoint_count], [t("length"), `${number(m.path_length_m)} m`], [t("time"), `${number((m.mission_time_s ?? m.flight_time_s) / 60, 1)} min`], [t("flights"), s.sorties.length], [t("rule"), `${s.plan.select.replace(/^coverage>=([0-9.]+)$/, (_, share) => `${t("coverage")} ≥ ${number(100 * share)} %`)}: ${s.plan.rule_met ? t("ruleMet") : t("ruleNotMet")}`], ...(s.plan.made_by === "edited" ? [["", t("edited")]] : [])].flatMap(([k, v]) => [el("dt", {}, k), el("dd", {}, v)])));
  if (s.plan.sorties?.length) out.push(schedule(s));
  if (s.members.length > 1) out.push(el("figure", { class: "chart" }, el("figcaption", { class: "hint" }, t("tradeoff")), tradeoff(s.members, (member) => attempt(() => start("select", { run: state.name, rule: `index:${member.index}` })))));
  out.push(...waypointEditor(), ...exporter());
  return out;
}
// Which vehicle flies when, in the colours of the map.
function schedule(s) {
  const rows = s.plan.sorties.map((one, n) => {
    const box = el("i"); box.style.background = SORTIES[(s.colors[n] ?? n) % SORTIES.length];
    return el("tr", {}, el("td", {}, box), el("th", { scope: "row" }, `${t("sortie")} ${one.number}`), el("td", {}, s.plan.fleet ? `${t("vehicle")} ${one.vehicle}` : ""), el("td", {}, s.plan.fleet ? `${t("startsAt")} ${number(one.takeoff_s / 60, 1)} min` : ""), el("td", {}, `${number(one.flight_time_s / 60, 1)} min`));
  });
  return el("table", { class: "legend", id: "schedule" }, ...rows);
}
function exporter() {
  const formats = ["waypoints", "plan", "kml", "geojson", "csv", "gpx", "wpml", "litchi", "print"];
  const format = select(t("exportAs"), formats.map((f) => [f, t(`format_${f}`)]), state.format ?? "plan", (f) => { state.format = f; });
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
const editState = () => state.edit.bad.length ? `${t("broken")}: ${state.edit.bad.length}. ${state.edit.texts[0] ?? ""}` : `${t("allLegsHold")} ${Number.isFinite(state.edit.coverage) ? `${t("coverage")} ${percent(state.edit.coverage, 2)}` : ""}`;
function beginEdit() { state.edit = { points: copyOf(state.scene.route), past: [], future: [], chosen: 0, bad: [], texts: [], coverage: NaN }; showEdit(); drawPanel(); checkEdit(); }
function keep(edit) { edit.past.push(copyOf(edit.points)); edit.future = []; }
export function moveInTime(edit, from, to) { if (!edit[from].length) return; edit[to].push(copyOf(edit.points)); edit.points = edit[from].pop(); edit.chosen = Math.min(edit.chosen, edit.points.length - 1); showEdit(); drawPanel(); checkEdit(); }
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
  if (state.corners && event.target === map.map.getCanvas()) {
    if (event.key === " ") { event.preventDefault(); addCorner(map.map.getCenter().toArray()); }
    if (event.key === "Enter") finishCorners();
  }
  if (event.key === "Delete" && state.edit && !typing) deletePoint();
});
