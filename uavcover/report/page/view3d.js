// The 3D view: squares of ground drawn from the farthest to the nearest, in parallel projection; no graphics card needed.
// A piece of a route is drawn right after the square it is above: all that could hide it is nearer, and drawn later.
(function () {
  const canvas = document.getElementById("view3d"), pen = canvas.getContext("2d");
  const { columns, rows, up } = data.surface, [west, south, east, north] = data.bounds;
  const width = east - west, depth = north - south;
  const known = up.filter((height) => height !== null);
  const routes = [data.plan, ...data.tracks.map((track) => track.points)];
  const stepE = width / (columns - 1), stepN = depth / (rows - 1);
  const view = { turn: -0.45, tilt: 0.62, zoom: 1 };
  let colors = null, picked = null, waiting = false;

  const lines = [];
  const addLine = (points, looks, flown = false) => {
    for (let i = 1; i < points.length; i++) {
      const [e0, n0, u0] = points[i - 1], [e1, n1, u1] = points[i];
      const pieces = Math.max(1, Math.ceil(Math.max(Math.abs(e1 - e0) / stepE, Math.abs(n1 - n0) / stepN)));
      for (let k = 0; k < pieces; k++) {
        const a = k / pieces, b = (k + 1) / pieces, m = (a + b) / 2;
        const column = Math.min(columns - 2, Math.max(0, Math.floor((e0 + m * (e1 - e0) - west) / stepE)));
        const row = Math.min(rows - 2, Math.max(0, Math.floor((north - (n0 + m * (n1 - n0))) / stepN)));
        lines.push({ cell: row * (columns - 1) + column, looks, flown,
          from: [e0 + a * (e1 - e0), n0 + a * (n1 - n0), u0 + a * (u1 - u0)],
          to: [e0 + b * (e1 - e0), n0 + b * (n1 - n0), u0 + b * (u1 - u0)] });
      }
    }
  };
  for (const obstacle of data.obstacles) for (const ring of obstacle.rings) {
    const roof = ring.map(([e, n]) => [e, n, obstacle.top]);
    addLine(roof, [["#5b3f8c", 2]]);
    ring.forEach((foot, i) => { if (foot[2] !== null) addLine([foot, roof[i]], [["#5b3f8c", 1.2]]); });
  }
  for (const zone of data.noFly) for (const line of zone.lines) addLine(line, [["#e0245e", 1.4]]);
  // As on the map: planned is broad, flown is thin and over it.
  for (const part of data.sorties.length ? data.sorties : [{ points: data.plan }]) {
    addLine(part.points, [[part.style ? report.trackLook(part).color : "#22304f", 7.2], [report.plannedColor, 5]]);
  }
  for (const track of data.tracks) addLine(track.points, [[report.trackLook(track).color, 2]], true);
  const above = new Map();
  for (const line of lines) above.has(line.cell) ? above.get(line.cell).push(line) : above.set(line.cell, [line]);

  const picture = (source) => new Promise((done) => { const image = new Image(); image.onload = () => done(image); image.src = source; });
  // The colour of every square: relief with the map's layer over it, shrunk to one pixel a square.
  const paint = async (layer) => {
    picked = layer;
    const flat = document.createElement("canvas");
    flat.width = columns - 1; flat.height = rows - 1;
    const brush = flat.getContext("2d", { willReadFrequently: true });
    brush.drawImage(await picture(data.relief), 0, 0, flat.width, flat.height);
    if (data.background) brush.drawImage(await picture(data.background), 0, 0, flat.width, flat.height);
    if (layer) {
      const [w, s, e, n] = data.cellBounds, x = flat.width / width, y = flat.height / depth;
      const cells = await picture(layer.image);
      brush.drawImage(cells, (w - west) * x, (north - n) * y, (e - w) * x, (n - s) * y);
    }
    if (picked !== layer) return;
    const pixels = brush.getImageData(0, 0, flat.width, flat.height).data;
    colors = Array.from({ length: flat.width * flat.height }, (_, i) => `rgb(${pixels[4 * i]},${pixels[4 * i + 1]},${pixels[4 * i + 2]})`);
    redraw();
  };

  const draw = () => {
    waiting = false;
    const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
    canvas.width = Math.round(box.width * ratio); canvas.height = Math.round(box.height * ratio);
    if (!colors || !known.length) return;
    const sin = Math.sin(view.turn), cos = Math.cos(view.turn), flatness = Math.sin(view.tilt), upness = Math.cos(view.tilt);
    const middleE = (west + east) / 2, middleN = (south + north) / 2;
    const flat = (e, n, u) => {
      const right = (e - middleE) * cos + (n - middleN) * sin, away = -(e - middleE) * sin + (n - middleN) * cos;
      return [right, -(away * flatness + u * upness)];
    };
    // As large as fits, with routes and ground in the middle.
    const places = up.map((height, i) => height === null ? null : [west + (i % columns) * stepE, north - Math.floor(i / columns) * stepN, height]);
    let [left, right, top, bottom] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const place of [...places, ...routes.flat()]) {
      if (!place) continue;
      const [x, y] = flat(...place);
      left = Math.min(left, x); right = Math.max(right, x); top = Math.min(top, y); bottom = Math.max(bottom, y);
    }
    const scale = 0.94 * view.zoom * Math.min(canvas.width / (right - left), canvas.height / (bottom - top));
    const x0 = canvas.width / 2 - scale * (left + right) / 2, y0 = canvas.height / 2 - scale * (top + bottom) / 2;
    const project = (e, n, u) => { const [x, y] = flat(e, n, u); return [x0 + x * scale, y0 + y * scale]; };
    const nodes = places.map((place) => place && project(...place));
    // Away is north for cos > 0 and west for sin > 0: start at the far side.
    const rowOrder = Array.from({ length: rows - 1 }, (_, i) => cos > 0 ? i : rows - 2 - i);
    const columnOrder = Array.from({ length: columns - 1 }, (_, i) => sin > 0 ? i : columns - 2 - i);
    pen.lineJoin = "round";
    const stroke = (line) => {
      pen.beginPath();
      pen.moveTo(...project(...line.from));
      pen.lineTo(...project(...line.to));
      pen.lineCap = line.flown ? "round" : "butt";
      for (const [color, weight] of line.looks) {
        pen.strokeStyle = color;
        pen.lineWidth = weight * ratio;
        pen.stroke();
      }
    };
    // What was flown waits for the next row, so that the planned line beside it does not cover it.
    let flown = [];
    for (const row of rowOrder) {
      const earlier = flown;
      flown = [];
      for (const column of columnOrder) {
        const i = row * columns + column, square = [nodes[i], nodes[i + 1], nodes[i + 1 + columns], nodes[i + columns]];
        const cell = row * (columns - 1) + column;
        if (square.every((node) => node)) {
          pen.beginPath();
          square.forEach(([x, y], k) => k ? pen.lineTo(x, y) : pen.moveTo(x, y));
          pen.closePath();
          pen.fillStyle = pen.strokeStyle = colors[cell];
          pen.lineWidth = 0.8;
          pen.fill();
          pen.stroke();  // closes the hairlines between squares
        }
        for (const line of above.get(cell) || []) line.flown ? flown.push(line) : stroke(line);
      }
      earlier.forEach(stroke);
    }
    flown.forEach(stroke);
    if (data.home) {
      const [x, y] = project(...data.home);
      pen.beginPath(); pen.arc(x, y, 5 * ratio, 0, 7); pen.fillStyle = "#d6248f"; pen.fill();
      pen.strokeStyle = "#fff"; pen.lineWidth = 1.5 * ratio; pen.stroke();
    }
    // North, at the upper left.
    const size = 20 * ratio, nx = 34 * ratio, ny = 38 * ratio;
    pen.strokeStyle = pen.fillStyle = getComputedStyle(canvas).color;
    pen.lineWidth = 1.5 * ratio;
    pen.beginPath(); pen.moveTo(nx, ny); pen.lineTo(nx + sin * size, ny - cos * flatness * size); pen.stroke();
    pen.font = `${12 * ratio}px sans-serif`; pen.textAlign = "center"; pen.textBaseline = "middle";
    pen.fillText("N", nx + sin * size * 1.5, ny - cos * flatness * size * 1.5);
  };
  const redraw = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };

  let grip = null;
  canvas.addEventListener("pointerdown", (event) => { grip = event; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointerup", () => { grip = null; });
  canvas.addEventListener("pointercancel", () => { grip = null; });
  canvas.addEventListener("pointermove", (event) => {
    if (!grip) return;
    view.turn += (event.clientX - grip.clientX) * 0.008;
    view.tilt = Math.min(1.55, Math.max(0.12, view.tilt + (event.clientY - grip.clientY) * 0.006));
    grip = event;
    redraw();
  });
  const zoomBy = (factor) => { view.zoom = Math.min(12, Math.max(0.5, view.zoom * factor)); redraw(); };
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoomBy(Math.exp(-event.deltaY * 0.0015)); }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.06], ArrowDown: [0, -0.06] }[event.key];
    if (event.key === "+" || event.key === "-") zoomBy(event.key === "+" ? 1.15 : 1 / 1.15);
    else if (turns) { view.turn += turns[0]; view.tilt = Math.min(1.55, Math.max(0.12, view.tilt + turns[1])); redraw(); } else return;
    event.preventDefault();
  });
  new ResizeObserver(redraw).observe(canvas);
  window.addEventListener("beforeprint", draw);
  report.onLayer.push(paint);
  report.start();
})();
