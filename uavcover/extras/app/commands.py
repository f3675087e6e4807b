"""The command line of each button: what the page asks for becomes words for ``uavcover``, checked."""

import re
from collections.abc import Callable, Mapping
from typing import Any

from uavcover.errors import InputError
from uavcover.extras.app.workspace import PHOTOS, Workspace, free_name
from uavcover.model.terrain import RasterTerrain
from uavcover.scenario.scenario_file import load_scenario, surface_source, terrain_source

Words = tuple[str, list[str]]
"""The run folder that the command works on, and its command line."""
_BUDGET = re.compile(r"[0-9]{1,6}(\.[0-9]{1,3})?(s|m|min|h)")
_RULE = re.compile(r"[A-Za-z0-9<>=.,:%-]{1,80}")
_NUMBER = re.compile(r"[0-9]{1,9}")
_ADDRESS = re.compile(r"[A-Za-z0-9/._:\[\]?=,-]{1,120}")
_MOST_VEHICLES = 20
_WORD = re.compile(r"[a-z0-9-]{1,40}")


def command_of(kind: str, asked: Mapping[str, Any], workspace: Workspace, *, flights_allowed: bool) -> Words:
    """The command line of a button.

    Raises:
        InputError: there is no such button, or a value of it is wrong.
    """
    if kind not in _BUILDERS:
        raise InputError(f"{kind!r}: the page has no such command")
    if kind == "fly":
        return _fly(asked, workspace, flights_allowed=flights_allowed)
    return _BUILDERS[kind](asked, workspace)


def _plan(asked: Mapping[str, Any], workspace: Workspace) -> Words:
    scenario = workspace.path(_text(asked, "scenario"))
    if not scenario.is_file():
        raise InputError(f"{scenario.name}: no such scenario; save it first")
    run = workspace.free_run(scenario.stem)
    words = ["plan", workspace.name(scenario), "-o", run.name]
    if asked.get("evaluations"):
        words += ["--evaluations", _match(asked, "evaluations", _NUMBER)]
    else:
        words += ["--budget", _match(asked, "budget", _BUDGET, default="30s")]
    for name, pattern in (("select", _RULE), ("seed", _NUMBER), ("vehicles", _NUMBER), ("autopilot", _WORD)):
        if asked.get(name):
            words += [f"--{name}", _match(asked, name, pattern)]
    return run.name, words


def _on_run(*command: str) -> Callable[[Mapping[str, Any], Workspace], Words]:
    def words(asked: Mapping[str, Any], workspace: Workspace) -> Words:
        run = _run(asked, workspace)
        return run, [command[0], run, *command[1:], *(["--force"] if asked.get("force") else [])]

    return words


