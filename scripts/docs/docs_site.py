"""Pages of the documentation that are generated from the code: commands, keys of a scenario, cameras and vehicles.

mkdocs loads this file as a hook (``mkdocs.yml``). ``python scripts/docs/docs_site.py`` prints the pages.
"""

import ast
import dataclasses
import inspect
import re
import sys
import textwrap
import tomllib
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from uavcover.cli.main import app
from uavcover.model.scenario import Scenario
from uavcover.new.catalog import CAMERAS, VEHICLES

_VALUE_NAMES: dict[Any, str] = {
    str: "TEXT",
    int: "INTEGER",
    float: "NUMBER",
    Path: "PATH",
    list[Path]: "PATH",
    list[str]: "TEXT",
}
_ROOT = Path(__file__).parents[2]
_RANGES = {
    "fov_deg": "above 0, below 180 degrees",
    "fov_across_deg": "above 0, below 180 degrees",
    "fov_along_deg": "above 0, below 180 degrees",
    "max_incidence_deg": "above 0, up to 90 degrees",
    "pixels_across": "above 0",
    "max_ground_sample_m": "above 0",
    "trigger_distance_m": "above 0",
    "forward_overlap": "0 to below 1",
    "side_overlap": "0 to below 1",
    "max_height_agl_m": "above `min_height_agl_m` by more than twice `height_margin_m`",
    "max_transit_height_agl_m": "above `transit_clearance_m` + `height_margin_m`",
    "max_alt_amsl_m": "above `min_alt_amsl_m`",
    "max_airspeed_m_s": "at least `cruise_speed_m_s`",
    "max_mission_items": "at least 8",
    "evaluations": "at least `population_size`",
    "look_distance_m": "above 0",
    "ceiling_agl_m": "above `floor_agl_m`",
    "ceiling_amsl_m": "above `floor_amsl_m`",
}
"""Of keys whose check is not in one plain line of their class."""
_EXAMPLES = {
    "vehicle.link": '"udpin://127.0.0.1:14550"',
    "vehicle.system_id": "2",
    "vehicle.sensor": '{ kind = "nadir-camera", fov_deg = 40.0, range_m = 200.0 }',
    "vehicle.area": '{ file = "west.kml" }',
    "vehicle.home.lat_deg": "36.4785",
    "vehicle.home.lon_deg": "-84.219",
    "vehicle.home.east_m": "120.0",
    "vehicle.home.north_m": "-40.0",
    "fleet.pad_spacing_m": "60.0",
    "flight_window_utc": '["2026-06-01T06:00Z", "2026-06-01T18:00Z"]',
    "vehicle.power.hover_induced_m_s": "4.8",
    "area.geojson": '"valley.geojson"',
    "area.crs": '"EPSG:32632"',
    "area.feature": '"north meadow"',
    "area.layer": '"parcels"',
    "area.margin_m": "30.0",
    "area.make_valid": "true",
    "area.swap_axes": "true",
    "area.holes_lon_lat_deg": "[[[8.02, 46.51], [8.03, 46.51], [8.03, 46.52]]]",
    "area.holes_east_north_m": "[[[10.0, 10.0], [60.0, 10.0], [60.0, 40.0]]]",
    "area.polygon_lon_lat_deg": "[[8.0, 46.5], [8.1, 46.5], [8.1, 46.6]]",
    "area.polygons_lon_lat_deg": "[[[[8.0, 46.5], [8.1, 46.5], [8.1, 46.6]]]]",
    "area.polygons_east_north_m": "[[[[0.0, 0.0], [900.0, 0.0], [900.0, 500.0]]]]",
    "limits.min_alt_amsl_m": "450.0",
    "limits.max_alt_amsl_m": "900.0",
    "limits.fence_lon_lat_deg": "[[7.99, 46.49], [8.11, 46.49], [8.11, 46.61]]",
    "limits.fence_polygons_lon_lat_deg": "[[[7.99, 46.49], [8.11, 46.49], [8.11, 46.61]]]",
    "limits.fence_polygons_east_north_m": "[[[-99.0, -99.0], [999.0, -99.0], [999.0, 599.0]]]",
    "no_fly.ceiling_agl_m": "120.0",
    "no_fly.floor_amsl_m": "850.0",
    "no_fly.make_valid": "true",
    "no_fly.center_east_north_m": "[120.0, -40.0]",
    "no_fly.polygon_east_north_m": "[[0.0, 0.0], [90.0, 0.0], [90.0, 50.0]]",
    "no_fly.polygon_lon_lat_deg": "[[8.0, 46.5], [8.1, 46.5], [8.1, 46.6]]",
    "no_fly.polygons_lon_lat_deg": "[[[[8.0, 46.5], [8.1, 46.5], [8.1, 46.6]]]]",
    "obstacles.prisms": "[{ height_m = 12.0, rings_east_north_m = [[[0.0, 0.0], [9.0, 0.0], [9.0, 5.0]]] }]",
    "obstacles.prisms.rings_lon_lat_deg": "[[[8.01, 46.51], [8.011, 46.51], [8.011, 46.511]]]",
    "planner.cell_size_m": "10.0",
    "planner.initial": '["boustrophedon", "contour-lines"]',
    "planner.line_heading_deg": "30.0",
    "planner.waypoint_price": "0.1",
    "requirements.max_deviation_m": "10.0",
    "requirements.max_ground_speed_m_s": "12.0",
    "requirements.min_overlap_fraction": "0.97",
    "requirements.min_sure_coverage_of_coverable": "0.9",
    "sensor.trigger_distance_m": "25.0",
    "vehicle.jerk_m_s3": "1.0",
    "vehicle.max_mission_items": "400",
    "terrain.band": "1",
    "terrain.crs": '"EPSG:32632"',
    "terrain.fill_no_data_m": "300.0",
    "terrain.water_height_m": "0.0",
    "terrain.grid_step_m": "5.0",
    "terrain.height_unit": '"ft"',
    "terrain.scale_m": "100.0",
    "terrain.surface_band": "1",
    "terrain.surface_crs": '"EPSG:32632"',
    "terrain.surface_height_unit": '"ft"',
    "terrain.surface_hides_m": "3.0",
    "terrain.surface_vertical_datum": '"EGM2008"',
}
"""Examples of keys that no bundled scenario and no page contains."""
_PHRASES = (
    (r"is outside (.+?)\.\.(.+)", r"\1 to \2"),
    (r"must be (above 0|below [\d.]+.*|at most [\d.]+.*)", r"\1"),
    (r"is below (\d+).*", r"at least \1"),
    (r"is outside (\d+) to below (\d+).*", r"\1 to below \2"),
    (r"is a share, 0\.\.1", "0 to 1"),
    (r"is no share (above 0, up to 1)", r"\1"),
    (r"must not be negative", "at least 0"),
)
"""What an error says of a value, and the range that it means."""
_NOTE = "*This page is generated from the code of uavcover.*"


