"use strict";
// The map. Places are local metres: Leaflet's "latitude" is north, its "longitude" is east.
const data = JSON.parse(document.getElementById("data").textContent);
const report = { layer: null, onLayer: [], showPlace: null };
report.trackLook = ({ style }) => {
  const number = Number(style.split("-")[1]), colors = 8;
  return { color: getComputedStyle(document.documentElement).getPropertyValue(`--flight-${number % colors}`).trim(), dashArray: number < colors ? null : "7 5" };
};

(function () {
  const at = (place) => [place[1], place[0]];
  const corners = ([west, south, east, north]) => [[south, west], [north, east]];
  const map = L.map("map", { crs: L.CRS.Simple, minZoom: -8, maxZoom: 8, zoomSnap: 0.25, zoomDelta: 0.5 });
  map.attributionControl.setPrefix("Leaflet");
  const fit = () => map.fitBounds(corners(data.bounds), { animate: false, padding: [4, 4] });
  fit();
  L.control.scale({ imperial: false }).addTo(map);
  L.imageOverlay(data.relief, corners(data.bounds), { zIndex: 1 }).addTo(map);

  // Whatever comes from files goes in as text, never as markup.
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
  overlays["Area"] = outline(data.area, "#7fc4ff");
  overlays["Fence"] = outline(data.fence, "#ff7a59", "6 5");
  if (data.obstacles.length) {
    overlays[`Obstacles (${data.obstacles.length})`] = L.layerGroup(data.obstacles.map((obstacle) =>
      L.polygon(obstacle.rings.map((ring) => ring.map(at)), { color: "#3b2b52", weight: 1.5, fillColor: "#8e6fc1", fillOpacity: 0.55 })
        .bindPopup(() => popup(obstacle.name, [["height", `${obstacle.height} m`], ["place", placeWords(obstacle.rings[0][0][0], obstacle.rings[0][0][1])]]))));
  }
  const planned = L.polyline(data.plan.map(at), { color: "#ffffff", weight: 2.5, interactive: false });
  const shadow = L.polyline(data.plan.map(at), { color: "#22304f", weight: 4.5, interactive: false });
  overlays["Planned route"] = L.layerGroup([shadow, planned, ...data.plan.map((place, i) =>
    L.circleMarker(at(place), { radius: 3.5, color: "#22304f", weight: 1.5, fillColor: "#ffffff", fillOpacity: 1 })
      .bindPopup(() => popup(`waypoint ${i}`, [
        ["above ground", `${data.planHeights[i] === null ? "?" : data.planHeights[i].toFixed(1)} m`],
        ["place", placeWords(place[0], place[1])],
      ])))]);
  const numbers = data.plan.map((place, i) => {
    const text = document.createElement("span");
    text.textContent = String(i);
    return L.marker(at(place), { interactive: false, keyboard: false, icon: L.divIcon({ className: "number", html: text, iconSize: null, iconAnchor: [-5, 16] }) });
  });
  overlays["Waypoint numbers"] = L.layerGroup(numbers);
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
      const look = report.trackLook(track), places = track.points.map(at);
      overlays[label(track, look.color)] = L.layerGroup([
        L.polyline(places, { color: "#ffffff", weight: 4, opacity: 0.55, interactive: false }),
        L.polyline(places, { ...look, weight: 2.2, interactive: false, className: `track ${track.style}` })]);
    }
    const vehicle = L.circleMarker([0, 0], { radius: 7, color: "#000", weight: 2, fillColor: "#ffd400", fillOpacity: 1, interactive: false });
    report.showPlace = (place) => {
      if (place === null) return void vehicle.remove();
      vehicle.setLatLng(at(place)).addTo(map);
    };
  }
  if (data.home) {
    const home = L.circleMarker(at(data.home), { radius: 6, color: "#fff", weight: 2, fillColor: "#d6248f", fillOpacity: 1 });
    home.bindPopup(() => popup("home", [["place", placeWords(data.home[0], data.home[1])]]));
    overlays["Home"] = L.layerGroup([home]);
  }
  if (data.gaps.length) {
    overlays[`Gaps (${data.gaps.length})`] = L.layerGroup(data.gaps.map((gap) =>
      L.circle([gap.north, gap.east], { radius: 1.4 * Math.sqrt(gap.area / Math.PI) + 4, color: "#d55e00", weight: 2, dashArray: "3 4", fillOpacity: 0 })
        .bindPopup(() => popup(`${gap.area} m² not seen`, [["why", gap.reason], ["cells", gap.cells], ["place", placeWords(gap.east, gap.north)]]))));
  }
  if (data.violations.length) {
    overlays[`Violations (${data.violations.length})`] = L.layerGroup(data.violations.map((v) =>
      L.circleMarker([v.north, v.east], { radius: 9, color: "#fff", weight: 2, fillColor: "#b3261e", fillOpacity: 1 })
        .bindPopup(() => popup(v.kind, [["reached", v.worst], ["limit", v.limit], ["from", `${v.from} s`], ["to", `${v.to} s`], ["place", placeWords(v.east, v.north)]]))));
  }

  // One picture of the cells at a time; the relief lies under all of them.
  const grounds = {};
  const cellLayers = data.cells.map((layer) => {
    const picture = L.imageOverlay(layer.image, corners(data.cellBounds), { className: "cells", zIndex: 2 });
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
    if (name !== "Waypoint numbers" || data.plan.length <= 60) layer.addTo(map);
  }
  const control = L.control.layers(grounds, overlays, { collapsed: false }).addTo(map);
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

  const pointer = document.getElementById("pointer");
  map.on("mousemove", (event) => { pointer.textContent = placeWords(event.latlng.lng, event.latlng.lat); });
  map.on("mouseout", () => { pointer.textContent = ""; });
  window.addEventListener("beforeprint", () => { map.invalidateSize({ animate: false }); fit(); });
  window.addEventListener("afterprint", () => { map.invalidateSize({ animate: false }); fit(); });
  report.map = map;
  report.start = () => show(cellLayers.length ? data.cells[0] : null);
})();
