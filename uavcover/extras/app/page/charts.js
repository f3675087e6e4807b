// The trade-off and the height profile, as SVG.
import { el, svg, number, percent } from "/page/dom.js";
import { t } from "/page/strings.js";

export function tradeoff(members, onChoose) {
  const width = 320, height = 180, left = 44, bottom = 26, top = 8, right = 10;
  const x = scale(members.map((m) => m.timeS / 60), left, width - right), y = scale(members.map((m) => 100 * m.coverage), height - bottom, top);
  const chart = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "group" });
  chart.append(svg("path", { class: "axis", fill: "none", d: `M${left} ${top}V${height - bottom}H${width - right}` }));
  for (const [value, at] of x.ticks) chart.append(svg("text", { x: at, y: height - 10, "text-anchor": "middle" }, number(value, value < 10 ? 1 : 0)));
  for (const [value, at] of y.ticks) chart.append(svg("text", { x: left - 4, y: at + 4, "text-anchor": "end" }, number(value, 1)));
  chart.append(svg("text", { x: width - right, y: height - 1, "text-anchor": "end" }, t("minutes")), svg("text", { x: 2, y: 10 }, "%"));
  for (const m of [...members].sort((one, other) => one.chosen - other.chosen)) { // the chosen one above the others
    const label = `${percent(m.coverage)}, ${m.waypoints} ${t("waypoints")}, ${number(m.timeS / 60, 1)} ${t("minutes")}, ${m.madeBy}`;
    const dot = svg("circle", {
      class: "member", cx: x.at(m.timeS / 60), cy: y.at(100 * m.coverage), r: m.chosen ? 7 : 5, fill: m.chosen ? "#d55e00" : "#0072b2",
      tabindex: 0, role: "button", "aria-label": label, onclick: () => onChoose(m), onkeydown: (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); onChoose(m); } },
    }, svg("title", {}, label));
    chart.append(dot);
  }
  return chart;
}

export function profile(figure, profiles, at = null) {
  figure.replaceChildren();
  const points = profiles.flatMap((p) => p.flight.filter((v) => v !== null));
  figure.hidden = points.length === 0;
  if (figure.hidden) return;
  const total = profiles.reduce((sum, p) => sum + p.along.at(-1), 0) || 1, top = Math.max(...points) * 1.08 + 1;
  const width = 1000, height = 120, x = (v) => 40 + ((width - 50) * v) / total, y = (v) => height - 6 - ((height - 26) * v) / top;
  const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", role: "img", "aria-label": t("profile") });
  let begin = 0;
  for (const p of profiles) {
    const ground = p.along.map((v, n) => [x(begin + v), y(p.ground[n] ?? 0)]), flight = p.along.map((v, n) => [x(begin + v), y(p.flight[n] ?? 0)]);
    const path = (line) => line.map((point, n) => `${n ? "L" : "M"}${point[0].toFixed(1)} ${point[1].toFixed(1)}`).join("");
    drawing.append(svg("path", { d: `${path(ground)}L${ground.at(-1)[0]} ${height}L${ground[0][0]} ${height}Z`, fill: "#8d7a5e", "fill-opacity": 0.6 }));
    drawing.append(svg("path", { d: path(flight), fill: "none", stroke: "#1f6fd0", "stroke-width": 2, "vector-effect": "non-scaling-stroke" }));
    if (profiles.length > 1) drawing.append(svg("text", { x: x(begin) + 4, y: height - 4 }, `${t("sortie")} ${profiles.indexOf(p) + 1}`));
    begin += p.along.at(-1);
  }
  for (const value of [0, top / 2, top / 1.08]) drawing.append(svg("text", { x: 2, y: Math.max(10, y(value)) }, `${number(value)} m`));
  const line = (color, label) => { const dash = el("b", {}, "━ "); dash.style.color = color; return [dash, label]; };
  figure.append(drawing, el("figcaption", {}, `${t("profile")}: `, ...line("#1f6fd0", t("profileFlight")), " ", ...line("#8d7a5e", t("profileGround"))));
}

function scale(values, from, to) {
  let low = Math.min(...values), high = Math.max(...values);
  if (!(high > low)) { low -= 0.5; high += 0.5; }
  const pad = 0.05 * (high - low);
  low -= pad; high += pad;
  const at = (value) => from + ((to - from) * (value - low)) / (high - low);
  return { at, ticks: [0.15, 0.5, 0.85].map((share) => low + share * (high - low)).map((value) => [value, at(value)]) };
}
