"""Scenario files: TOML to :class:`~uavcover.model.scenario.Scenario` and back. The only module that imports pydantic."""

import dataclasses
import difflib
import json
import logging
import math
import tomllib
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, get_args, get_type_hints

import tomli_w
from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from mission_io.errors import MissionIoError
from uavcover.errors import InputError, ScenarioError
from uavcover.model.area import Area, RasterTerrain, Terrain
from uavcover.model.limits import NoFly, Obstacles
from uavcover.model.scenario import Scenario
from uavcover.model.sensor import Sensor
from uavcover.plugins import load, registered
from uavcover.scenario.airspace.zone_file import read_zones
from uavcover.scenario.areas.area_file import SUFFIXES as AREA_SUFFIXES
from uavcover.scenario.obstacles import read_obstacles
from uavcover.scenario.ring_checks import (
    LAUNCH_POINTS,
    bounds_deg,
    fence_mistakes,
    no_fly_mistakes,
    outline_mistakes,
    prism_mistakes,
    with_fleet,
    with_rings,
)
from uavcover.terrain.frames import Bounds
from uavcover.terrain.terrain_source import TerrainSource, find_tiles

_BUNDLED = "bundled:"
_LARGEST = 1e20
"""Size of the largest number; arithmetic with larger ones may overflow."""
_MOST_MISTAKES = 5
"""Largest number of obstacles named in an error line."""
_LOG = logging.getLogger(__name__)
_SCENARIO = TypeAdapter(Scenario)
_AREA = TypeAdapter(Area)


def bundled_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that come with the package."""
    folder = resources.files("uavcover") / "scenarios"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Read a scenario: a TOML file, or the name of a bundled one.

    The result is self-contained: a GeoJSON area is read in, and the terrain file's path is absolute.

    Raises:
        ScenarioError: one line with the path of every invalid key.
    """
    path = Path(name_or_path)
    bundled = bundled_scenarios()
    if str(name_or_path) in bundled and not path.is_file():
        path = Path(str(resources.files("uavcover") / "scenarios" / f"{name_or_path}.toml"))
    if path.suffix.lower() in AREA_SUFFIXES:
        raise ScenarioError(
            f"{name_or_path}: this is an area, not a scenario; create a scenario with: uavcover new {name_or_path}"
        )
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(
            f"{name_or_path}: this is neither a readable scenario file ({error.__class__.__name__}) nor a bundled "
            f"scenario ({', '.join(bundled)})"
        ) from error
    return parse_scenario(text, source=str(name_or_path), folder=path.resolve().parent)


