// The page: four steps beside a map. Everything it does is a request to the server, which works as the commands do.
import { $, attempt, button, fail, map, refresh, runs, say, select, state } from "/page/core.js";
import { areaPanel, boundsOfDraft, loadArea } from "/page/area.js";
import { planPanel } from "/page/plan.js";
import { drawOrders, flyPanel } from "/page/fly.js";
import { judgePanel, openPhotos } from "/page/judge.js";
import { COLORS, SORTIES } from "/page/map.js";
import { t } from "/page/strings.js";
import { api, debounced, el, queued, renew } from "/page/dom.js";
import { profile } from "/page/charts.js";

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
  socket.onclose = async () => {
    const refused = await fetch("/api/state", { method: "HEAD" }).then((answer) => answer.status === 403, () => false);
    $("link").textContent = t(refused ? "otherServer" : "reconnecting");
    setTimeout(connect, wait); wait = Math.min(5000, wait * 2);
  };
}
function send(message) { if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); }
export function watch(run) { for (const track of tracksOf(run)) if (!state.watched.has(track)) { state.watched.set(track, 0); send({ watch: track, from: 0 }); } }
Object.assign(window.uavcover, { watch, loadArea, say });
const watchFlights = () => { for (const run of runs()) if (run.flying) watch(run.name); };
// The flights of a run folder: itself, or its sorties.
export function tracksOf(run) {
  const count = runs().find((each) => each.name === run)?.sorties ?? 0;
  return count ? Array.from({ length: count }, (_, n) => `${run}/sortie-${n + 1}`) : [run];
}
// A sortie has the colour of its vehicle, as on the plan.
export function colorOf(track) {
  const number_ = Number(/\/sortie-([0-9]+)$/.exec(track)?.[1] ?? 0);
  if (!number_) return track === state.name ? "#d000a0" : SORTIES[[...state.watched.keys()].indexOf(track) % SORTIES.length] ?? SORTIES[0];
  return SORTIES[(state.scene?.colors?.[number_ - 1] ?? number_ - 1) % SORTIES.length];
}

