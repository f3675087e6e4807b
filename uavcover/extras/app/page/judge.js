// The judge step: verdict, findings, gaps, photos.
import { attempt, button, field, heading, map, ofRun, refresh, runs, say, select, state } from "/page/core.js";
import { drawPanel, drawTools, legendOf, openScene, showLayer, start } from "/page/app.js";
import { api, el, number, percent } from "/page/dom.js";
import { t } from "/page/strings.js";

const show = (where) => button(t("show"), () => map.map.jumpTo({ center: where, zoom: Math.max(15, map.map.getZoom()) }));
const scrolled = (label, table) => el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": label }, table);
const verdictLine = (id, verdict, rest) => el("p", { id, class: `verdict ${verdict === "passed" ? "passed" : verdict === "failed" ? "failed" : "unproved"}` }, `${t(verdict)} — ${rest}`);

export function judgePanel() {
  const run = ofRun();
  if (!run) return [heading(t("tabJudge")), el("p", { class: "hint" }, t("noRun"))];
  const v = state.scene.verdict, flown = state.scene.tracks?.length > 0, out = [heading(t("tabJudge"))];
  if (!flown) out.push(el("p", { class: "hint" }, t("notFlown")));
  if (v) out.push(verdictLine("verdict", v.verdict, `${percent(v.coverageOfCoverable, 2)} ${t("coverage")}`));
  const entry = runs().find((each) => each.name === run);
  out.push(el("div", { class: "row" },
    button(t("verify"), () => attempt(() => start("verify", { run })), { class: "main", id: "verify", disabled: !flown }),
    button(t("makeGaps"), () => attempt(() => start("gaps", { run, force: true })), { id: "gaps", disabled: !flown }),
    ...(entry?.gaps ? [button(t("openGaps"), () => attempt(() => openScene(`${run}/gaps`, "plan")), { id: "open-gaps" })] : []),
    button(t("report"), () => attempt(() => start("report", { run, force: true })))));
  if (v) {
    out.push(...[...v.reasons, ...v.doubts].map((line) => el("p", { class: "warn" }, line)));
    out.push(heading(t("findings")), v.violations.length ? scrolled(t("findings"), el("table", {}, el("tr", {}, el("td", {}), ...["finding", "worst", "limit"].map((key) => el("th", { scope: "col" }, t(key)))), ...v.violations.slice(0, 100).map((each) => el("tr", {}, el("td", {}, show(each.place)), el("td", {}, each.kind), el("td", {}, each.worst), el("td", {}, each.limit))))) : el("p", { class: "hint" }, t("noFindings")));
    out.push(heading(t("gaps")), v.gaps.length ? scrolled(t("gaps"), el("table", {}, ...v.gaps.slice(0, 100).map((gap) => el("tr", {}, el("td", {}, show(gap.place)), el("td", {}, `${gap.area} ${t("m2")}`), el("td", {}, gap.reason))))) : el("p", { class: "hint" }, t("noGaps")));
  }
  out.push(...photosPart(run), el("div", { id: "job" }));
  return out;
}

// ---------------------------------------------------------------- photos
function photosPart(run) {
  const kept = state.server.files.photos ?? [], found = state.photos;
  const chooser = el("input", { type: "file", multiple: true, id: "f-photos", onchange: (event) => attempt(() => takePhotos(run, [...event.target.files])) });
  const drop = el("div", { class: "drop", id: "drop-photos", ondragover: (e) => { e.preventDefault(); drop.classList.add("over"); }, ondragleave: () => drop.classList.remove("over"), ondrop: (e) => { e.preventDefault(); drop.classList.remove("over"); attempt(() => takePhotos(run, [...e.dataTransfer.files])); } },
    el("label", { for: "f-photos" }, t("dropPhotos")), chooser, el("p", { class: "hint" }, t("photosHint")), el("p", { id: "photos-state", role: "status" }));
  const opener = select(t("openPhotos"), [["", t("openPhotos")], ...kept.map((each) => [each.name, each.name])], found?.name ?? "", (name) => attempt(() => openPhotos(name)));
  opener.id = "f-photo-verdict";
  const out = [heading(t("judgePhotos")), drop, ...(kept.length ? [field("photo-verdict", t("openPhotos"), opener)] : [])];
  if (!found) return out;
  out.push(verdictLine("photo-verdict", found.verdict, `${found.counted} ${t("of")} ${found.pictures} ${t("photosCount")}`));
  out.push(el("dl", {}, ...[[t("coverage"), `${percent(found.coverage_of_coverable, 2)}, ${t("required")} ${percent(found.required)}`], ...(found.overlap_fraction === null ? [] : [[t("overlapHeld"), `${percent(found.overlap_fraction)}, ${t("required")} ${percent(found.overlap_required)}`]])].flatMap(([key, value]) => [el("dt", {}, key), el("dd", {}, value)])));
  if (found.leftOut.length) out.push(scrolled(t("photosLeftOut"), el("table", {}, ...found.leftOut.map(([name, why]) => el("tr", {}, el("th", { scope: "row" }, name), el("td", {}, why))))));
  if (found.gapShapes.length) out.push(el("table", {}, ...found.gapShapes.slice(0, 50).map((gap) => el("tr", {}, el("td", {}, show(firstPlace(gap.geometry.coordinates))), el("td", {}, gap.properties.reason ?? ""), el("td", {}, Number.isFinite(gap.properties.area_m2) ? `${number(gap.properties.area_m2)} ${t("m2")}` : "")))));
  if (found.refly) out.push(button(t("openRefly"), () => attempt(() => openScene(`${found.name}/refly`, "plan")), { id: "open-refly" }));
  return out;
}
const firstPlace = (coordinates) => (typeof coordinates[0] === "number" ? coordinates : firstPlace(coordinates[0]));
async function takePhotos(run, files) {
  const line = (text) => { const place = document.getElementById("photos-state"); if (place) place.textContent = text; };
  let kept = 0;
  for (const file of files) {
    line(`${kept + 1} ${t("of")} ${files.length}: ${file.name}`);
    const answer = await fetch(`/api/files/${encodeURIComponent(file.name)}?photo_of=${encodeURIComponent(run)}`, { method: "PUT", body: file, credentials: "same-origin" });
    const { error } = await answer.json();
    if (answer.ok) kept += 1; else say(error, "error");
  }
  line(`${kept} ${t("of")} ${files.length} ${t("photosKept")}`);
  if (kept) await start("photos", { run });
}
export async function openPhotos(name) {
  state.photos = name ? { name, ...await api(`/api/photos?name=${encodeURIComponent(name)}`) } : null;
  map.photos(state.photos);
  state.layer = state.photos ? "" : state.layer;
  showLayer();
  if (state.photos) legendOf(t("judgePhotos"), [["#00725f", t("photoCounts")], ["#e00000", t("photoLeftOut")], ["#d55e00", t("gaps")]]);
  await refresh();
  drawPanel(); drawTools();
}
