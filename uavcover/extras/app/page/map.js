// The map: terrain, shapes, route, coverage, vehicles. Data are longitude and latitude; nothing is fetched from another host.
import * as maplibre from "/vendor/maplibre-gl/maplibre-gl.mjs";
import { TerraDraw, TerraDrawPolygonMode, TerraDrawSelectMode, TerraDrawRenderMode } from "terra-draw";
import { api } from "/page/dom.js";
import { TerraDrawMapLibreGLAdapter } from "/vendor/terra-draw/terra-draw-maplibre-gl-adapter.module.js";

maplibre.setWorkerUrl("/vendor/maplibre-gl/maplibre-gl-worker.mjs");

export const COLORS = {
  area: "#0072b2", zone: "#cc3311", fence: "#666666", obstacle: "#886622", route: "#1a1a8c", bad: "#e00000", track: "#d000a0",
  home: "#111111", rally: "#00725f", gap: "#d55e00", unsafe: "#ff8800", photo: "#333333",
};
export const SORTIES = ["#1a1a8c", "#b5460f", "#00725f", "#8a2f8a", "#5a5a00", "#0077aa", "#aa0055", "#444444"];
const SLOW_MS = 60, STILL_MS = 400, LONGEST_MS = 5000, MESH = 32; // MESH: squares of a terrain tile along one side, instead of 128
const EMPTY = { type: "FeatureCollection", features: [] };
const collection = (features) => ({ type: "FeatureCollection", features });
const feature = (type, coordinates, properties = {}) => ({ type: "Feature", properties, geometry: { type, coordinates } });
const polygon = (rings, properties) => feature("Polygon", rings, properties);

const SHAPES = ["contours", "area", "fence", "zones", "obstacles", "unsafe", "photos", "footprints", "missing", "path", "route", "bad", "incumbent", "track", "gaps", "findings", "waypoints", "rally", "home", "vehicles"];

export class CoverageMap {
  constructor(container) {
    this.map = new maplibre.Map({
      container, attributionControl: false, maxPitch: 80, fadeDuration: 0, center: [0, 20], zoom: 1.2, pixelRatio: Math.min(window.devicePixelRatio, 2),
      style: { version: 8, sources: {}, layers: [{ id: "ground", type: "background", paint: { "background-color": "#dfe5dd" } }] },
    });
    this.map.addControl(new maplibre.NavigationControl({ visualizePitch: true }), "top-right");
    this.map.addControl(new maplibre.ScaleControl({}), "bottom-right");
    this.ready = new Promise((done) => this.map.on("load", () => { this.prepare(); done(); }));
    this.tracks = new Map();
    this.terrain = false;
    this.hurry();
  }

  // A slow renderer draws less while the map moves: no relief, half the pixels. What is left out comes back when it stands still.
  hurry() {
    let last = 0, slow = 0, less = false, timer = 0, own = false, until = 0;
    const full = this.map.getPixelRatio();
    const show = (on) => {
      own = true;
      less = !on;
      for (const id of ["relief", "contours"]) if (this.map.getLayer(id)) this.map.setLayoutProperty(id, "visibility", on ? "visible" : "none");
      this.map.setPixelRatio(on ? full : full / 2);
      const terrain = this.map.terrain;
      if (terrain && terrain.meshSize !== MESH) Object.assign(terrain, { qualityFactor: 1, meshSize: MESH, _meshCache: {} });
      own = false;
    };
    this.map.on("render", () => {
      const now = performance.now(), took = now - last;
      last = now;
      if (now >= until) return;
      slow = took < LONGEST_MS ? 0.7 * slow + 0.3 * took : slow;
      if (slow > SLOW_MS && !less) show(false);
    });
    const still = () => { if (performance.now() < until) timer = setTimeout(still, until - performance.now() + 1); else { timer = slow = 0; if (less) show(true); } };
    const moved = () => {
      if (own) return;
      until = performance.now() + Math.max(STILL_MS, 3 * slow);
      timer ||= setTimeout(still, STILL_MS);
    };
    this.map.on("move", moved);
  }

