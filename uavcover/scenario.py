"""Scenario files: TOML to :class:`~uavcover.model.scenario.Scenario` and back. The only module that knows pydantic."""

import dataclasses
import difflib
import json
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, get_args, get_type_hints

import shapely
from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from uavcover.errors import ScenarioError
from uavcover.model.area import Area, Ring
from uavcover.model.scenario import RasterTerrain, Scenario

_BUNDLED = "bundled:"
_ADAPTER = TypeAdapter(Scenario)


def bundled_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that come with the package."""
    folder = resources.files("uavcover") / "scenarios"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Read a scenario: a TOML file, or the name of a bundled one.

    What comes back stands alone: a GeoJSON area is read in, and the terrain file's path is absolute.

    Raises:
        ScenarioError: one line with the path of every key that is wrong.
    """
    path = Path(name_or_path)
    bundled = bundled_scenarios()
    if str(name_or_path) in bundled and not path.exists():
        path = Path(str(resources.files("uavcover") / "scenarios" / f"{name_or_path}.toml"))
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(
            f"{name_or_path}: neither a readable scenario file ({error.__class__.__name__}) nor a bundled scenario "
            f"({', '.join(bundled)})"
        ) from error
    return parse_scenario(text, source=str(name_or_path), folder=path.resolve().parent)


def parse_scenario(text: str, *, source: str, folder: Path) -> Scenario:
    """A scenario from TOML text.

    Args:
        text: the TOML.
        source: names the text in errors.
        folder: where relative paths in it start from.

    Raises:
        ScenarioError: one line with the path of every key that is wrong.
    """
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{source}: not valid TOML: {error}") from error
    try:
        scenario = _ADAPTER.validate_python(raw)
    except ValidationError as error:
        mistakes = "; ".join(_mistake(details) for details in error.errors(include_url=False))
        raise ScenarioError(f"{source}: {mistakes}") from error
    scenario = dataclasses.replace(
        scenario, area=_inline_geojson(scenario.area, source, folder), terrain=_absolute_file(scenario.terrain, folder)
    )
    _check_rings(scenario.area, source)
    return scenario


def dump_scenario(scenario: Scenario) -> str:
    """TOML of a scenario with every default written out; reading it gives the same scenario."""
    lines: list[str] = []
    _dump_table(dataclasses.asdict(scenario), (), lines)
    return "\n".join(lines).strip() + "\n"


def terrain_path(terrain: RasterTerrain) -> Path:
    """The elevation file of a loaded scenario."""
    if terrain.file.startswith(_BUNDLED):
        return Path(str(resources.files("uavcover") / "data" / terrain.file.removeprefix(_BUNDLED)))
    return Path(terrain.file)


def _mistake(details: ErrorDetails) -> str:
    # A tagged union puts its tag into the path; the user never wrote it.
    keys = [str(part) for part in details["loc"]]
    path = ".".join(key for key in keys if key not in _UNION_CLASS_NAMES)
    if details["type"] in {"extra_forbidden", "unexpected_keyword_argument"}:
        known = sorted(_known_keys())
        close = difflib.get_close_matches(keys[-1], known, n=1)
        return f"{path}: unknown key" + (f" (did you mean {close[0]}?)" if close else "")
    message = details["msg"].removeprefix("Value error, ")
    if details["type"] in {"missing", "missing_argument"}:
        message = "is missing"
    if details["type"] == "value_error" and ": " in message and path:
        # Rules start with the key they speak of, seen from their own section.
        return f"{path}.{message}"
    return f"{path}: {message}" if path else message


def _classes(root: type) -> set[type]:
    found = {root}
    for hint in get_type_hints(root).values():
        for part in (hint, *get_args(hint)):
            if dataclasses.is_dataclass(part) and isinstance(part, type):
                found |= _classes(part)
    return found


_UNION_CLASS_NAMES = {cls.__name__ for cls in _classes(Scenario)}


def _known_keys() -> set[str]:
    return {field.name for cls in _classes(Scenario) for field in dataclasses.fields(cls)}


def _inline_geojson(area: Area, source: str, folder: Path) -> Area:
    if area.geojson is None:
        return area
    path = folder / area.geojson
    where = f"{source}: area.geojson"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError(f"{where}: {path} cannot be read as GeoJSON ({error})") from error
    polygons = list(_polygons(document))
    if len(polygons) != 1:
        raise ScenarioError(f"{where}: {path} has {len(polygons)} polygons; exactly one is needed")
    try:
        rings = tuple(tuple((float(p[0]), float(p[1])) for p in ring) for ring in polygons[0])
        return dataclasses.replace(area, geojson=None, polygon_lon_lat_deg=rings[0], holes_lon_lat_deg=rings[1:])
    except (TypeError, ValueError, IndexError, KeyError) as error:
        raise ScenarioError(f"{where}: {path}: not a GeoJSON polygon ({error})") from error


def _polygons(document: Any) -> list[Any]:
    if not isinstance(document, dict):
        return []
    kind = document.get("type")
    if kind == "FeatureCollection":
        return [polygon for feature in document.get("features") or [] for polygon in _polygons(feature)]
    if kind == "Feature":
        return _polygons(document.get("geometry"))
    if kind == "MultiPolygon":
        return list(document.get("coordinates") or [])
    return [document.get("coordinates")] if kind == "Polygon" else []


def _absolute_file(terrain: Any, folder: Path) -> Any:
    if not isinstance(terrain, RasterTerrain) or terrain.file.startswith(_BUNDLED):
        return terrain
    return dataclasses.replace(terrain, file=str((folder / terrain.file).resolve()))


def _check_rings(area: Area, source: str) -> None:
    geographic = area.polygon_lon_lat_deg is not None
    key = "polygon_lon_lat_deg" if geographic else "polygon_east_north_m"
    holes_key = "holes_lon_lat_deg" if geographic else "holes_east_north_m"
    outer = _valid_ring(area.polygon_lon_lat_deg or area.polygon_east_north_m or (), f"{source}: area.{key}")
    polygon = outer
    for number, ring in enumerate(area.holes_lon_lat_deg or area.holes_east_north_m):
        where = f"{source}: area.{holes_key}.{number}"
        hole = _valid_ring(ring, where)
        if not outer.covers(hole):
            raise ScenarioError(f"{where}: the hole reaches outside the polygon")
        polygon = polygon.difference(hole)
    if polygon.is_empty or not polygon.area > 0.0:
        raise ScenarioError(f"{source}: area.{key}: nothing is left of the area inside its holes")


def _valid_ring(ring: Ring, where: str) -> Any:
    if len({*ring}) < 3:
        raise ScenarioError(f"{where}: a ring needs at least 3 different corners, this one has {len({*ring})}")
    polygon = shapely.Polygon(ring)
    if not polygon.is_valid:
        raise ScenarioError(f"{where}: {shapely.is_valid_reason(polygon)}; a ring must not cross or touch itself")
    return polygon


def _dump_table(table: dict[str, Any], path: tuple[str, ...], lines: list[str]) -> None:
    if path:
        lines.append(f"\n[{'.'.join(path)}]")
    lines.extend(
        f"{key} = {_toml(value)}" for key, value in table.items() if value is not None and not isinstance(value, dict)
    )
    for key, value in table.items():
        if isinstance(value, dict):
            _dump_table(value, (*path, key), lines)


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return "[" + ", ".join(_toml(item) for item in value) + "]"
