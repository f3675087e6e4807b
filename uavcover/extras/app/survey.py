"""The form of the page: converts drawings and entries to a scenario, with the functions of ``uavcover new``."""

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
import shapely

from uavcover.errors import InputError, UavcoverError
from uavcover.extras.app.workspace import Workspace, free_name
from uavcover.model.area import Ring
from uavcover.new.catalog import CAMERAS, VEHICLES
from uavcover.new.command import new_scenarios, print_design, print_estimate
from uavcover.new.elevation_questions import NewRequest
from uavcover.run.user import Unattended
from uavcover.scenario.areas.area_file import AreaQuery, read_area

_TEXTS = (
    "camera", "gsd", "overlap", "battery", "vehicle", "home", "max_height", "speed", "margin", "mount", "vertical_datum",
    "autopilot", "max_alt", "pattern", "at", "fill_lakes", "water_height",
)  # fmt: skip
_HEIGHTS = ("floor_agl_m", "floor_amsl_m", "ceiling_agl_m", "ceiling_amsl_m")
_OPTION = re.compile(r"--([a-z][a-z-]*)|\b(fence|rally|home|max_alt|max_height)(?:_[a-z_]+|\.\d+)*: ")
_STEM = re.compile(r"[A-Za-z0-9][A-Za-z0-9._ -]{0,60}")


class Messages(Unattended):
    """A user that collects the messages for the page.

    Attributes:
        lines: messages and warnings in their order.
    """

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[dict[str, str]] = []

    def say(self, line: str = "") -> None:
        """Keep a message."""
        if line:
            self.lines.append({"say": line})

    def warn(self, line: str) -> None:
        """Keep a warning."""
        self.lines.append({"warn": line})


def choices() -> dict[str, Any]:
    """Cameras and vehicles by name."""
    return {
        "cameras": [{"name": one.name, "title": one.title} for one in CAMERAS.by_name().values()],
        "vehicles": [{"name": one.name, "title": one.title} for one in VEHICLES.by_name().values()],
    }


def area_document(workspace: Workspace, name: str) -> dict[str, Any]:
    """The polygons of an area file, as GeoJSON geometry. Raises InputError: it cannot be read."""
    found = read_area(AreaQuery(source=str(workspace.path(name)), make_valid=True))
    polygons = [[list(map(list, ring)) for ring in rings] for rings in found.parts]
    return {
        "name": found.name,
        "notes": list(found.notes),
        "geometry": {"type": "MultiPolygon", "coordinates": polygons},
    }


def designed(workspace: Workspace, form: dict[str, Any]) -> dict[str, Any]:
    """Height band, distances, photos, minutes and batteries of a form; or the error, with its field."""
    user = Messages()
    try:
        with _drawn(workspace, form) as request:
            scenarios = new_scenarios(request, user, folder=workspace.root)
            figures = print_design(scenarios[0], Messages())
            site = scenarios[0].site
            outside = site.area.difference(site.fence).area / site.area.area
            if outside > 1e-3:
                user.warn(f"{100.0 * outside:.1f} % of the area with its margin lies outside the fence")
            flights = [print_estimate(scenario, Messages()) for scenario in scenarios]
    except UavcoverError as error:
        return {"error": str(error), "field": field_of(str(error)), "messages": user.lines}
    home = scenarios[0].site.scenario.home
    position = None if home is None or home.lat_deg is None or home.lon_deg is None else [home.lon_deg, home.lat_deg]
    return {"figures": figures, "flights": flights, "messages": user.lines, "home": position}


def written(workspace: Workspace, form: dict[str, Any]) -> dict[str, Any]:
    """Write the scenario of a form with the files that it names; nothing that is there is replaced.

    Raises:
        UavcoverError: as ``uavcover new``.
    """
    stem = str(form.get("name") or "survey").strip()
    if _STEM.fullmatch(stem) is None:
        raise InputError("name: use at most 60 letters, digits, spaces, dots and dashes")
    user = Messages()
    with _drawn(workspace, form, stem=stem) as request:
        scenarios = new_scenarios(request, user, folder=workspace.root)
    names = []
    for scenario in scenarios:
        path = free_name(workspace.root, f"{stem}-{scenario.view.name}" if scenario.view.name else stem, ".toml")
        path.write_text(scenario.text, encoding="utf-8")
        names.append(workspace.name(path))
    return {"scenarios": names, "messages": user.lines}


def field_of(message: str) -> str:
    """The field of the form that an error is about; empty where it names none."""
    found = _OPTION.search(message)
    return "" if found is None else (found[1] or found[2]).replace("-", "_")