function take(message) {
  if (message.error) { say(message.error, "error"); return; }
  if (message.samples) {
    state.watched.set(message.run, message.from + message.samples.length);
    const live = state.live.get(message.run) ?? {};
    Object.assign(live, { last: message.samples.at(-1), count: message.from + message.samples.length, at: performance.now() });
    state.live.set(message.run, live);
    map.live(message.run, message.from, message.samples, colorOf(message.run));
    drawOrders();
  }
  if (message.line !== undefined) {
    const { run, line, warning } = message;
    state.live.set(run, { ...state.live.get(run), line, warning });
    drawOrders();
  }
  if (message.coverage) {
    state.covered.set(message.run, message.coverage.covered);
    if (message.run === state.name) attempt(() => showObserved(message.run, message.coverage));
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
const showObserved = queued(async (run, coverage) => {
  if (!await map.patches(coverage)) { for (const track of tracksOf(run)) if (state.watched.has(track)) { send({ watch: track, from: state.watched.get(track) }); return; } }
  legendOf(t("coveredTitle"), [["#009e73", t("seen")], ["#d55e00", t("unseen")]]);
});
function takeEvent(job, event) {
  if (event.progress) job.progress = event.progress;
  else if (event.status) job.status = event.status;
  else if (event.warn) { say(event.warn, "warn"); }
  else if (event.say !== undefined && event.say.trim() && !event.say.startsWith("{")) say(event.say, event.say.startsWith("error:") ? "error" : "");
  if (event.limits) { job.limits = [...(job.limits ?? []), ...event.limits]; if (state.tab === "fly") redrawPanel(); }
  if (event.route) map.set("incumbent", [{ type: "Feature", properties: {}, geometry: { type: "LineString", coordinates: event.route } }]);
  job.events.push(event);
  if (job.events.length > 500) job.events.shift();
}
const redrawPanel = debounced(() => drawPanel(), 200);
// Jobs that this page started; kept over a reload.
const own = new Set(JSON.parse(sessionStorage.getItem("jobs") ?? "[]"));
export async function start(kind, asked) {
  const job = await api("/api/jobs", { kind, ...asked });
  follow(job);
  return job;
}
export function follow(job) {
  state.jobs.set(job.id, { ...job, events: [], end: 0 });
  own.add(job.id);
  sessionStorage.setItem("jobs", JSON.stringify([...own].slice(-60)));
  say(`$ ${job.command.filter((word) => word !== "--json" && word !== "--events").join(" ")}`);
  send({ job: job.id, from: 0 });
  if (job.kind === "fly") { watch(job.run); if (job.run === state.name || job.run.startsWith(`${state.name}/`)) map.forgetFlight(); }
  drawJob();
}
export const running = (kind) => [...state.jobs.values()].filter((job) => job.code === null && (!kind || job.kind === kind)).at(-1);
export const signal = (job, action) => attempt(() => api(`/api/jobs/${job.id}/${action}`, {}));

// A command has ended: show what it wrote.
async function ended(job) {
  map.set("incumbent", []);
  if (job.code !== 0) say(`${job.kind}: ${t({ 1: "endedNo", 130: "endedStopped", "-1": "endedGone" }[job.code] ?? "endedFailed")}`, job.code === 130 || job.code === 1 ? "warn" : "error");
  await refresh();
  // What another page started opens nothing here, and never takes away an edit.
  const of = job.run === state.name || job.run.startsWith(`${state.name}/`);
  if (!own.has(job.id) && (state.edit || !of)) { if (!state.edit) drawPanel(); return; }
  const isThere = state.server.files.runs.some((run) => run.name === job.run) || job.run === state.name;
  if (["plan", "edit"].includes(job.kind) && isThere) { state.edit = null; await openScene(job.run, "plan"); }
  else if (["select", "upload", "verify", "gaps"].includes(job.kind) && (job.run === state.name || job.run.startsWith(`${state.name}/`))) await openScene(state.name, state.tab, { keepView: true });
  else if (job.kind === "photos" && [0, 1].includes(job.code)) await openPhotos(job.command[job.command.indexOf("-o") + 1]);
  else if (job.kind === "fly") { for (const track of tracksOf(job.run)) state.watched.delete(track); if (job.run === state.name || job.run.startsWith(`${state.name}/`)) await openScene(state.name, running("fly") ? state.tab : "judge", { keepView: true }); }
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
export async function openScene(name, tab, { keepView = false } = {}) {
  const scene = await api(`/api/scene?name=${encodeURIComponent(name)}`);
  Object.assign(state, { name, scene, edit: null, photos: null, sortie: null, tab: tab ?? state.tab });
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
  watchFlights();
  drawTabs(); drawPanel(); drawTools(); drawJob();
}
export function showLayer() {
  const layer = state.scene?.layers?.find((each) => each.key === state.layer);
  map.cells(layer?.image ?? "", state.scene?.corners);
  legendOf(layer?.title ?? "", layer?.legend.map((entry) => [entry.color, entry.label]) ?? []);
}
export function legendOf(title, entries) {
  const swatch = ([color, label, kind]) => { const box = el("i", { class: kind ?? "" }); box.style.background = kind === "line" ? "" : color; box.style.borderColor = kind === "line" ? color : ""; return el("div", {}, box, label); };
  const sign = (letter, color, label) => { const box = el("i", { class: "sign" }, letter); box.style.borderColor = box.style.color = color; return el("div", {}, box, label); };
  const s = state.scene, d = state.draft;
  const key = [
    ...((s ? s.area.length : d.area) ? [swatch([COLORS.area, t("area"), "line"])] : []), ...((s ? s.fence.length : d.fence) ? [swatch([COLORS.fence, t("fence"), "line dashed"])] : []),
    ...((s ? s.zones : d.zones).length ? [swatch([COLORS.zone, t("noFly"), "line"])] : []), ...((s ? s.home : d.home) ? [sign("H", COLORS.home, t("home"))] : []), ...((s ? s.rally ?? [] : d.rally).length ? [sign("R", COLORS.rally, t("rally"))] : []),
    ...(s?.sorties?.length === 1 ? [swatch([SORTIES[0], t("route"), "line"])] : (s?.sorties ?? []).map((_, n) => swatch([SORTIES[(s.colors?.[n] ?? n) % SORTIES.length], `${t("sortie")} ${n + 1}`, "line"])).slice(0, 6)),
    ...(s?.photos?.planned?.length ? [swatch([COLORS.photo, t("plannedPhotos")])] : []), ...(s?.paths?.length ? [swatch(["#555555", t("outbound"), "line dashed"])] : []), ...(s?.unsafeReturns?.length ? [swatch([COLORS.unsafe, t("unsafe")])] : []), ...(s?.tracks?.length ? [s.tracks.length > 1 ? swatch(["#ffffff", t("flownEdge")]) : swatch([COLORS.track, t("flownTrack"), "line"])] : []),
  ];
  const open = $("legend").querySelector("details")?.open ?? innerWidth > 640;
  $("legend").hidden = !title && !key.length;
  $("legend").replaceChildren(el("details", { open }, el("summary", {}, title || t("key")), ...entries.map(swatch), ...key));
}
async function showContours(on) {
  state.contours = on;
  map.contours([]);
  if (on && state.name) { const found = await attempt(() => api(`/api/contours?name=${encodeURIComponent(state.name)}`)); if (found) map.contours(found.lines); }
}

// ---------------------------------------------------------------- tabs and tools
function drawTabs() {
  renew($("tabs"), ["area", "plan", "fly", "judge"].map((tab) => el("button", {
    type: "button", role: "tab", id: `tab-${tab}`, "aria-selected": String(state.tab === tab), "aria-controls": "panel", onclick: () => { state.tab = tab; drawTabs(); drawPanel(); },
  }, t(`tab${tab[0].toUpperCase()}${tab.slice(1)}`))));
}
function toggle(label, on, call) { return el("button", { type: "button", "aria-pressed": String(on), onclick: () => { call(!on); drawTools(); } }, label); }
export function drawTools() {
  const layers = state.scene?.layers ?? [], backgrounds = state.server?.files.backgrounds ?? [];
  renew($("tools"), [
    el("button", { type: "button", onclick: () => map.fit(state.scene?.bounds ?? boundsOfDraft()) }, t("fit")),
    toggle(t("terrain3d"), map.terrain, (on) => map.show3d(on)),
    toggle(t("contours"), state.contours, (on) => attempt(() => showContours(on))),
    ...(layers.length ? [select(t("layers"), [["", t("layerNone")], ...layers.map((l) => [l.key, l.title])], state.layer, (key) => { state.layer = key; showLayer(); })] : []),
    ...(backgrounds.length ? [select(t("background"), [["", t("noBackground")], ...backgrounds.map((b) => [b.name, b.name])], state.background, (file) => { state.background = file; map.background(file); })] : []),
  ]);
}
// ---------------------------------------------------------------- panel
state.redraw = () => drawPanel();
export function drawPanel() {
  const panel = $("panel"), other = panel.dataset.tab !== state.tab;
  panel.dataset.tab = state.tab;
  renew(panel, { area: areaPanel, plan: planPanel, fly: flyPanel, judge: judgePanel }[state.tab]());
  if (other) panel.scrollTop = 0;
  drawJob();
}
// ---------------------------------------------------------------- progress of commands
export function drawJob() {
  drawOrders();
  const place = $("job"), job = running();
  if ($("plan")) $("plan").disabled = Boolean(running("plan"));
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
const dark = localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
const setTheme = (theme) => { document.documentElement.classList.toggle("dark", theme === "dark"); localStorage.setItem("theme", theme); };
setTheme(dark);
$("theme").addEventListener("click", () => setTheme(document.documentElement.classList.contains("dark") ? "light" : "dark"));
if (location.search) history.replaceState(null, "", "/"); // the token is in the cookie now
matchMedia("(max-width: 640px)").addEventListener("change", (event) => { const key = $("legend").querySelector("details"); if (key) key.open = !event.matches; });
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
  setInterval(() => { if (!document.hidden) refresh().then(() => { watchFlights(); }).catch(() => {}); }, 5000);
});