  prepare() {
    for (const name of SHAPES) this.map.addSource(name, { type: "geojson", data: EMPTY });
    const line = (id, source, color, width, more = {}) => this.map.addLayer({ id, source, type: "line", layout: { "line-join": "bevel" }, paint: { "line-color": color, "line-width": width, ...more } });
    const own = ["coalesce", ["get", "color"], COLORS.route];
    // Draped layers come first, without others between them: the terrain draws each unbroken series of them once.
    line("contours", "contours", "#5b4a33", ["case", ["get", "major"], 1.1, 0.5], { "line-opacity": 0.55 });
    this.map.addLayer({ id: "area-fill", source: "area", type: "fill", paint: { "fill-color": COLORS.area, "fill-opacity": 0.08 } });
    line("area", "area", COLORS.area, 2.2);
    line("fence", "fence", COLORS.fence, 2, { "line-dasharray": [4, 3] });
    this.map.addLayer({ id: "zones-fill", source: "zones", type: "fill", paint: { "fill-color": COLORS.zone, "fill-opacity": 0.22 } });
    line("zones", "zones", COLORS.zone, 1.6);
    line("unsafe", "unsafe", COLORS.unsafe, 7, { "line-opacity": 0.55 });
    line("footprints", "footprints", COLORS.rally, 0.8, { "line-opacity": 0.6 });
    this.map.addLayer({ id: "missing", source: "missing", type: "fill", paint: { "fill-color": COLORS.gap, "fill-opacity": 0.7 } });
    line("path", "path", "#555555", 1, { "line-dasharray": [2, 2] });
    line("route", "route", own, 2.4);
    line("bad", "bad", COLORS.bad, 4.5);
    line("incumbent", "incumbent", COLORS.route, 1.6, { "line-opacity": 0.7 });
    line("track-edge", "track", "#ffffff", 5.5);
    line("track", "track", ["coalesce", ["get", "color"], COLORS.track], 2.6);
    const dots = (id, radius, color, stroke = null) => this.map.addLayer({ id, source: id, type: "circle", paint: { "circle-radius": radius, "circle-color": color, ...(stroke ?? {}) } });
    const white = { "circle-stroke-color": "#fff", "circle-stroke-width": 1.5 };
    this.map.addLayer({ id: "obstacles", source: "obstacles", type: "fill-extrusion", paint: { "fill-extrusion-color": COLORS.obstacle, "fill-extrusion-height": ["get", "height"], "fill-extrusion-opacity": 0.7 } });
    dots("photos", ["coalesce", ["get", "size"], 1.6], ["coalesce", ["get", "color"], COLORS.photo]);
    dots("gaps", 7, COLORS.gap, white);
    dots("findings", 7, COLORS.bad, white);
    dots("waypoints", ["case", ["get", "chosen"], 8, 4.5], ["case", ["get", "chosen"], "#ffcc00", "#ffffff"], { "circle-stroke-color": COLORS.route, "circle-stroke-width": 1.6 });
    const signs = (id, icon, more = {}) => this.map.addLayer({ id, source: id, type: "symbol", layout: { "icon-image": icon, "icon-allow-overlap": true, "icon-ignore-placement": true, ...more } });
    for (const [name, letter, color] of [["home", "H", COLORS.home], ["rally", "R", COLORS.rally]]) { this.map.addImage(name, sign(color, letter), { pixelRatio: 2 }); signs(name, name); }
    [COLORS.track, ...SORTIES].forEach((color) => this.map.addImage(`vehicle-${color}`, arrow(color), { pixelRatio: 2 }));
    signs("vehicles", ["concat", "vehicle-", ["get", "color"]], { "icon-rotate": ["get", "yaw"], "icon-rotation-alignment": "map" });
    this.draw = new TerraDraw({
      adapter: new TerraDrawMapLibreGLAdapter({ map: this.map }),
      modes: [
        new TerraDrawPolygonMode({ pointerDistance: 24, styles: { fillColor: COLORS.area, outlineColor: COLORS.area, fillOpacity: 0.12, outlineWidth: 3 } }),
        new TerraDrawSelectMode({ flags: { polygon: { feature: { draggable: true, coordinates: { midpoints: true, draggable: true, deletable: true } } } } }),
        new TerraDrawRenderMode({ modeName: "static", styles: {} }),
      ],
    });
    this.draw.start();
    this.draw.setMode("static");
    for (const { id } of this.map.getStyle().layers) if (id.startsWith("td-")) this.map.moveLayer(id, "obstacles");
  }

