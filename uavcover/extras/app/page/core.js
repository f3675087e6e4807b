// What every part of the page shares: its state, the map, messages, small elements. Each part is a module of its own.
import { CoverageMap } from "/page/map.js";
import { t } from "/page/strings.js";
import { api, el } from "/page/dom.js";

export const emptyDraft = () => ({ area: null, zones: [], home: null, fence: null, rally: [] });
export const $ = (id) => document.getElementById(id);
export const state = {
  tab: "area", server: null, name: "", scene: null, layer: "", members: null,
  draft: emptyDraft(), past: [], future: [], form: { name: "survey", gsd: "3cm", overlap: "75/70", dem: "" }, design: null,
  edit: null, jobs: new Map(), watched: new Map(), live: new Map(), covered: new Map(), photos: null, background: "", contours: false,
};
export const map = Object.assign(new CoverageMap($("map")), { tools: $("tools") }); // they cover its upper edge
window.uavcover = { state, map }; // for tests and for the curious

// ---------------------------------------------------------------- messages
export function say(text, kind = "") {
  const line = el("p", { class: `${kind}${/\S {3,}\S/.test(text) ? " table" : ""}` }, text); // columns stay under each other
  $("messages").append(line);
  while ($("messages").childElementCount > 300) $("messages").firstChild.remove();
  $("messages").scrollTop = $("messages").scrollHeight;
}
export const fail = (error) => say(error.message ?? String(error), "error");
export async function attempt(call) { try { return await call(); } catch (error) { fail(error); return null; } }

// ---------------------------------------------------------------- server
export async function refresh() {
  state.server = await api("/api/state");
  for (const job of state.server.jobs) { const known = state.jobs.get(job.id); if (!known) state.jobs.set(job.id, { ...job, events: [], end: 0 }); } // news of known ones come by the socket
}

// ---------------------------------------------------------------- small elements
export const runs = () => state.server?.files.runs ?? [];
export const ofRun = () => state.scene && state.scene.plan ? state.name : "";
export function select(label, options, value, onchange) {
  return el("select", { "aria-label": label, onchange: (event) => onchange(event.target.value) }, options.map(([key, text]) => el("option", { value: key, selected: key === value }, text)));
}
export function field(name, label, input, error) {
  return el("label", { for: `f-${name}` }, el("span", {}, label), input, el("span", { class: "error", role: "alert", id: `e-${name}` }, error ?? ""));
}
export const heading = (text) => el("h2", {}, text);
export const button = (label, onclick, more = {}) => el("button", { type: "button", onclick, ...more }, label);
export const copyOf = (value) => JSON.parse(JSON.stringify(value));