def command_reference() -> str:
    """Markdown: each command with its arguments, options and defaults."""
    root: Any = typer.main.get_command(app)
    lines = ["# Commands", "", _NOTE, "", *_options(root), ""]
    group = None
    for name, command in _commands(root, "uavcover"):
        if command.rich_help_panel != group and not name.startswith("uavcover bench "):
            group = command.rich_help_panel
        lines += [f"## `{name}`", "", *(f"*{group}.*" if group else "",), "", _prose(command.help), ""]
        if not hasattr(command, "commands"):
            lines += ["```text", f"{name} {_usage(command)}".rstrip(), "```", ""]
        lines += [*_options(command), ""]
    return "\n".join(lines)


def scenario_reference() -> str:
    """Markdown: each section of a scenario file with its keys, types, ranges, defaults, examples and meanings."""
    lines = ["# Scenario keys", "", _NOTE, ""]
    lines += ["[The scenario file](scenario.md) explains the sections with examples.", ""]
    hints = typing.get_type_hints(Scenario)
    fields = [field for field in dataclasses.fields(Scenario) if field.name != "vehicles"]  # as [[vehicle]] says it
    sections = {field.name: _dataclasses_in(hints[field.name]) for field in fields}
    top = [field for field in fields if not sections[field.name]]
    lines += ["## Top level", "", *_keys(Scenario, top)]
    for section, classes in sections.items():
        for cls in classes:
            kind = _kind(cls)
            named = f"[[{section}]]" if typing.get_origin(hints[section]) is tuple else f"[{section}]"
            title = f"## `{named}`" + (f" with `kind = {_toml(kind)}`" if kind else "")
            needed = "Required." if _is_required(Scenario, section) else "Optional."
            lines += [title, "", f"{needed} {_prose(_summary(cls))}", ""]
            lines += _keys(cls, dataclasses.fields(cls), section)
            for field in dataclasses.fields(cls):
                for inner in _dataclasses_in(typing.get_type_hints(cls)[field.name]):
                    lines += [
                        f"### `{_header(typing.get_type_hints(cls)[field.name], section, field.name)}`",
                        "",
                        _prose(_summary(inner)),
                        "",
                    ]
                    lines += _keys(inner, dataclasses.fields(inner), f"{section}.{field.name}")
    return "\n".join(lines)


