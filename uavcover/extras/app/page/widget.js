// The cell of a notebook: the map of the page, without a server. widget.py replaces the addresses of modules.
import { CoverageMap } from "/page/map.js";

export function render({ model, el }) {
  const box = document.createElement("div"), caption = document.createElement("div");
  Object.assign(box.style, { height: model.get("height"), position: "relative" });
  el.append(box, caption);
  const map = new CoverageMap(box);
  const draw = () => {
    const doc = model.get("document"), layer = doc.layers?.[0];
    map.scene(doc);
    map.contours(doc.contours ?? []);
    map.cells(layer?.image ?? "", doc.corners);
    map.fit(doc.bounds);
    caption.replaceChildren(doc.caption ?? "", ...(layer?.legend ?? []).map(({ color, label }) => {
      const entry = document.createElement("span"), swatch = document.createElement("i");
      Object.assign(swatch.style, { display: "inline-block", width: "0.9em", height: "0.9em", margin: "0 0.4em 0 1em", background: color });
      entry.append(swatch, label);
      return entry;
    }));
  };
  map.ready.then(() => { draw(); model.on("change:document", draw); el.dataset.ready = "yes"; });
  el.coverageMap = map; // for tests and for the curious
  return () => map.map.remove();
}