@contextmanager
def _drawn(workspace: Workspace, form: dict[str, Any], *, stem: str | None = None) -> Iterator[NewRequest]:
    """The request of a form. What was drawn is in files: of the user where ``stem`` names them, else for this moment."""
    temporary: list[Path] = []

    def file_of(kind: str, features: list[dict[str, Any]]) -> str:
        folder = workspace.root
        path = free_name(folder, f".{kind}-draft" if stem is None else f"{stem}-{kind}", ".geojson")
        path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
        if stem is None:
            temporary.append(path)
        else:
            kept.append(path)
        return str(path)

    kept: list[Path] = []
    try:
        area = form.get("area")
        if isinstance(area, str) and area:
            source = str(workspace.path(area))
        else:
            source = file_of(
                "area", [{"type": "Feature", "properties": {"name": stem or ""}, "geometry": polygons_of(area, "area")}]
            )
        zones = form.get("zones") or []
        no_fly = [str(workspace.path(name)) for name in _names(form.get("no_fly"))]
        if zones:
            no_fly.append(file_of("zones", [_zone(zone, number) for number, zone in enumerate(zones, start=1)]))
        texts = {name: str(form[name]).strip() for name in _TEXTS if str(form.get(name) or "").strip()}
        dem, dsm = (tuple(str(workspace.path(name)) for name in _names(form.get(key))) for key in ("dem", "dsm"))
        query = AreaQuery(source=source, make_valid=isinstance(area, str))
        yield NewRequest(
            area=query, dem=dem, dsm=dsm, no_fly=tuple(no_fly), trust_dem=bool(form.get("trust_dem")),
            fence=_fence(form.get("fence")), rally=_rally(form.get("rally")), **texts,
        )  # fmt: skip
        kept.clear()
    finally:
        for path in (*temporary, *kept):
            path.unlink(missing_ok=True)


def polygons_of(geometry: object, what: str) -> dict[str, Any]:
    """A GeoJSON polygon or multipolygon of the page, checked. Raises InputError: it is none, or crosses itself."""
    try:
        shape = shapely.geometry.shape(cast("dict[str, Any]", geometry))
    except Exception as error:
        raise InputError(f"{what}: draw it, or load a file") from error
    if shape.geom_type not in ("Polygon", "MultiPolygon") or shape.is_empty:
        raise InputError(f"{what}: this is not a polygon; draw it, or load a file")
    if (
        not np.isfinite(shapely.get_coordinates(shape)).all()
        or np.abs(shapely.get_coordinates(shape)[:, 1]).max() > 90.0
    ):
        raise InputError(f"{what}: some corners are not pairs of longitude and latitude")
    if not shape.is_valid:
        raise InputError(f"{what}: the outline crosses itself; move a corner")
    return dict(shapely.geometry.mapping(shape))


def _fence(geometry: object) -> Ring | None:
    if geometry is None:
        return None
    shape = shapely.geometry.shape(polygons_of(geometry, "fence"))
    if not isinstance(shape, shapely.Polygon) or shape.interiors:
        raise InputError("fence: the fence must be one outline without holes; draw no-fly zones inside it")
    return tuple((float(lon), float(lat)) for lon, lat in shapely.get_coordinates(shape)[:-1])


def _rally(given: object) -> Ring | None:
    if not given:
        return None
    try:
        positions = np.array(given, dtype=float).reshape(-1, 2)
    except (TypeError, ValueError):
        positions = np.array([[np.nan, np.nan]])
    if not np.isfinite(positions).all() or (np.abs(positions) > (180.0, 90.0)).any():
        raise InputError("rally: specify each rally point as [longitude, latitude] in degrees")
    return tuple((float(lon), float(lat)) for lon, lat in positions)


def _zone(zone: object, number: int) -> dict[str, Any]:
    if not isinstance(zone, dict):
        raise InputError(f"zone {number}: this is not a valid zone; draw it again")
    name = str(zone.get("name") or f"zone {number}")
    heights = {}
    for key in _HEIGHTS:
        if zone.get(key) not in (None, ""):
            try:
                heights[key] = float(zone[key])
            except (TypeError, ValueError):
                raise InputError(f"{name}: {key}: {zone[key]!r} is not a number of metres") from None
    return {
        "type": "Feature",
        "properties": {"name": name, **heights},
        "geometry": polygons_of(zone.get("geometry"), name),
    }


def _names(given: object) -> Sequence[str]:
    return [str(each) for each in given if str(each)] if isinstance(given, list) else [str(given)] if given else []