def product_reference() -> str:
    """Markdown: the cameras and vehicles that `new` knows by name, with the source of each row."""
    lines = ["# Cameras and vehicles", "", _NOTE, ""]
    lines += [
        "`uavcover new` accepts these names in any spelling and case. An empty cell means that no source states the value.",
        "",
    ]
    lines += ["## Cameras", "", "| name | camera | sensor, mm | pixels | lens, mm | shortest interval, s | source |"]
    lines += ["|---|---|---:|---:|---:|---:|---|"]
    for camera in CAMERAS.by_name().values():
        interval = f"{camera.min_interval_s:g}" if camera.min_interval_s is not None else ""
        lines.append(
            f"| `{camera.name}` | {camera.title} | {camera.sensor_across_mm:g} x {camera.sensor_along_mm:g} "
            f"| {camera.pixels_across} x {camera.pixels_along} | {camera.focal_length_mm:g} | {interval} | {camera.source} |"
        )
    lines += ["", "## Vehicles", ""]
    lines += [
        "| name | vehicle | flight time, min | cruise speed, m/s | maximum speed, m/s | climb, m/s | descent, m/s | source |"
    ]
    lines += ["|---|---|---:|---:|---:|---:|---:|---|"]
    for one in VEHICLES.by_name().values():
        air_min = None if one.endurance_s is None else one.endurance_s / 60.0
        figures = (air_min, one.cruise_speed_m_s, one.max_speed_m_s, one.max_climb_m_s, one.max_descent_m_s)
        cells = " | ".join("" if figure is None else f"{figure:g}" for figure in figures)
        lines.append(f"| `{one.name}` | {one.title} | {cells} | {one.source} |")
    return "\n".join([*lines, ""])


