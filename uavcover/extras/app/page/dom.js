import { t } from "/page/strings.js";
// Small helpers. Text always becomes text, never markup: names of files, zones and vehicles come from anywhere.
export function el(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name === "class") made.className = value;
    else if (name === "value") { made.setAttribute("value", value); made.value = value; }
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat().filter((c) => c !== null && c !== undefined && c !== false));
  return made;
}
// New children in place of the old ones. What was typed there and is not in the page's state yet stays, and so do focus and scrolling.
export function renew(box, children) {
  const keyOf = (node) => node.id || node.getAttribute?.("aria-label") || node.textContent, fields = () => [...box.querySelectorAll("input")];
  const active = box.contains(document.activeElement) ? document.activeElement : null, focused = active && active !== box ? keyOf(active) : "", tops = [box, ...box.querySelectorAll(".scroll")].map((each) => each.scrollTop);
  const caret = active?.type === "text" ? [active.selectionStart, active.selectionEnd] : null;
  const typed = fields().filter((input) => input.type !== "file" && (input.value !== input.defaultValue || input.checked !== input.defaultChecked)).map((input) => [keyOf(input), input.defaultValue, input.value, input.checked]);
  box.replaceChildren(...children.filter(Boolean));
  for (const [key, before, value, checked] of typed) { const input = fields().find((each) => keyOf(each) === key && each.defaultValue === before); if (input) Object.assign(input, { value, checked }); }
  [box, ...box.querySelectorAll(".scroll")].forEach((each, n) => { each.scrollTop = tops[n] ?? 0; });
  const again = focused ? [...box.querySelectorAll("button, input, select, a, summary, [tabindex]")].find((each) => keyOf(each) === focused) : null;
  again?.focus({ preventScroll: true });
  if (caret && again?.type === "text") again.setSelectionRange(...caret);
}
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) name.startsWith("on") ? made.addEventListener(name.slice(2), value) : made.setAttribute(name, value);
  made.append(...children);
  return made;
}
export const number = (value, digits = 0) => Number.isFinite(value) ? value.toFixed(digits) : "–";
export const percent = (value, digits = 1) => Number.isFinite(value) ? `${(100 * value).toFixed(digits)} %` : "–";
export function debounced(call, ms) {
  let timer = 0;
  return (...given) => { clearTimeout(timer); timer = setTimeout(() => call(...given), ms); };
}
// At most one request at a time; of those that come meanwhile the last one counts.
export function latest(call) {
  let busy = false, next = null;
  return async function run(...given) {
    if (busy) { next = given; return; }
    busy = true;
    try { await call(...given); } finally { busy = false; if (next) { const again = next; next = null; run(...again); } }
  };
}
// One after the other, each of them.
export function queued(call) {
  let last = Promise.resolve();
  return (...given) => { last = last.catch(() => {}).then(() => call(...given)); return last; };
}
export async function api(path, body) {
  const options = body === undefined ? {} : { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
  let answer;
  try { answer = await fetch(path, { credentials: "same-origin", ...options }); } catch { throw new Error(t("unreachable")); }
  const document = await answer.json().catch(() => ({ error: `${answer.status} ${answer.statusText}` }));
  if (!answer.ok) throw Object.assign(new Error(document.error ?? answer.statusText), { field: document.field ?? "" });
  return document;
}