  set(name, features) { this.map.getSource(name)?.setData(collection(features)); }

  // Relief and 3D heights from the user's own elevation file.
  async heights(query) {
    if (query === this.heightsQuery) return;
    this.heightsQuery = query;
    this.map.setTerrain(null);
    if (this.map.getLayer("relief")) this.map.removeLayer("relief");
    for (const id of ["heights", "heights-relief"]) if (this.map.getSource(id)) this.map.removeSource(id);
    if (!query) return;
    const found = await api(`/api/heights?${query}`).catch(() => ({ finestZoom: 14 }));
    if (query !== this.heightsQuery || this.map.getSource("heights")) return;
    const tiles = [`${location.origin}/tiles/heights/{z}/{x}/{y}.png?${query}`];
    for (const id of ["heights", "heights-relief"]) this.map.addSource(id, { type: "raster-dem", tiles, tileSize: 256, encoding: "terrarium", minzoom: 5, maxzoom: found.finestZoom });
    this.map.addLayer({ id: "relief", source: "heights-relief", type: "hillshade", paint: { "hillshade-exaggeration": 0.55 } }, "contours");
    this.show3d(this.terrain);
  }

  show3d(on) {
    this.terrain = on;
    this.map.setTerrain(on && this.heightsQuery ? { source: "heights", exaggeration: 1 } : null);
    if (on && this.map.getPitch() < 20) this.map.easeTo({ pitch: 60, duration: 0 });
    if (!on) this.map.easeTo({ pitch: 0, bearing: 0, duration: 0 });
  }

  background(file) {
    if (this.map.getLayer("background")) { this.map.removeLayer("background"); this.map.removeSource("background"); }
    if (!file) return;
    this.map.addSource("background", { type: "raster", tiles: [`${location.origin}/tiles/background/{z}/{x}/{y}?file=${encodeURIComponent(file)}`], tileSize: 256 });
    this.map.addLayer({ id: "background", source: "background", type: "raster" }, this.map.getLayer("relief") ? "relief" : "contours");
  }

  // One picture of the cells, draped on the terrain: a layer as a whole, or the rectangles of it that changed during a flight.
  cells(image, corners) {
    this.isLive = false;
    if (this.map.getLayer("cells")) this.map.setLayoutProperty("cells", "visibility", "none");
    return this.paint(image ? [{ x: 0, y: 0, image }] : [], corners);
  }

  async patches({ size, corners, patches, whole }) {
    if (!whole && !(this.isLive && this.canvas.width === size[0] && this.canvas.height === size[1])) return false;
    await this.paint(patches, corners, whole ? size : null);
    this.isLive = true;
    return true;
  }