PAGES = {
    "reference/commands.md": command_reference,
    "reference/scenario_keys.md": scenario_reference,
    "reference/cameras.md": product_reference,
}


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages to those of docs/ (an event of mkdocs)."""
    from mkdocs.structure.files import File

    for path, make in PAGES.items():
        files.append(File.generated(config, path, content=make()))
    return files


def _commands(group: Any, path: str) -> Iterator[tuple[str, Any]]:
    for name in group.list_commands(None):
        command = group.commands[name]
        yield f"{path} {name}", command
        if hasattr(command, "commands"):
            yield from _commands(command, f"{path} {name}")


def _usage(command: Any) -> str:
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    needed = [p for p in command.params if p.param_type_name == "option" and p.required]
    words = [_argument_name(p) if p.required else f"[{_argument_name(p)}]" for p in arguments]
    return " ".join([*words, *(f"{p.opts[-1]} {_value_name(p)}" for p in needed), "[OPTIONS]"])


def _argument_name(parameter: Any) -> str:
    return str(parameter.metavar or parameter.name.upper()).strip("[]")


def _value_name(parameter: Any) -> str:
    kind = parameter.type_descriptor.annotation
    return str(parameter.metavar or _VALUE_NAMES.get(kind, getattr(kind, "__name__", "VALUE").upper()))


def _options(command: Any) -> list[str]:
    rows = []
    for parameter in command.params:
        if getattr(parameter, "hidden", False):
            continue
        if parameter.param_type_name == "argument":
            name = f"`{_argument_name(parameter)}`"
        else:
            name = ", ".join(f"`{option}`" for option in parameter.opts)
            if not (getattr(parameter, "is_flag", False) or getattr(parameter, "count", False)):
                name += f" `{_cell(_value_name(parameter))}`"
        rows.append(f"| {name} | {_default(parameter)} | {_cell(_prose(parameter.help))} |")
    return ["| | default | |", "|---|---|---|", *rows] if rows else []


def _default(parameter: Any) -> str:
    if parameter.required:
        return "required"
    value = parameter.default
    if callable(value) or value is None or value in ((), [], "") or "UNSET" in str(value).upper():
        return ""
    if value is False:
        return "off"
    if value is True:
        return "on"
    return "" if getattr(parameter, "count", False) else f"`{_cell(str(value))}`"


def _keys(cls: type, fields: Any, section: str = "") -> list[str]:
    hints, meanings, ranges, examples = typing.get_type_hints(cls), _attributes(cls), _ranges(cls), _examples()
    rows = []
    for field in fields:
        if cls is Scenario and _dataclasses_in(hints[field.name]):
            continue
        default, key = _field_default(field), f"{section}.{field.name}".strip(".")
        if key not in examples:
            key = key.removeprefix("vehicle.")  # a [[vehicle]] has tables of the scenario's own kinds
        example = (
            f"`{_toml(_kind(cls))}`" if field.name == "kind" else f"`{examples[key]}`" if key in examples else default
        )
        rows.append(
            f"| `{field.name}` | {_cell(_type_name(hints[field.name]))} | {ranges.get(field.name, '')} | {default} "
            f"| {_cell(example)} | {_sentence(_cell(_prose(meanings.get(field.name, ''))))} |"
        )
    return ["| key | type | range | default | example | meaning |", "|---|---|---|---|---|---|", *rows, ""]


def _ranges(cls: type) -> dict[str, str]:
    """What values each key may have: as the checks of its class say in their errors, or as in _RANGES."""
    said: dict[str, list[str]] = {}
    checks = [vars(each)["__post_init__"] for each in reversed(cls.__mro__) if "__post_init__" in vars(each)]
    for call in (call for check in checks for call in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(check))))):
        match call:
            case ast.Call(func=ast.Name(id="require_positive" | "require_not_negative" as name), args=[_, *keys]):
                for key in keys:
                    said.setdefault(ast.literal_eval(key), []).append("above 0" if "positive" in name else "at least 0")
            case ast.Call(func=ast.Name(id="require_between"), args=[_, low, high, *keys]):
                for key in map(ast.literal_eval, keys):
                    said.setdefault(key, []).append(f"{ast.literal_eval(low):g} to {ast.literal_eval(high):g}")
            case ast.Call(func=ast.Name(id="require"), args=[_, ast.JoinedStr() | ast.Constant() as message]):
                parts = message.values if isinstance(message, ast.JoinedStr) else [message]
                # "key: {value} is outside 0..1": the value's place stays empty.
                text = "".join(str(part.value) if isinstance(part, ast.Constant) else "" for part in parts)
                key, _, rest = text.partition(": ")
                words = re.sub(r"^\s*(m/s |m )?", "", rest)
                said.setdefault(key, []).extend(
                    re.sub(pattern, meant, words) for pattern, meant in _PHRASES if re.fullmatch(pattern, words)
                )
    return {**_RANGES, **{key: ", ".join(words) for key, words in said.items() if words}}


def _is_toml(line: str) -> bool:
    """Whether a line, commented out or not, is whole: its value does not go on in the next one, nor stands for another."""
    try:
        return "..." not in str(tomllib.loads(line.removeprefix("# ")))
    except tomllib.TOMLDecodeError:
        return False


def _examples() -> dict[str, str]:
    """Values by "section.key", the first that a bundled scenario, a page or _EXAMPLES gives."""
    found: dict[str, str] = {}
    texts = [path.read_text(encoding="utf-8") for path in sorted((_ROOT / "uavcover" / "scenarios").glob("*.toml"))]
    for page in sorted((_ROOT / "docs").rglob("*.md")):
        texts += re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    for text in texts:
        section = ""
        for line in text.splitlines():
            if header := re.match(r"(?:# )?\[\[?([\w.]+)\]\]?(?:\s+#.*)?$", line):
                section = header[1]
            elif (pair := re.match(r"(?:# )?(\w+) = (.+?)(?:\s+#.*)?$", line)) and _is_toml(pair[0]):
                found.setdefault(f"{section}.{pair[1]}".strip("."), pair[2])
    return {**found, **_EXAMPLES}


def _field_default(field: Any) -> str:
    if field.default is not dataclasses.MISSING:
        return "none" if field.default is None else f"`{_toml(field.default)}`"
    if field.default_factory is not dataclasses.MISSING:
        return f"`{_toml(field.default_factory())}`"
    return "required"


def _toml(value: Any) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{value}"'
        case _ if dataclasses.is_dataclass(value):
            return "{}"  # a table with its defaults
        case tuple() | list():
            return "[" + ", ".join(_toml(each) for each in value) + "]"
        case _:
            return str(value)


def _kind(cls: type) -> str | None:
    hint = typing.get_type_hints(cls).get("kind")
    return typing.get_args(hint)[0] if typing.get_origin(hint) is typing.Literal else None


def _dataclasses_in(hint: Any) -> list[type]:
    if inspect.isclass(hint) and dataclasses.is_dataclass(hint):
        return [hint]
    return [cls for each in typing.get_args(hint) for cls in _dataclasses_in(each)]


def _header(hint: Any, section: str, name: str) -> str:
    """Of a table inside a section, or of each of a list of them."""
    return f"[{section}.{name}]" if dataclasses.is_dataclass(hint) else f"[[{section}.{name}]]"


def _type_name(hint: Any) -> str:
    if dataclasses.is_dataclass(hint):
        return "table"
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Literal:
        return " or ".join(f"`{_toml(each)}`" for each in arguments)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_type_name(each) for each in arguments if each is not type(None))
    if origin is tuple:
        inner = [each for each in arguments if each is not Ellipsis]
        if len(inner) > 1 and len(set(inner)) == 1:
            return f"[{', '.join(_type_name(each) for each in inner)}]"
        return f"list of {_type_name(inner[0])}"
    return {"float": "number", "int": "integer", "str": "text", "bool": "true or false"}.get(
        getattr(hint, "__name__", ""), getattr(hint, "__name__", str(hint))
    )


def _attributes(cls: type) -> dict[str, str]:
    """The comments at the fields of a dataclass, and those of what it is made from: name to meaning."""
    found: dict[str, str] = {}
    for base in cls.__bases__:
        if dataclasses.is_dataclass(base):
            found |= _attributes(base)
    above: list[str] = []
    for line in inspect.getsource(cls).splitlines():
        if line.startswith("    # "):
            above.append(line[6:])
            continue
        if field := re.match(r"    (\w+): [^#]*?(?:  # (.*))?$", line):
            found[field[1]] = f"{' '.join(above) or field[2] or ''}".rstrip(".") + "."
        above = []
    return found


def _summary(cls: type) -> str:
    return inspect.getdoc(cls) or ""


def _prose(text: str | None) -> str:
    """Help text and docstrings as Markdown: double backticks become single ones, and angle brackets are no tags."""
    joined = re.sub(r"(?<!\n)\n(?!\n)\s*", " ", inspect.cleandoc(text or "").replace("\b\n", "").replace("\f", ""))
    return re.sub(r"`?`([^`]+)``?", r"`\1`", joined).replace("<", "&lt;")


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _is_required(cls: Any, name: str) -> bool:
    (field,) = (field for field in dataclasses.fields(cls) if field.name == name)
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


if __name__ == "__main__":
    for make in PAGES.values():
        sys.stdout.write(make() + "\n")
