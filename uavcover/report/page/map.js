"use strict";
// The map. Places are local metres: Leaflet's "latitude" is north, its "longitude" is east.
const data = JSON.parse(document.getElementById("data").textContent);
const report = { layer: null, onLayer: [], showPlace: null };
// Flights have dark colours by light and light ones in the dark; the broad line of the plan below them has the opposite.
report.plannedColor = window.matchMedia("(prefers-color-scheme: dark)").matches ? "#56668a" : "#ffffff";
report.trackLook = ({ style }) => {
  const number = Number(style.split("-")[1]), colors = 8;
  return { color: getComputedStyle(document.documentElement).getPropertyValue(`--flight-${number % colors}`).trim(), dashArray: number < colors ? null : "7 5" };
};

(function () {
  const at = (place) => [place[1], place[0]];
  const corners = ([west, south, east, north]) => [[south, west], [north, east]];
  const map = L.map("map", { crs: L.CRS.Simple, minZoom: -8, maxZoom: 8, zoomSnap: 0.25, zoomDelta: 0.5 });
  map.attributionControl.setPrefix("Leaflet");
  // Beside the list of layers, where it is open and there is room.
  const fit = () => {
    const list = document.querySelector("#map .leaflet-control-layers"), width = list && getComputedStyle(list).display !== "none" ? list.offsetWidth + 12 : 0;
    const right = width < 0.4 * map.getSize().x ? width : 0;
    map.fitBounds(corners(data.bounds), { animate: false, paddingTopLeft: [4, 4], paddingBottomRight: [4 + right, 4] });
  };
  fit();
  // Home, violations and the vehicle stay over marks that are drawn anew.
  map.createPane("above").style.zIndex = 450;
  L.control.scale({ imperial: false }).addTo(map);
  L.imageOverlay(data.relief, corners(data.bounds), { zIndex: 1 }).addTo(map);

  // Text from files goes in as text, never as markup.
  const popup = (title, rows) => {
    const table = document.createElement("table");
    table.createCaption().textContent = title;
    for (const [name, value] of rows) {
      const row = table.insertRow();
      row.insertCell().textContent = name;
      row.insertCell().textContent = value;
    }
    return table;
  };
  const geodetic = (east, north) => {
    if (!data.geodetic) return null;
    const e = east / 1000, n = north / 1000, basis = [1, e, n, e * e, e * n, n * n];
    const sum = (coefficients) => coefficients.reduce((total, c, i) => total + c * basis[i], 0);
    return [sum(data.geodetic.lat), sum(data.geodetic.lon)];
  };
  const placeWords = (east, north) => {
    const digits = Math.max(Math.abs(data.bounds[0]), Math.abs(data.bounds[2])) > 50 ? 0 : 2;
    const place = geodetic(east, north);
    const local = `${east.toFixed(digits)} m east, ${north.toFixed(digits)} m north`;
    return place ? `${place[0].toFixed(6)}°, ${place[1].toFixed(6)}°  (${local})` : local;
  };

  const outline = (rings, color, dashes) =>
    L.layerGroup(rings.map((ring) => L.polyline(ring.map(at), { color, weight: 2, dashArray: dashes, interactive: false })));
  const overlays = {};
  if (data.background) overlays["Background map"] = L.imageOverlay(data.background, corners(data.bounds), { className: "background", zIndex: 2 });
  // The legend below the map; names come from files, and go in as text.
  const key = (label, ...strokes) => {
    const item = document.createElement("li"), words = document.createElement("span");
    const drawing = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    drawing.setAttribute("viewBox", "0 0 26 12");
    drawing.setAttribute("aria-hidden", "true");
    for (const attributes of strokes) {
      if (attributes.bare) drawing.style.background = "none";
      const isMark = "r" in attributes;
      const shape = document.createElementNS(drawing.namespaceURI, isMark ? "circle" : "path");
      const all = isMark ? { cx: 13, cy: 6, ...attributes } : { d: "M2 6H24", fill: "none", ...attributes };
      delete all.bare;
      for (const [name, value] of Object.entries(all)) shape.setAttribute(name, value);
      drawing.append(shape);
    }
    words.textContent = label;
    item.append(drawing, words);
    document.getElementById("line-legend").append(item);
  };
  if (data.drawn.length) {
    overlays["Area"] = outline(data.drawn, "#7fc4ff");
    key("area as drawn", { stroke: "#7fc4ff", "stroke-width": 2 });
    overlays["Area with its margin"] = outline(data.area, "#7fc4ff", "2 5");
    key("with its margin", { stroke: "#7fc4ff", "stroke-width": 2, "stroke-dasharray": "2 4" });
  } else {
    overlays["Area"] = outline(data.area, "#7fc4ff");
    key("area", { stroke: "#7fc4ff", "stroke-width": 2 });
  }
  if (data.fence.length) overlays["Fence"] = outline(data.fence, "#ff7a59", "6 5");
  if (data.fence.length) key("fence", { stroke: "#ff7a59", "stroke-width": 2, "stroke-dasharray": "5 3" });
  if (data.noFly.length) {
    overlays[`No-fly zones (${data.noFly.length})`] = L.layerGroup(data.noFly.map((zone) =>
      L.polygon(zone.rings.map((ring) => ring.map(at)), { color: "#e0245e", weight: 2, fillColor: "#e0245e", fillOpacity: 0.22 })
        .bindPopup(() => popup(zone.name, [["no-fly zone", zone.heights]]))));
    key("no-fly zone", { stroke: "#e0245e", "stroke-width": 2 });
  }
  if (data.obstacles.length) {
    overlays[`Obstacles (${data.obstacles.length})`] = L.layerGroup(data.obstacles.map((obstacle) =>
      L.polygon(obstacle.rings.map((ring) => ring.map(at)), { color: "#3b2b52", weight: 1.5, fillColor: "#8e6fc1", fillOpacity: 0.55 })
        .bindPopup(() => popup(obstacle.name, [["height", `${obstacle.height} m`], ["position", placeWords(obstacle.rings[0][0][0], obstacle.rings[0][0][1])]]))));
  }
  // Of places too close together on the screen only the first ones of an order are drawn.
  const thinned = (places, order, apart) => {
    const taken = new Map(), kept = [], view = map.getBounds().pad(0.4);
    for (const i of order) {
      if (!view.contains(at(places[i]))) continue;
      const point = map.latLngToLayerPoint(at(places[i])), column = Math.floor(point.x / apart), row = Math.floor(point.y / apart);
      let free = true;
      for (let c = column - 1; free && c <= column + 1; c++) for (let r = row - 1; free && r <= row + 1; r++) {
        free = !(taken.get(`${c} ${r}`) || []).some((other) => other.distanceTo(point) < apart);
      }
      if (!free) continue;
      const cell = `${column} ${row}`;
      taken.set(cell, [...(taken.get(cell) || []), point]);
      kept.push(i);
    }
    return kept.sort((a, b) => a - b);
  };
  // A layer of marks that is thinned anew wherever the map is moved.
  const thinnedLayer = (places, order, apart, mark) => {
    const layer = L.layerGroup(), redraw = () => { layer.clearLayers(); thinned(places, order, apart).forEach((i) => layer.addLayer(mark(i))); };
    layer.on("add", () => { redraw(); map.on("moveend", redraw); });
    layer.on("remove", () => map.off("moveend", redraw));
    return layer;
  };
  // The ends of a route are always drawn.
  const endsFirst = (places) => places.length ? [places.length - 1, ...places.keys()].slice(0, places.length) : [];
  // Planned is broad and white, edged in the colour of its sortie; flown is thin and lies over it: both show where they agree.
  const dark = "#22304f", parts = data.sorties.length ? data.sorties : [{ name: "", points: data.plan }];
  const edge = (part) => part.name ? report.trackLook(part).color : dark;
  const lines = parts.flatMap((part) => [[edge(part), 7.5], [report.plannedColor, 5]].map(([color, weight]) =>
    L.polyline(part.points.map(at), { color, weight, interactive: false, className: "planned" })));
  for (const part of data.plan.length ? parts : []) {
    key(part.name ? `planned, ${part.name}` : "planned route", { stroke: edge(part), "stroke-width": 7.5 }, { stroke: report.plannedColor, "stroke-width": 5 });
  }
  if (data.plan.length) overlays["Planned route"] = L.layerGroup([...lines, thinnedLayer(data.plan, endsFirst(data.plan), 9, (i) =>
    L.circleMarker(at(data.plan[i]), { radius: 3.5, color: dark, weight: 1.5, fillColor: "#ffffff", fillOpacity: 1, className: "waypoint" })
      .bindPopup(() => popup(`waypoint ${i}`, [
        ["above ground", `${data.planHeights[i] === null ? "?" : data.planHeights[i].toFixed(1)} m`],
        ["position", placeWords(data.plan[i][0], data.plan[i][1])],
      ])))]);
  if (data.plan.length) overlays["Waypoint numbers"] = thinnedLayer(data.plan, endsFirst(data.plan), 26, (i) => {
    const text = document.createElement("span");
    text.textContent = String(i);
    return L.marker(at(data.plan[i]), { interactive: false, keyboard: false, icon: L.divIcon({ className: "number", html: text, iconSize: null, iconAnchor: [-5, 16] }) });
  });
  if (data.tracks.length) {
    // What the layer control shows is markup: names of files are made text first.
    const label = (track, color) => {
      const swatch = document.createElement("span"), words = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = color;
      words.textContent = data.tracks.length > 1 ? `Flown: ${track.name}` : "Flown track";
      return data.tracks.length > 1 ? swatch.outerHTML + words.outerHTML : words.outerHTML;
    };
    for (const track of data.tracks) {
      const look = report.trackLook(track);
      overlays[label(track, look.color)] = L.layerGroup([
        L.polyline(track.points.map(at), { ...look, weight: 2.2, interactive: false, className: `track ${track.style}` })]);
      key(data.tracks.length > 1 ? `flown, ${track.name}` : "flown", { stroke: look.color, "stroke-width": 2.2, "stroke-dasharray": look.dashArray || "none", bare: true });
    }
    const vehicle = L.circleMarker([0, 0], { pane: "above", radius: 7, color: "#000", weight: 2, fillColor: "#ffd400", fillOpacity: 1, interactive: false });
    report.showPlace = (place) => {
      if (place === null) return void vehicle.remove();
      vehicle.setLatLng(at(place)).addTo(map);
    };
  }
  for (const [name, look] of [["planned", { radius: 3, color: "#22304f", weight: 1.2, fillColor: "#9ec5ff", fillOpacity: 1 }],
    ["flown", { radius: 2.2, color: "#000000", weight: 0.8, fillColor: "#ffd400", fillOpacity: 1 }]]) {
    const places = data.pictures[name];
    if (!places.length) continue;
    overlays[`Photos, ${name} (${places.length})`] = thinnedLayer(places, endsFirst(places), 5, (i) =>
      L.circleMarker(at(places[i]), { ...look, className: `picture ${name}` })
        .bindPopup(() => popup(`photo ${i + 1}, ${name}`, [["position", placeWords(places[i][0], places[i][1])]])));
    key(`photo, ${name}`, { r: look.radius + 1, fill: look.fillColor, stroke: look.color, "stroke-width": look.weight });
  }
  if (data.footprints && data.footprints.length) {
    overlays[`Footprints (${data.footprints.length})`] = L.layerGroup(data.footprints.map((print) =>
      L.polygon(print.ring.map(at), { color: "#ffd400", weight: 0.8, opacity: 0.7, fillOpacity: 0, className: "footprint" })
        .bindPopup(() => popup(print.name, [["what", "footprint of the photo"]]))));
    key("footprint of a photo", { stroke: "#ffd400", "stroke-width": 1.2 });
  }
  if (data.home) {
    const home = L.circleMarker(at(data.home), { pane: "above", radius: 6, color: "#fff", weight: 2, fillColor: "#d6248f", fillOpacity: 1 });
    home.bindPopup(() => popup("home", [["position", placeWords(data.home[0], data.home[1])]]));
    overlays["Home"] = L.layerGroup([home]);
    key("home", { r: 5, fill: "#d6248f", stroke: "#ffffff", "stroke-width": 1.5 });
  }
  if (data.gaps.length) {
    const middles = data.gaps.map((gap) => [gap.east, gap.north]);
    overlays[`Gaps (${data.gaps.length})`] = thinnedLayer(middles, [...middles.keys()], 22, (i) => {
      const gap = data.gaps[i];
      return L.circleMarker(at(middles[i]), { radius: gap.area < 100 ? 5 : gap.area < 1000 ? 7 : 9, color: "#ffb000", weight: 2.5, dashArray: "3 3", fillOpacity: 0, className: "gap" })
        .bindPopup(() => popup(`${gap.area} m² not observed`, [["why", gap.reason], ["cells", gap.cells], ["position", placeWords(gap.east, gap.north)]]));
    });
    key("centre of a gap", { r: 4.5, fill: "none", stroke: "#ffb000", "stroke-width": 2, "stroke-dasharray": "2.5 2" });
  }
  if (data.violations.length) {
    overlays[`Violations (${data.violations.length})`] = L.layerGroup(data.violations.map((v) =>
      L.circleMarker([v.north, v.east], { pane: "above", radius: 9, color: "#fff", weight: 2, fillColor: "#b3261e", fillOpacity: 1 })
        .bindPopup(() => popup(v.kind, [["reached", v.worst], ["limit", v.limit], ["from", `${v.from} s`], ["to", `${v.to} s`], ["position", placeWords(v.east, v.north)]]))));
    key("violation", { r: 5, fill: "#b3261e", stroke: "#ffffff", "stroke-width": 1.5 });
  }

  if (data.unsafeReturns.length) {
    overlays[`Unsafe return (${data.unsafeReturns.length})`] = L.layerGroup(data.unsafeReturns.flatMap((part) => {
      const words = () => popup("unsafe return", [["why", part.words], ["worst", placeWords(part.east, part.north)]]);
      return [
        L.polyline(part.points.map((p) => [p[1], p[0]]), { color: "#b3261e", weight: 7, opacity: 0.55, className: "unsafe-return" }).bindPopup(words),
        L.circleMarker([part.north, part.east], { pane: "above", radius: 6, color: "#b3261e", weight: 2, fillColor: "#fff", fillOpacity: 1 }).bindPopup(words),
      ];
    }));
    key("from here the autopilot's own return is not safe", { r: 5, fill: "none", stroke: "#b3261e", "stroke-width": 3 });
  }

  // One picture of the cells at a time; the relief lies under all of them.
  const grounds = {};
  const cellLayers = data.cells.map((layer) => {
    const picture = L.imageOverlay(layer.image, corners(data.cellBounds), { className: "cells", zIndex: 3 });
    picture.cells = layer;
    grounds[layer.title] = picture;
    return picture;
  });
  const bare = L.layerGroup();
  bare.cells = null;
  grounds["Relief only"] = bare;
  const legend = document.getElementById("legend");
  const show = (layer) => {
    report.layer = layer;
    legend.textContent = "";
    const isRamp = layer && layer.legend.some((entry) => !entry.label);
    for (const entry of layer ? layer.legend : []) {
      const item = document.createElement("span");
      item.className = isRamp ? "ramp" : "entry";
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = entry.color;
      const label = document.createElement("span");
      label.className = "value";
      label.textContent = entry.label;
      item.append(...(isRamp && entry === layer.legend[0] ? [label, swatch] : [swatch, label]));
      if (isRamp && !entry.label) label.remove();
      legend.append(item);
    }
    report.onLayer.forEach((tell) => tell(layer));
  };
  map.on("baselayerchange", (event) => show(event.layer.cells));
  (cellLayers[0] || bare).addTo(map);
  for (const [name, layer] of Object.entries(overlays)) {
    const buries = data.pictures.flown.length || data.pictures.planned.length > 100;  // the route below them
    if (!(name.startsWith("Photos, planned") && buries)) layer.addTo(map);
  }
  const control = L.control.layers(grounds, overlays, { collapsed: false, autoZIndex: false }).addTo(map);
  const box = control.getContainer();
  const button = L.DomUtil.create("button", "layers-button");
  button.type = "button";
  button.textContent = "Layers";
  button.onclick = () => box.classList.toggle("folded");
  box.classList.add("folded");
  const holder = L.control({ position: "topright" });
  holder.onAdd = () => (L.DomEvent.disableClickPropagation(button), button);
  holder.addTo(map);
  box.parentNode.prepend(button);
  fit();

  const pointer = document.getElementById("pointer");
  map.on("mousemove", (event) => { pointer.textContent = placeWords(event.latlng.lng, event.latlng.lat); });
  map.on("mouseout", () => { pointer.textContent = ""; });
  window.addEventListener("beforeprint", () => { map.invalidateSize({ animate: false }); fit(); });
  window.addEventListener("afterprint", () => { map.invalidateSize({ animate: false }); fit(); });
  report.map = map;
  report.start = () => show(cellLayers.length ? data.cells[0] : null);
})();
