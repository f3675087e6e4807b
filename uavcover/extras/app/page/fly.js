// The fly step: upload, checks before the flight, orders while it goes on.
import { $, attempt, button, field, heading, map, ofRun, say, select, state } from "/page/core.js";
import { colorOf, running, signal, start, tracksOf } from "/page/app.js";
import { el, number, percent } from "/page/dom.js";
import { t } from "/page/strings.js";

const isMock = () => !String(state.to ?? "mock:").split(/\s+/).some((address) => address && !address.startsWith("mock:"));
const fleetOf = (scene) => Number(scene?.plan?.fleet?.by_vehicle?.length ?? 1);

export function flyPanel() {
  const run = ofRun();
  if (!run) return [heading(t("fly")), el("p", { class: "hint" }, t("noRun"))];
  const s = state.scene, sorties = s.plan.sorties ?? [], vehicles = fleetOf(s);
  const to = el("input", { id: "f-to", value: state.to ?? "mock:", oninput: (e) => { state.to = e.target.value; } });
  const all = vehicles > 1, chosen = state.sortie ?? (all ? "" : "1");
  const asked = () => ({ run, to: state.to ?? "mock:", ...(sorties.length && chosen ? { sortie: chosen } : {}), ...(all && !chosen ? { vehicles } : {}) });
  const confirm = el("input", { id: "f-confirm", autocomplete: "off" });
  const flown = s.tracks?.length > 0, checked = lastCheck(run, sorties.length ? chosen || "1" : "");
  const flights = [...(all ? [["", t("allVehicles")]] : []), ...sorties.map((one, n) => [String(n + 1), `${t("sortie")} ${n + 1} ${t("of")} ${sorties.length}${all ? `, ${t("vehicle").toLowerCase()} ${one.vehicle}` : ""}`])];
  const chooser = select(t("sortie"), flights, chosen, (n) => { state.sortie = n; state.redraw(); });
  chooser.id = "f-sortie";
  return [
    heading(t("fly")), field("to", t(all ? "toEach" : "to"), to),
    ...(sorties.length ? [field("sortie", t("flies"), chooser)] : []),
    field("mock", t("mockSpeed"), el("input", { id: "f-mock", inputmode: "decimal", value: state.mockSpeed ?? "20", oninput: (e) => { state.mockSpeed = e.target.value; } })),
    el("div", { class: "row" },
      button(t("upload"), () => attempt(() => start("upload", asked())), { id: "upload" }),
      button(t("check"), () => attempt(() => start("check", { run, ...(sorties.length ? { sortie: chosen || "1" } : {}) })), { id: "check" })),
    ...preflight(s, checked),
    state.server.flightsAllowed ? field("confirm", t("confirmReal"), confirm) : el("p", { class: "hint" }, t("simulatedOnly")),
    ...(flown ? [el("label", {}, el("input", { type: "checkbox", id: "f-replace", class: "box" }), ` ${t("replace")}`)] : []),
    el("div", { class: "row" },
      button(t("fly"), () => attempt(async () => {
        const replace = $("f-replace"), confirmed = isMock() ? "" : confirm.value, force = Boolean(replace?.checked);
        confirm.value = ""; if (replace) replace.checked = false; // each flight is confirmed on its own
        await start("fly", { ...asked(), mock_speed: isMock() ? state.mockSpeed ?? "20" : "", force, confirmed });
      }), { class: "main", id: "fly" }),
      ...(flown ? [button(t("resume"), () => attempt(() => start("fly", { ...asked(), mock_speed: isMock() ? state.mockSpeed ?? "20" : "", resume: true })))] : [])),
    el("div", { id: "job" }),
  ];
}