  async paint(patches, corners, size = null) {
    const turn = this.turn = (this.turn ?? 0) + 1;
    const pictures = await Promise.all(patches.map(async (patch) => { const picture = new Image(); picture.src = patch.image; await picture.decode(); return [picture, patch.x, patch.y]; }));
    if (turn !== this.turn || !pictures.length) return;
    this.canvas ??= document.createElement("canvas");
    const whole = size ?? (this.isLive ? null : [pictures[0][0].width, pictures[0][0].height]), pen = this.canvas.getContext("2d");
    if (whole) [this.canvas.width, this.canvas.height] = whole;
    for (const [picture, x, y] of pictures) { pen.clearRect(x, y, picture.width, picture.height); pen.drawImage(picture, x, y); }
    if (!this.map.getSource("cells")) {
      this.map.addSource("cells", { type: "canvas", canvas: this.canvas, coordinates: corners, animate: false });
      this.map.addLayer({ id: "cells", source: "cells", type: "raster", paint: { "raster-opacity": 0.75, "raster-resampling": "nearest", "raster-fade-duration": 0 } }, "area-fill");
    }
    const source = this.map.getSource("cells");
    source.setCoordinates(corners);
    this.map.setLayoutProperty("cells", "visibility", "visible");
    source.play(); // the texture is renewed by the next frame
    this.map.once("render", () => source.pause());
    this.map.triggerRepaint();
  }

  fit(bounds, padding = 40) {
    if (bounds) this.map.fitBounds([[bounds[0], bounds[1]], [bounds[2], bounds[3]]], { padding: { top: Math.max(padding, (this.tools?.offsetHeight ?? 0) + 14), right: padding, bottom: padding, left: padding }, duration: 0, maxZoom: 18 });
  }

  scene(doc) {
    this.set("area", doc ? [polygon(doc.drawn.length ? doc.drawn.slice(0) : doc.area)].map(evenOdd).flat() : []);
    this.set("fence", doc ? doc.fence.map((ring) => feature("LineString", ring)) : []);
    this.set("zones", doc ? doc.zones.map((zone) => polygon(zone.rings, { name: zone.name, text: zone.heights })) : []);
    this.set("obstacles", doc ? doc.obstacles.map((o) => polygon(o.rings, { height: o.heightM, name: o.name })) : []);
    this.set("home", doc?.home ? [feature("Point", doc.home)] : []);
    this.set("rally", (doc?.rally ?? []).map((p) => feature("Point", p)));
    this.set("path", (doc?.paths ?? []).map((path) => feature("LineString", path)));
    this.set("photos", (doc?.photos?.planned ?? []).map((p) => feature("Point", p)));
    this.set("unsafe", (doc?.unsafeReturns ?? []).filter((u) => u.line.length > 1).map((u) => feature("LineString", u.line, { text: u.text })));
    this.set("gaps", (doc?.verdict?.gaps ?? []).map((g) => feature("Point", g.place)));
    this.set("findings", (doc?.verdict?.violations ?? []).map((v) => feature("Point", v.place)));
    this.set("track", (doc?.tracks ?? []).map((track, n) => feature("LineString", track.line, { color: doc.tracks.length > 1 ? SORTIES[(doc.colors?.[n] ?? n) % SORTIES.length] : COLORS.track })));
    this.route(doc?.sorties ?? [], [], doc?.colors);
    for (const name of ["waypoints", "footprints", "missing"]) this.set(name, []);
    this.set("vehicles", []);
    this.tracks.clear();
  }

  route(lines, badLegs, colors = []) {
    this.set("route", lines.map((line, n) => feature("LineString", line, { color: SORTIES[(colors[n] ?? n) % SORTIES.length] })));
    this.set("bad", badLegs.map((leg) => feature("LineString", leg)));
  }

  // What an earlier flight left does not belong to the one that begins.
  forgetFlight() {
    for (const name of ["gaps", "findings", "track"]) this.set(name, []);
    this.tracks.clear();
  }

  // Photos that were taken: where from, what they show, what they miss.
  photos(found) {
    const of = (...kinds) => (found?.gapShapes ?? []).filter((gap) => kinds.includes(gap.geometry.type));
    this.set("photos", (found?.photos ?? []).map((photo) => feature("Point", photo.place, { size: 3.5, name: photo.name, color: photo.why ? COLORS.bad : COLORS.rally })));
    this.set("footprints", found?.footprints ?? []);
    this.set("missing", of("Polygon", "MultiPolygon"));
    this.set("bad", of("LineString"));
  }