def parse_scenario(text: str, *, source: str, folder: Path) -> Scenario:
    """Parse a scenario from TOML text.

    Raises:
        ScenarioError: one line with the path of every invalid key.
    """
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ScenarioError(f"{source}: the file is not valid TOML: {error}") from error
    for key, number in _too_large(raw):
        raise ScenarioError(f"{source}: {key}: must be between -1e20 and 1e20, not {_shown(number)}")
    raw, given = with_fleet(raw, source=source), raw
    raw, own_sensors = _with_built_in_sensors(raw, source)
    # Validated as JSON: there the validator accepts a list for a tuple and a table for a dataclass, and is strict otherwise.
    document = json.dumps(raw, default=str)
    mistakes: list[str] = []
    try:
        scenario = _SCENARIO.validate_json(document, strict=True)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        mistakes += _mistakes(errors, raw, launched=LAUNCH_POINTS in given)
        if not any(details["loc"][:1] == ("area",) for details in errors):
            # Other keys are invalid already; report the mistakes in the area's shape at the same time.
            area = _AREA.validate_json(json.dumps(raw["area"], default=str), strict=True)
            mistakes += outline_mistakes(area, folder, key="area")
        raise ScenarioError(f"{source}: {'; '.join(mistakes)}") from error
    if own_sensors:
        scenario = _with_own_sensors(scenario, own_sensors, source)
    mistakes += outline_mistakes(scenario.area, folder, key="area") + fence_mistakes(scenario.limits)
    for number, vehicle in enumerate(scenario.vehicles):
        if not scenario.has_launch_points:
            mistakes += _link_mistakes(vehicle.link, f"vehicle.{number}.link")
        if vehicle.area is not None:
            mistakes += outline_mistakes(vehicle.area, folder, key=f"vehicle.{number}.area")
    if not scenario.vehicles or scenario.has_launch_points:
        mistakes += _link_mistakes(scenario.vehicle.link, "vehicle.link")
    mistakes += _obstacle_mistakes(scenario, folder)
    on_earth = scenario.area.is_geographic or scenario.origin is not None
    drawn = [zone for zone in scenario.no_fly if zone.file is None]
    mistakes += no_fly_mistakes(drawn, on_earth=on_earth)[:_MOST_MISTAKES]
    if not on_earth and len(drawn) < len(scenario.no_fly):
        mistakes.append("no_fly: zones from a file require a position on Earth; add an [origin]")
    if mistakes:
        raise ScenarioError(f"{source}: {'; '.join(mistakes)}")
    area = with_rings(scenario.area, folder, key="area")
    around = bounds_deg(area, scenario)
    return dataclasses.replace(
        scenario,
        area=area,
        vehicles=tuple(
            dataclasses.replace(
                vehicle, area=vehicle.area and with_rings(vehicle.area, folder, key=f"vehicle.{k}.area")
            )
            for k, vehicle in enumerate(scenario.vehicles)
        ),
        terrain=_absolute_files(scenario.terrain, folder, around),
        obstacles=_inline_obstacles(scenario.obstacles, folder),
        no_fly=_inline_zones(scenario.no_fly, folder, around),
    )


def _with_built_in_sensors(raw: dict[str, Any], source: str) -> tuple[dict[str, Any], dict[int | None, Sensor]]:
    """The tables with every sensor of a third party as a built-in one, and those that have a class of their own.

    A sensor of a third party is an entry point of the group ``uavcover.sensors``, whose name is its kind: a function from its
    table in the scenario, without ``kind``, to the table of a built-in sensor; or a class derived from a built-in sensor, made
    of its table, which is validated as that built-in sensor. A ValueError says what is wrong with a key.

    Returns:
        The tables; and the sensors of such classes by the number of their vehicle, None for [sensor].

    Raises:
        ScenarioError: the table cannot be used.
    """
    own: dict[int | None, Sensor] = {}

    def built_in(section: dict[str, Any], key: str, number: int | None) -> dict[str, Any]:
        kind = section.get("kind")
        if not isinstance(kind, str) or kind not in registered("uavcover.sensors"):
            return section
        entry = load("uavcover.sensors", kind)
        try:
            if not isinstance(entry, type):
                return dict(entry({name: value for name, value in section.items() if name != "kind"}))
            made = entry(**section)
            if not isinstance(made, Sensor):
                raise TypeError(f"{entry.__name__} is not derived from a built-in sensor (uavcover.model.sensor)")
            own[number] = made
            return _as_built_in(made)
        except (InputError, ValueError, TypeError, KeyError) as error:
            raise ScenarioError(f"{source}: {key}: {kind}: {error}") from error

    found = dict(raw)
    if isinstance(raw.get("sensor"), dict):
        found["sensor"] = built_in(raw["sensor"], "sensor", None)
    if isinstance(vehicles := raw.get("vehicles"), list):
        found["vehicles"] = [
            {**vehicle, "sensor": built_in(vehicle["sensor"], f"vehicle.{k}.sensor", k)}
            if isinstance(vehicle, dict) and isinstance(vehicle.get("sensor"), dict)
            else vehicle
            for k, vehicle in enumerate(vehicles)
        ]
    return found, own


def _as_built_in(sensor: Sensor) -> dict[str, Any]:
    """The table of the built-in sensor that a class of a third party is derived from."""
    base = next(cls for cls in type(sensor).__mro__ if cls in get_args(Sensor))
    table = {field.name: getattr(sensor, field.name) for field in dataclasses.fields(base)}
    return table | {"kind": get_args(get_type_hints(base)["kind"])[0]}