// ---------------------------------------------------------------- before the flight
function lastCheck(run, sortie) {
  const mission = `${sortie ? `${run}/sortie-${sortie}` : run}/mission.plan`;
  return [...state.jobs.values()].filter((job) => job.kind === "check" && job.command[2] === mission && job.result?.verdict).at(-1)?.result;
}
const MARKS = { good: "✓", warn: "!", bad: "✗", none: "" };
function row(state_, what, value, why = "", place = null) {
  return el("tr", { class: state_ }, el("td", {}, el("span", { role: "img", "aria-label": t(`mark_${state_}`) }, MARKS[state_])), el("th", { scope: "row" }, what), el("td", {}, value, why ? el("div", { class: "hint" }, why) : null), el("td", {}, place ? button(t("show"), () => map.map.jumpTo({ center: place, zoom: Math.max(15, map.map.getZoom()) })) : null));
}
function preflight(s, checked) {
  const rows = [];
  for (const upload of s.uploads ?? []) {
    const of = upload.flight ? `${t("sortie")} ${upload.flight.replace("sortie-", "")}: ` : "";
    for (const part of upload.lists) {
      rows.push(row(part.passed ? "good" : "bad", `${of}${t(`list_${part.type}`)}`, `${part.received} ${t("of")} ${part.sent} ${t("itemsHeld")}`, part.normalised ? `${part.normalised} ${t("normalised")}` : ""));
      for (const wrong of part.wrong) rows.push(row("bad", `${t("item")} ${wrong.item}`, `${wrong.field}: ${wrong.sent} → ${wrong.received}`, wrong.why ?? ""));
    }
    rows.push(row(upload.unsafe ? "warn" : "good", `${of}${t("ownReturn")}`, t(upload.unsafe ? "returnUnsafe" : "returnSafe"), Number.isFinite(upload.safeReturnHeight) ? `${t("safeAbove")} ${number(upload.safeReturnHeight)} m` : ""));
    if (Number.isFinite(upload.highest)) rows.push(row("none", `${of}${t("highest")}`, `${number(upload.highest)} m`, t("highestWhy")));
  }
  const passed = (s.uploads ?? []).length ? s.uploads.every((upload) => upload.passed) : null;
  const out = [heading(t("beforeFlight"))];
  if (passed !== null) out.push(el("p", { class: passed ? "hint" : "error", id: "uploaded" }, t(passed ? "uploadPassed" : "uploadFailed")));
  else out.push(el("p", { class: "hint" }, t("notUploaded")));
  if (checked) {
    rows.push(row(checked.verdict === "passed" ? "good" : checked.verdict === "failed" ? "bad" : "warn", t("check"), t(checked.verdict), `${number(checked.figures.min_height_agl_m)} – ${number(checked.figures.max_height_agl_m)} m ${t("height")}, ${number(checked.figures.length_m)} m, ${number(checked.figures.time_s / 60, 1)} min`));
    for (const found of checked.findings.slice(0, 50)) rows.push(row(found.weight === "breaks" ? "bad" : "warn", found.kind, found.what, found.do, Number.isFinite(found.lon_deg) ? [found.lon_deg, found.lat_deg] : null));
  }
  const flown = [...state.jobs.values()].filter((job) => job.limits && (job.run === state.name || job.run.startsWith(`${state.name}/`))).at(-1);
  for (const limit of flown?.limits ?? []) {
    const [vehicle, planned] = [limit.vehicle, limit.planned].map((value) => (value === null ? null : `${+value.toPrecision(6)} ${limit.unit}`.trim()));
    const held = `${vehicle}${limit.parameter ? ` (${limit.parameter})` : ""}`;
    rows.push(row({ warning: "warn", refused: "bad" }[limit.weight] ?? (planned === vehicle ? "good" : "none"), limit.what, planned === null ? held : `${held}; ${t("planned")} ${planned}`, limit.matters));
  }
  if (rows.length) out.push(el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": t("beforeFlight") }, el("table", { id: "preflight" }, ...rows)));
  return out;
}

// ---------------------------------------------------------------- orders, always visible while something flies
const flying = () => [...state.jobs.values()].filter((job) => job.code === null && job.kind === "fly");
// Flights that another program began, such as `uavcover fly --web`: shown, and commanded there.
function others(jobs) {
  const own = new Set(jobs.flatMap((job) => tracksOf(job.run)));
  return [...state.live].filter(([track, live]) => live.line && !own.has(track)).map(([track]) => track);
}
export function drawOrders() {
  const jobs = flying(), elsewhere = others(jobs), box = $("orders");
  box.hidden = !jobs.length && !elsewhere.length;
  if (box.hidden) { box.dataset.jobs = ""; return; }
  const key = [...jobs.map((job) => job.id), ...elsewhere].join();
  if (box.dataset.jobs !== key) {
    box.dataset.jobs = key;
    const buttons = (each, name) => el("div", { class: "row" },
      button(t("hold"), () => each.forEach((job) => signal(job, "pause")), { id: `hold${name}` }),
      button(t("back"), () => each.forEach((job) => signal(job, "stop")), { id: `back${name}`, class: "danger" }),
      button(t("leave"), () => { if (window.confirm(t("leaveSure"))) each.forEach((job) => signal(job, "leave")); }, { id: `leave${name}` }));
    const section = (name, id, ...more) => el("section", { "aria-label": `${t("flying")}: ${name}` }, el("strong", {}, `${t("flying")}: ${name}`), ...more, el("div", { "data-live": id }));
    box.replaceChildren(...(jobs.length > 1 ? [el("strong", {}, t("allFlights")), buttons(jobs, "")] : []),
      ...jobs.map((job, n) => section(job.run, job.id, buttons([job], jobs.length > 1 ? `-${n + 1}` : ""))),
      ...elsewhere.map((track) => section(track, track, el("p", { class: "hint" }, t("commandedThere")))));
  }
  for (const job of jobs) box.querySelector(`[data-live="${job.id}"]`).replaceChildren(...liveRows(job));
  for (const track of elsewhere) box.querySelector(`[data-live="${CSS.escape(track)}"]`).replaceChildren(...liveLine(track));
}
const warningOf = (live) => (live?.warning ? [el("div", { class: "warn" }, live.warning)] : []);
const liveLine = (track, text = "") => [el("div", { id: "live-status" }, state.live.get(track)?.line || text), ...warningOf(state.live.get(track))];
function liveRows(job) {
  const tracks = tracksOf(job.run), own = state.live.get(job.run) ?? {};
  const covered = state.covered.get(job.run) ?? state.covered.get(job.run.split("/")[0]);
  if (tracks.length === 1) {
    const last = own.last, text = job.status ?? (last ? `${number(last[2], 1)} m ${t("height")}, ${own.count} ${t("samples")}` : job.progress?.what ?? t("busy"));
    return liveLine(job.run, text);
  }
  const rows = tracks.map((track, n) => {
    const live = state.live.get(track), seen = live?.last, quiet = live && performance.now() - live.at > 4000;
    const box = el("i"); box.style.background = colorOf(track);
    return el("tr", {}, el("td", {}, box), el("th", { scope: "row" }, `${t("sortie")} ${n + 1}`), el("td", {}, live?.line || (seen ? `${number(seen[2])} m ${t("height")}` : ""), ...warningOf(live)), el("td", {}, !live ? t("waits") : quiet && !live.line ? t("ended") : live.line ? "" : t("inAir")));
  });
  return [el("div", { class: "hint" }, `${t("ordersAll")} ${Number.isFinite(covered) ? `${percent(covered)} ${t("covered")}.` : ""}`), el("table", { class: "legend", id: "vehicles" }, ...rows)];
}
