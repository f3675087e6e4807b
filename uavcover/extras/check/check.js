"use strict";
// The map of a checked mission. Places are local metres: Leaflet's "latitude" is north, its "longitude" is east.
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = (place) => [place[1], place[0]];
  const [west, south, east, north] = data.bounds, corners = [[south, west], [north, east]];
  const map = L.map("map", { crs: L.CRS.Simple, minZoom: -8, maxZoom: 8, zoomSnap: 0.25, zoomDelta: 0.5 });
  map.attributionControl.setPrefix("Leaflet");
  map.fitBounds(corners, { animate: false });
  L.control.scale({ imperial: false }).addTo(map);
  L.imageOverlay(data.relief, corners).addTo(map);
  const legend = document.getElementById("line-legend");
  const svg = (name, attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };
  const key = (label, color) => {
    const item = document.createElement("li"), drawing = svg("svg", { viewBox: "0 0 26 12", "aria-hidden": "true" }), words = document.createElement("span");
    drawing.append(svg("path", { d: "M2 6H24", stroke: color, "stroke-width": 3 }));
    words.textContent = label;
    item.append(drawing, words);
    legend.append(item);
  };
  // Text from files goes in as text, never as markup.
  const popup = (title, lines) => {
    const box = document.createElement("div"), head = document.createElement("b");
    head.textContent = title;
    box.append(head);
    for (const line of lines) { const row = document.createElement("div"); row.textContent = line; box.append(row); }
    return box;
  };
  const shapes = (label, color, list, rings, words) => {
    if (!list.length) return;
    for (const each of list) L.polygon(rings(each).map((ring) => ring.map(at)), { color, weight: 2, fillColor: color, fillOpacity: 0.2 }).addTo(map).bindPopup(() => words(each));
    key(label, color);
  };
  if (data.unseen.length) {
    L.polygon(data.unseen.map((ring) => ring.map(at)), { color: "#ffb000", weight: 1, fillColor: "#ffb000", fillOpacity: 0.3, fillRule: "evenodd" }).addTo(map).bindPopup(() => popup("unobserved", []));
    key("not in any photo", "#ffb000");
  }
  for (const ring of data.fence) L.polyline(ring.points.map(at), { color: ring.inside ? "#ff7a59" : "#e0245e", weight: 2, dashArray: "6 5", interactive: false }).addTo(map);
  if (data.fence.length) key("fence", "#ff7a59");
  shapes("no-fly zone", "#e0245e", data.noFly, (zone) => zone.rings, (zone) => popup(zone.name, [zone.heights]));
  shapes("obstacle", "#8e6fc1", data.obstacles, (one) => one.rings, (one) => popup(one.name, []));
  for (const place of data.pictures.slice(0, 3000)) L.circleMarker(at(place), { radius: 2, color: "#22304f", weight: 1, fillColor: "#9ec5ff", fillOpacity: 1, interactive: false }).addTo(map);

  const figure = document.getElementById("leg-profile");
  const show = (leg) => {
    const drawing = figure.querySelector("svg"), ground = leg.ground.map((height, i) => (height === null ? leg.path[i] : height));
    const low = Math.min(...leg.path, ...ground), high = Math.max(...leg.path, ...ground), length = Math.max(leg.length, 0.1);
    const x = (metres) => 60 + (680 * metres) / length, y = (height) => 190 - (170 * (height - low)) / Math.max(high - low, 1);
    const line = (heights) => heights.map((height, i) => `${i ? "L" : "M"}${x(leg.at[i]).toFixed(1)} ${y(height).toFixed(1)}`).join("");
    drawing.replaceChildren(
      svg("path", { class: "line-ground", d: `${line(ground)}V200H60Z` }),
      svg("path", { class: leg.broken ? "line-limit" : "line-planned", d: line(leg.path) }),
      ...[[low, 190], [high, 20]].map(([height, place]) => { const text = svg("text", { class: "tick", x: 54, y: place + 4, "text-anchor": "end" }); text.textContent = `${height.toFixed(0)} m`; return text; }),
    );
    figure.querySelector("h3").textContent = `Item ${leg.from} to item ${leg.to}`;
    figure.querySelector("figcaption").textContent = `${leg.length} m long, ${leg.clearance === null ? "unknown height" : `${leg.clearance} m at least`} above ground; ${leg.broken ? "a limit is broken" : "limits are kept"}`;
    figure.hidden = false;
  };
  for (const leg of data.legs) {
    const color = leg.broken ? "#d11a1a" : leg.phase === "route" ? "#2b4fa0" : "#5d666e";
    L.polyline(leg.points.map(at), { color: "#ffffff", weight: 6, interactive: false }).addTo(map);
    L.polyline(leg.points.map(at), { color, weight: leg.broken ? 4.5 : 3, className: leg.broken ? "leg broken" : "leg" }).addTo(map).on("click", () => show(leg));
  }
  key("path", "#2b4fa0");
  key("take-off, return, landing", "#5d666e");
  if (data.legs.some((leg) => leg.broken)) key("limit exceeded", "#d11a1a");
  for (const one of data.findings) {
    if (!one.place) continue;
    L.circleMarker(at(one.place), { radius: 7, color: "#fff", weight: 2, fillColor: one.weight === "breaks" ? "#b3261e" : "#806000", fillOpacity: 1, className: "finding" })
      .addTo(map).bindPopup(() => popup(`${one.number}: ${one.kind}`, [one.what, one.do]));
  }
  L.circleMarker([0, 0], { radius: 6, color: "#fff", weight: 2, fillColor: "#d6248f", fillOpacity: 1 }).addTo(map).bindPopup(() => popup("home", []));
  key("home", "#d6248f");
  const pointer = document.getElementById("pointer");
  map.on("mousemove", ({ latlng }) => {
    const e = latlng.lng / 1000, n = latlng.lat / 1000, basis = [1, e, n, e * e, e * n, n * n];
    const sum = (coefficients) => coefficients.reduce((total, c, i) => total + c * basis[i], 0);
    pointer.textContent = data.geodetic ? `${sum(data.geodetic.lat).toFixed(6)}°, ${sum(data.geodetic.lon).toFixed(6)}°` : "";
  });
})();