def _with_own_sensors(scenario: Scenario, own: dict[int | None, Sensor], source: str) -> Scenario:
    """The scenario with the sensors of classes of third parties in place of the built-in ones they were validated as."""
    vehicles = tuple(
        dataclasses.replace(vehicle, sensor=own.get(k, vehicle.sensor)) for k, vehicle in enumerate(scenario.vehicles)
    )
    try:
        return dataclasses.replace(scenario, sensor=own.get(None, scenario.sensor), vehicles=vehicles)
    except ValueError as error:
        raise ScenarioError(f"{source}: {error}") from error


def dump_scenario(scenario: Scenario) -> str:
    """TOML of a scenario with every default written out; reading it gives the same scenario."""
    tables = dataclasses.asdict(scenario, dict_factory=_given)
    if own := tables.pop("vehicles", None):
        tables["vehicle"] = own
    return tomli_w.dumps(tables)


def _given(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A table without the keys that are None, for which TOML has no word. [[no_fly]] can only follow where no list stands."""
    lists = {("no_fly", ()), ("vehicles", ())}
    return {key: value for key, value in pairs if value is not None and not (value == () and (key, value) in lists)}


def terrain_source(terrain: RasterTerrain) -> TerrainSource:
    """The elevation files of a loaded scenario: the ground."""
    return TerrainSource(
        tuple(_data_file(name, Path()) for name in _names(terrain.file)), crs=terrain.crs, band=terrain.band,
        height_unit=terrain.height_unit, fill_no_data_m=terrain.fill_no_data_m, water_height_m=terrain.water_height_m,
    )  # fmt: skip


def surface_source(terrain: RasterTerrain) -> TerrainSource | None:
    """The files of a loaded scenario's surface model; None without one."""
    if terrain.surface_file is None:
        return None
    return TerrainSource(
        tuple(_data_file(name, Path()) for name in _names(terrain.surface_file)), crs=terrain.surface_crs,
        band=terrain.surface_band, height_unit=terrain.surface_height_unit, fill_no_data_m=terrain.fill_no_data_m,
        water_height_m=terrain.water_height_m,
        key="terrain.surface_file",
    )  # fmt: skip


def _names(file: str | tuple[str, ...]) -> tuple[str, ...]:
    return (file,) if isinstance(file, str) else file


def _data_file(name: str, folder: Path) -> Path:
    """A file named by a scenario: bundled, or relative to a folder."""
    if name.startswith(_BUNDLED):
        return Path(str(resources.files("uavcover") / "data" / name.removeprefix(_BUNDLED)))
    return folder / name


def _too_large(value: object, path: str = "") -> Iterator[tuple[str, float]]:
    """The path and value of each number of a TOML document that is finite, but beyond all reason."""
    if isinstance(value, list):
        value = dict(enumerate(value))
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _too_large(entry, f"{path}.{key}" if path else str(key))
    elif isinstance(value, int | float) and _LARGEST < abs(value) < math.inf:
        yield path, value


def _mistakes(errors: list[ErrorDetails], raw: dict[str, Any], *, launched: bool) -> list[str]:
    """The mistakes, one line each without repetition, with the path of the key as the user wrote it.

    Args:
        errors: of the validator.
        raw: the tables that it saw.
        launched: whether the listed vehicles are one, at its home and its launch points.
    """
    found: list[str] = []
    for details in errors:
        keys = list(details["loc"])
        if raw.get("vehicles") and keys[:1] == ["vehicle"]:
            continue  # the first one of the list, whose mistakes are named there
        if launched and keys[:1] == ["vehicles"] and len(keys) > 2:
            parent = ["home"] if keys[1] == 0 else [LAUNCH_POINTS, int(keys[1]) - 1]
            keys = [*parent, *keys[3:]] if keys[2] == "home" else ["vehicle", *keys[2:]]
        elif keys[:1] == ["vehicles"]:
            keys[0] = "vehicle"
        begin, section, classes = keys[:1], raw.get(str(keys[0])) if keys else None, _section_classes(*keys[:1])
        if keys[:1] == ["vehicle"] and keys[2:3] == ["sensor"]:
            begin, section, classes = keys[:3], raw["vehicles"][keys[1]]["sensor"], _section_classes("sensor")
        if len(classes) > 1 and len(keys) > len(begin):
            # A section with several kinds is validated as each of them; only the errors of its own kind matter.
            name, own = ".".join(map(str, begin)), keys[len(begin)]
            by_kind = {get_args(get_type_hints(cls)["kind"])[0]: cls.__name__ for cls in classes}
            kind = section.get("kind") if isinstance(section, dict) else None
            if not isinstance(kind, str) or kind not in by_kind:
                names = " or ".join(repr(name) for name in by_kind)
                if not isinstance(section, dict):
                    message = f"{name}: must be a table with a kind ({names}), not {_shown(section)}"
                elif "kind" in section:
                    message = f"{name}.kind: must be {names}, not {_shown(kind)}"
                else:
                    message = f"{name}.kind: the key is missing; set it to {names}"
            elif own == by_kind[kind]:
                kinds = [cls for cls in classes if cls.__name__ == own]
                message = _mistake(details, [*begin, *keys[len(begin) + 1 :]], kinds)
            else:
                continue
        else:
            message = _mistake(details, keys, classes or [Scenario])
        if message not in found:
            found.append(message)
    return found


def _mistake(details: ErrorDetails, keys: list[str | int], classes: list[type]) -> str:
    path = ".".join(str(key) for key in keys)
    given = _shown(details["input"])
    match details["type"]:
        case "unexpected_keyword_argument":
            return f"{path}: unknown key{_suggestion(str(keys[-1]), classes[0] if len(keys) > 1 else Scenario)}"
        case "missing" | "missing_argument" if isinstance(keys[-1], int):
            return f"{path}: a number is missing; write each corner as a pair of numbers"
        case "missing" | "missing_argument":
            return f"{path}: the key is missing"
        case "float_type" | "finite_number":
            return f"{path}: must be a finite number, not {given} (the name of the key states the unit)"
        case "int_type" | "int_from_float":
            return f"{path}: must be a whole number, not {given}"
        case "string_type":
            return f"{path}: must be text in quotes, not {given}"
        case "literal_error":
            return f"{path}: must be {details['ctx']['expected']}, not {given}"
        case "tuple_type":
            return f"{path}: must be a list, not {given}"
        case "too_long":
            return f"{path}: each corner must be a pair of numbers, not {given}"
        case "dataclass_type":
            return f"{path}: must be a table, not {given}"
        case "value_error":
            # Messages of rules start with their key, relative to their own section.
            message = details["msg"].removeprefix("Value error, ")
            key = message.split(":")[0]
            own = any(key == field.name for cls in classes for field in dataclasses.fields(cls))
            return f"{path}.{message}" if path and own else f"{path}: {message}" if path else message
    return f"{path}: {details['msg']}"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _section_classes(section: str | int = "") -> list[type]:
    """The possible dataclasses of a section of the file."""
    hint = get_type_hints(Scenario).get("home" if section == LAUNCH_POINTS else str(section))
    return [part for part in (hint, *get_args(hint)) if isinstance(part, type) and dataclasses.is_dataclass(part)]


def _suggestion(key: str, cls: type) -> str:
    here = [field.name for field in dataclasses.fields(cls)]
    if cls is Scenario:
        here[here.index("vehicles")] = LAUNCH_POINTS  # vehicles are written as [[vehicle]]
    if cls is not Scenario and key in {field.name for field in dataclasses.fields(Scenario)}:
        return " (write it above the first [section])"
    for section in dataclasses.fields(Scenario):
        if any(key == field.name for other in _section_classes(section.name) for field in dataclasses.fields(other)):
            another = cls in _section_classes(section.name)
            return f" (it is of another kind of {section.name})" if another else f" (it belongs in [{section.name}])"
    close = difflib.get_close_matches(key, here, n=1)
    return f" (did you mean {close[0]}?)" if close else f" (known: {', '.join(here)})"


def _inline_obstacles(obstacles: Obstacles, folder: Path) -> Obstacles:
    """The obstacles with their file replaced by its content. Raises ScenarioError: the file cannot be used."""
    if obstacles.file is None:
        return obstacles
    read = read_obstacles(_data_file(obstacles.file, folder))
    return dataclasses.replace(obstacles, file=None, prisms=(*obstacles.prisms, *read))


def _inline_zones(entries: Sequence[NoFly], folder: Path, around: Bounds | None) -> tuple[NoFly, ...]:
    """The no-fly zones with their files replaced by the zones near these bounds in degrees.

    Raises:
        ScenarioError: a file cannot be used.
    """
    found: list[NoFly] = []
    for number, entry in enumerate(entries):
        if entry.file is None:
            found.append(entry)
            continue
        try:
            zones, notes = read_zones(entry, folder=folder, near=around)
        except InputError as error:
            raise ScenarioError(f"no_fly.{number}.file: {error}") from error
        for note in notes:
            _LOG.warning("no-fly zones: %s", note)
        found += zones
    return tuple(found)


def with_no_fly(scenario: Scenario, files: Sequence[str], *, margin_m: float) -> Scenario:
    """A loaded scenario with the zones of more files, as ``[[no_fly]]`` entries with a margin would have them.

    Raises:
        InputError: a file cannot be used, or the scenario has no position on Earth.
    """
    if not (scenario.area.is_geographic or scenario.origin is not None):
        raise InputError(f"--no-fly: scenario {scenario.name} has no position on Earth; add an [origin]")
    entries = tuple(NoFly(file=str(Path(file).resolve()), margin_m=margin_m) for file in files)
    try:
        zones = _inline_zones(entries, Path(), bounds_deg(scenario.area, scenario))
    except ScenarioError as error:
        raise InputError(f"--no-fly: {str(error).partition(': ')[2]}") from error
    return dataclasses.replace(scenario, no_fly=(*scenario.no_fly, *zones))


def _link_mistakes(link: str | None, key: str) -> list[str]:
    """Reason why no vehicle can be at a link."""
    if link is None or link.startswith("mock:"):
        return []
    # Links bring pymavlink with them, which commands without a vehicle need not wait for.
    from mission_io.links.opening import parse_link_url

    try:
        parse_link_url(link)
    except MissionIoError as error:
        return [f"{key}: {error}"]
    return []


def _obstacle_mistakes(scenario: Scenario, folder: Path) -> list[str]:
    """Mistakes in the footprints of the obstacles."""
    try:
        prisms = _inline_obstacles(scenario.obstacles, folder).prisms
    except ScenarioError as error:
        return [str(error)]
    on_earth = scenario.area.is_geographic or scenario.origin is not None
    return prism_mistakes(prisms, on_earth=on_earth)[:_MOST_MISTAKES]


def _absolute_files(terrain: Terrain, folder: Path, around: Bounds | None) -> Terrain:
    """The terrain with absolute paths; of several tiles only those near these bounds in degrees."""
    if not isinstance(terrain, RasterTerrain):
        return terrain

    def absolute(file: str | tuple[str, ...], key: str) -> str | tuple[str, ...]:
        names = _names(file)
        if any(name.startswith(_BUNDLED) for name in names):
            return file
        files = find_tiles(names, folder=folder, around=around, key=key)
        return str(files[0]) if len(files) == 1 else tuple(map(str, files))

    surface = None if terrain.surface_file is None else absolute(terrain.surface_file, "terrain.surface_file")
    return dataclasses.replace(terrain, file=absolute(terrain.file, "terrain.file"), surface_file=surface)
