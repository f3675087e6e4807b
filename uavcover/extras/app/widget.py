"""The map in a notebook: ``%load_ext uavcover.extras.app.widget``; then a plan, a track and a verdict show it.

The widget has the page's own map module and the vendored libraries in one module of text, so it needs no server and no
other host. It has no relief, which is made of tiles; contour lines show the ground.
"""

import base64
import gzip
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from uavcover.errors import InputError
from uavcover.extras.app.scene import Scene, Scenes, observed_image, scene_document, verdict_document
from uavcover.extras.app.tiles import contours
from uavcover.model.route import Plan
from uavcover.model.track import Track
from uavcover.report.map_data import OBSERVED_RGB, UNOBSERVED_RGB
from uavcover.verification.verify import Verdict

_HERE = Path(__file__).parent
_MODULES = (
    "/page/strings.js", "/page/dom.js", "/vendor/maplibre-gl/maplibre-gl.mjs", "/vendor/maplibre-gl/maplibre-gl-worker.mjs",
    "/vendor/terra-draw/terra-draw.module.js", "/vendor/terra-draw/terra-draw-maplibre-gl-adapter.module.js",
    "/page/map.js", "/page/widget.js",
)  # fmt: skip
"""Each after those that it imports."""
_NAMES = {"/vendor/terra-draw/terra-draw.module.js": "terra-draw"}
_LOADER = """
const bytes = Uint8Array.from(atob("%s"), (letter) => letter.charCodeAt(0)), urls = {};
const files = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
for (const [name, text] of files) {
  const code = Object.entries(urls).reduce((whole, [known, url]) => whole.replaceAll(`"${known}"`, `"${url}"`), text);
  urls[name] = URL.createObjectURL(new Blob([code], { type: "text/javascript" }));
}
const { render } = await import(urls["/page/widget.js"]);
export default { render };
"""
_MOST_POINTS = 4000


@cache
def module_text() -> str:
    """The widget's module; it imports nothing."""
    packed = gzip.compress(json.dumps(packed_files()).encode(), mtime=0)
    return _LOADER % base64.b64encode(packed).decode()


def packed_files() -> list[tuple[str, str]]:
    """The modules that it is made of: the name by which others import each, and its text."""
    return [(_NAMES.get(name, name), (_HERE / name[1:]).read_text(encoding="utf-8")) for name in _MODULES]


def show(shown: Plan | Track | Verdict | str | Path, *, height: str = "480px") -> Any:
    """The map of a plan that was written, a track, a verdict, or a scenario file or run folder.

    Raises:
        InputError: anywidget is not installed, or there is no folder of the plan.
    """
    try:
        return _widget_class()(document=document_of(shown), height=height)
    except ModuleNotFoundError as error:
        raise InputError(f"show: {error.name} is required; install it with: pip install 'uavcover[jupyter]'") from error


def document_of(shown: Plan | Track | Verdict | str | Path) -> dict[str, Any]:
    """Everything that the map draws."""
    if isinstance(shown, Track):
        return _of_track(shown)
    if isinstance(shown, Verdict):
        return _of_verdict(shown)
    path = shown.folder if isinstance(shown, Plan) else str(shown)
    if not path or not Path(path).exists():
        raise InputError(f"{shown!r} was not saved to a run folder; save it with: uavcover.plan(site, out=RUN)")
    scene = Scenes().of(Path(path))
    return scene_document(scene) | {"contours": contours(scene), "caption": repr(shown) if path != shown else path}


def _of_verdict(verdict: Verdict) -> dict[str, Any]:
    scene = Scene(verdict.coverage.site, Path(), _coverage=verdict.coverage)
    colors = ((OBSERVED_RGB, "observed"), (UNOBSERVED_RGB, "not observed"))
    legend = [{"color": f"rgb{color}", "label": label} for color, label in colors]
    layer = {"image": observed_image(verdict.coverage, verdict.flown.observed), "legend": legend}
    return scene_document(scene) | {
        "verdict": verdict_document(scene, verdict), "layers": [layer], "corners": scene.corners(),
        "contours": contours(scene), "caption": repr(verdict)[1:-1],
    }  # fmt: skip


def _of_track(track: Track) -> dict[str, Any]:
    lon_lat = track.geodetic[:: max(1, -(-len(track) // _MOST_POINTS)), 1::-1]
    return {
        **{key: [] for key in ("drawn", "area", "fence", "zones", "obstacles")},
        "tracks": [{"line": lon_lat.tolist()}], "caption": repr(track)[1:-1],
        "bounds": [*lon_lat.min(axis=0).tolist(), *lon_lat.max(axis=0).tolist()],
    }  # fmt: skip


@cache
def _widget_class() -> Any:
    import anywidget
    import traitlets

    style = (_HERE / "vendor" / "maplibre-gl" / "maplibre-gl.css").read_text(encoding="utf-8")
    traits = {
        "document": traitlets.Dict().tag(sync=True), "height": traitlets.Unicode("480px").tag(sync=True),
        "_esm": module_text(), "_css": style,
    }  # fmt: skip
    return type("MapWidget", (anywidget.AnyWidget,), traits)


def load_ipython_extension(ipython: Any) -> None:
    """``%load_ext``: plans, tracks and verdicts show the map; where it cannot be made, their picture as before."""

    def bundle(shown: Any, include: object = None, exclude: object = None) -> Mapping[str, Any] | None:
        del include, exclude
        try:
            found: Mapping[str, Any] = show(shown)._repr_mimebundle_()[0]
        except InputError:
            return None
        return found

    for each in (Plan, Track, Verdict):
        ipython.display_formatter.mimebundle_formatter.for_type(each, bundle)