def _select(asked: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(asked, workspace)
    return run, ["select", run, _match(asked, "rule", _RULE)]


def _edit(asked: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(asked, workspace)
    edited = workspace.free_run(f"{workspace.path(run).name}-edited")
    waypoints = workspace.path(_text(asked, "waypoints"))
    return edited.name, ["edit", run, workspace.name(waypoints), "-o", edited.name]


def _export(asked: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(asked, workspace)
    file_format = _match(asked, "format", _WORD)
    suffix = {"wpml": ".kmz", "print": ".html", "litchi": ".csv", "mavproxy-fence": ".txt"}.get(
        file_format, f".{file_format}"
    )
    out = free_name(workspace.root, f"{workspace.path(run).name}-{file_format}", suffix)
    drone = ["--drone", _match(asked, "drone", _WORD)] if asked.get("drone") else []
    return run, ["export", run, "--format", file_format, *drone, "-o", out.name]


def _upload(asked: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(asked, workspace)
    return run, ["plan-upload", run, *_links(asked), *_sortie(asked)]


def _fly(asked: Mapping[str, Any], workspace: Workspace, *, flights_allowed: bool) -> Words:
    run = _run(asked, workspace)
    to = str(asked.get("to") or "mock:")
    words = ["fly", run, *_links(asked), *_sortie(asked)]
    if asked.get("mock_speed"):
        words += ["--mock-speed", _match(asked, "mock_speed", re.compile(r"[0-9]{1,3}(\.[0-9])?"))]
    words += [f"--{name}" for name in ("force", "resume") if asked.get(name)]
    if asked.get("sortie"):  # flights of one run that have vehicles of their own go on side by side
        run = f"{run}/sortie-{_match(asked, 'sortie', _NUMBER)}"
    if asked.get("confirmed"):
        if not flights_allowed:
            raise InputError("fly: this page flies simulated vehicles only; start it with --allow-flight for real ones")
        if asked["confirmed"] != to:
            raise InputError(f"fly: type the vehicle's address, {to}, to confirm")
        words.append("--yes")
    return run, words


def _links(asked: Mapping[str, Any]) -> list[str]:
    """``--to`` for each vehicle: addresses with spaces between them, or one mock address that stands for all."""
    addresses = str(asked.get("to") or "mock:").split()
    count = int(_match(asked, "vehicles", _NUMBER, default="1"))
    if not 1 <= count <= _MOST_VEHICLES:
        raise InputError(f"vehicles: {count} is outside 1 to {_MOST_VEHICLES}")
    if count > 1 and len(addresses) == 1 and addresses[0].startswith("mock:"):
        addresses *= count
    if len(addresses) != count:
        raise InputError(
            f"to: specify {count} addresses, separated by spaces (one for each vehicle), not {len(addresses)}"
        )
    return [word for address in addresses for word in ("--to", _match({"to": address}, "to", _ADDRESS))]


def _check(asked: Mapping[str, Any], workspace: Workspace) -> Words:
    """The independent check of a run's mission file, against the scenario's elevation data, zones and limits."""
    run = _run(asked, workspace)
    folder = workspace.path(f"{run}/sortie-{_match(asked, 'sortie', _NUMBER)}" if asked.get("sortie") else run)
    mission = folder / "mission.plan"
    if not mission.is_file():
        raise InputError(f"{folder.name}: the run folder has no mission.plan; choose one of its flights, or plan again")
    scenario = load_scenario(str(folder / "scenario.toml"))
    if not isinstance(scenario.terrain, RasterTerrain):
        raise InputError(f"{folder.name}: the scenario has no elevation data, which check requires")
    ground, surface = terrain_source(scenario.terrain), surface_source(scenario.terrain)
    words = ["check", workspace.name(mission), "--vertical-datum", scenario.terrain.vertical_datum]
    words += ["--trust-dem"] if scenario.terrain.trust_heights else []
    for option, source in (("--dem", ground), ("--dsm", surface)):
        words += [word for file in (source.files if source is not None else ()) for word in (option, str(file))]
    words += ["--max-height", f"{scenario.transit_ceiling_agl_m:g}m", "--autopilot", scenario.vehicle.autopilot]
    for zone in scenario.no_fly:
        words += ["--no-fly", str(zone.file)] if zone.file else []
    return run, words


def _photos(asked: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(asked, workspace)
    out = workspace.free_run(f"{workspace.path(run).name}-photos")
    photos = workspace.path(str(asked.get("photos") or f"{run}/{PHOTOS}"))
    if not photos.is_dir():
        raise InputError(f"photos: {photos.name} is not a folder in {workspace.root.name}; drop photos on the page")
    return run, ["judge-photos", workspace.name(photos), "--scenario", run, "-o", out.name]


_BUILDERS: dict[str, Callable[[Mapping[str, Any], Workspace], Words]] = {
    "plan": _plan,
    "select": _select,
    "edit": _edit,
    "export": _export,
    "upload": _upload,
    "fly": lambda asked, workspace: _fly(asked, workspace, flights_allowed=False),
    "verify": _on_run("verify"),
    "gaps": _on_run("gaps"),
    "report": _on_run("report"),
    "photos": _photos,
    "check": _check,
}


def _run(asked: Mapping[str, Any], workspace: Workspace) -> str:
    path = workspace.path(_text(asked, "run"))
    if not (path / "plan.json").is_file():
        raise InputError(f"{path.name}: this is not a run folder with a plan; plan first")
    return workspace.name(path)


def _sortie(asked: Mapping[str, Any]) -> list[str]:
    return ["--sortie", _match(asked, "sortie", _NUMBER)] if asked.get("sortie") else []


def _text(asked: Mapping[str, Any], key: str) -> str:
    value = asked.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{key}: the value is missing")
    return value


def _match(asked: Mapping[str, Any], key: str, pattern: re.Pattern[str], *, default: str = "") -> str:
    """A value as text; it never begins with a dash, so that it is no option."""
    value = str(asked.get(key) or default)
    if pattern.fullmatch(value) is None or value.startswith("-"):
        raise InputError(f"{key}: {value[:40]!r} is not a valid value")
    return value