  waypoints(points, chosen) { this.set("waypoints", points.map((p, n) => feature("Point", [p[0], p[1]], { number: n, chosen: n === chosen }))); }

  contours(lines) { this.set("contours", lines.map((l) => feature("LineString", l.line, { major: l.major, height: l.height }))); }

  // Samples of a flight are only ever appended; a line of several thousand points is thinned for drawing.
  live(run, from, samples, color) {
    let track = this.tracks.get(run);
    if (!track || from === 0) { track = { points: [], color }; this.tracks.set(run, track); }
    track.points.length = Math.min(track.points.length, from);
    for (const s of samples) track.points.push(s);
    if (this.drawing) return;
    this.drawing = requestAnimationFrame(() => {
      this.drawing = 0;
      const lines = [], vehicles = [];
      for (const [name, { points, color: own }] of this.tracks) {
        const every = Math.max(1, Math.ceil(points.length / 4000));
        const line = points.filter((_, n) => n % every === 0 || n === points.length - 1).map((p) => [p[0], p[1]]);
        if (line.length > 1) lines.push(feature("LineString", line, { color: own }));
        vehicles.push(feature("Point", points.at(-1).slice(0, 2), { color: own, name, yaw: points.at(-1)[4] ?? 0 }));
      }
      this.set("track", lines);
      this.set("vehicles", vehicles);
    });
  }
}

// Signs of the map, drawn here: the page has no fonts for maps.
function sign(color, letter) {
  const [pen, size] = paper();
  pen.lineWidth = 5;
  disc(pen, size / 2, size / 2 - 4, "#fff", color);
  Object.assign(pen, { fillStyle: color, font: `bold ${size / 2}px sans-serif`, textAlign: "center", textBaseline: "middle" });
  pen.fillText(letter, size / 2, size / 2 + 1);
  return pen.getImageData(0, 0, size, size);
}
function arrow(color) {
  const [pen, size] = paper(), at = (x, y) => [size * x, size * y];
  pen.lineWidth = 4;
  pen.lineJoin = "round";
  pen.beginPath();
  [[0.5, 0.06], [0.86, 0.9], [0.5, 0.7], [0.14, 0.9]].forEach((point, n) => (n ? pen.lineTo(...at(...point)) : pen.moveTo(...at(...point))));
  pen.closePath();
  Object.assign(pen, { fillStyle: color, strokeStyle: "#fff" });
  pen.fill(); pen.stroke();
  return pen.getImageData(0, 0, size, size);
}
function paper() {
  const canvas = Object.assign(document.createElement("canvas"), { width: 48, height: 48 });
  return [canvas.getContext("2d"), 48];
}
function disc(pen, middle, radius, fill, stroke) {
  pen.beginPath();
  pen.arc(middle, middle, radius, 0, 2 * Math.PI);
  Object.assign(pen, { fillStyle: fill, strokeStyle: stroke });
  pen.fill(); pen.stroke();
}

// Rings of several polygons come in one list: an outline is followed by its holes. MapLibre wants each outline with its own.
function evenOdd(shape) {
  const rings = shape.geometry.coordinates, found = [];
  for (const ring of rings) {
    const owner = found.find((other) => inside(ring[0], other[0]));
    if (owner) owner.push(ring); else found.push([ring]);
  }
  return found.map((each) => polygon(each, {}));
}

export function inside(point, ring) {
  let is = false;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const [xi, yi] = ring[i], [xj, yj] = ring[j];
    if ((yi > point[1]) !== (yj > point[1]) && point[0] < ((xj - xi) * (point[1] - yi)) / (yj - yi) + xi) is = !is;
  }
  return is;
}
