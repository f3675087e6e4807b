// The charts are drawn already; moving over the heights of the flights shows the sample, on the map too.
(function () {
  const nearest = (times, time) => {
    let low = 0, high = times.length - 1;
    while (low < high) { const middle = (low + high) >> 1; times[middle] < time ? (low = middle + 1) : (high = middle); }
    return low > 0 && time - times[low - 1] < times[low] - time ? low - 1 : low;
  };
  // The same chart is drawn for screens and for phones; the style sheet shows one of the two.
  for (const chart of document.querySelectorAll('[data-chart="height"]')) {
    const cursor = chart.querySelector(".cursor"), words = chart.closest("figure").querySelector("output");
    const [x0, x1, left, right, top, bottom] = ["x0", "x1", "left", "right", "top", "bottom"].map((name) => Number(chart.dataset[name]));
    chart.addEventListener("pointermove", (event) => {
      const box = chart.getBoundingClientRect(), x = (event.clientX - box.left) * chart.viewBox.baseVal.width / box.width;
      const share = Math.min(1, Math.max(0, (x - left) / (right - left))), time = 60 * (x0 + share * (x1 - x0));
      // One flight begins when the one before has ended.
      const track = data.tracks.find(({ times }) => time <= times[times.length - 1]) || data.tracks[data.tracks.length - 1];
      const index = nearest(track.times, time), height = track.heights[index];
      cursor.setAttribute("d", `M${left + share * (right - left)} ${top}V${bottom}`);
      words.textContent = `${data.tracks.length > 1 ? `${track.name}, ` : ""}${(track.times[index] / 60).toFixed(2)} min: ${height === null ? "?" : height.toFixed(1)} m above ground`;
      report.showPlace(track.points[index]);
    });
    chart.addEventListener("pointerleave", () => { cursor.setAttribute("d", ""); words.textContent = ""; report.showPlace(null); });
  }
})();
