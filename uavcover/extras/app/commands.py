"""The command line of each button: converts requests of the page to arguments of ``uavcover``, and checks them."""

import csv
import json
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from anyio import to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from uavcover.errors import InputError
from uavcover.extras.app.workspace import OWN_FOLDER, PHOTOS, Workspace, free_name
from uavcover.model.area import RasterTerrain
from uavcover.report.map_data import REASON_TEXTS
from uavcover.scenario.scenario_file import load_scenario, surface_source, terrain_source

# Files of the user: kept under their names in the folder, photos in a folder of their run; and what photos show.

MOST_UPLOAD_BYTES = 256 << 20
PHOTO_KINDS = frozenset(
    {".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".mrk", ".txt", ".csv", ".json", ".bin", ".tlog", ".ulg"}
)
_SHOWN = (
    "verdict", "pictures", "counted", "coverage_of_coverable", "required", "overlap_fraction", "overlap_required", "gaps",
)  # fmt: skip
MOST_PHOTO_BYTES = 16 << 30
"""Of all photos of a run."""


async def take_file(request: Request, workspace: Workspace) -> Response:
    """Keep a file under its name, or under a free one beside it; a photo of a run replaces the one of its name."""
    path = workspace.path(Path(request.path_params["name"]).name)
    run = request.query_params.get("photo_of", "")
    most = MOST_UPLOAD_BYTES
    if run:
        path, left = await to_thread.run_sync(_photo, workspace, run, path.name)
        most = min(most, left)
    too_large = f"{path.name}: the file is larger than the remaining {most >> 20} MiB; copy it into the folder"
    length = request.headers.get("content-length", "")
    if length.isdigit() and int(length) > most:
        return refusal(413, too_large)
    own = workspace.root / OWN_FOLDER
    own.mkdir(exist_ok=True)
    half, size = free_name(own, "upload", ".half"), 0
    try:
        with half.open("xb") as file:
            async for chunk in request.stream():
                size += len(chunk)
                if size > most:
                    return refusal(413, too_large)
                await to_thread.run_sync(file.write, chunk)
        if not run:
            path = free_name(path.parent, path.stem, path.suffix)
        half.rename(path)
    except OSError as error:
        return refusal(
            507, f"{path.name}: the file cannot be written ({error.strerror or error}); free some disk space"
        )
    finally:
        half.unlink(missing_ok=True)
    return JSONResponse({"name": workspace.name(path), "bytes": size})


def refusal(status: int, text: str, **more: Any) -> Response:
    """An answer with the reason of a refusal."""
    return JSONResponse({"error": text, **more}, status_code=status)


def _photo(workspace: Workspace, run: str, name: str) -> tuple[Path, int]:
    """Where a photo of a run is kept, and how many bytes there may still be."""
    folder = workspace.path(run)
    if not (folder / "plan.json").is_file():
        raise InputError(f"{folder.name}: this is not a run folder with a plan; plan first")
    if Path(name).suffix.lower() not in PHOTO_KINDS:
        raise InputError(f"{name}: unsupported file; use photos (.jpg, .tif, .dng), a list of positions or a log")
    photos = workspace.path(f"{run}/{PHOTOS}")
    photos.mkdir(exist_ok=True)
    path = workspace.path(f"{run}/{PHOTOS}/{name}")
    used = sum(each.stat().st_size for each in photos.iterdir() if each.is_file() and each.name != name)
    return path, max(0, MOST_PHOTO_BYTES - used)


def photo_document(folder: Path) -> dict[str, Any]:
    """Verdict, positions, footprints and gaps of a folder that ``judge-photos`` wrote.

    Raises:
        InputError: it is none.
    """
    try:
        verdict = json.loads((folder / "photos.json").read_text(encoding="utf-8"))
        shapes = [
            json.loads((folder / name).read_text(encoding="utf-8")) for name in ("footprints.geojson", "gaps.geojson")
        ]
        with (folder / "pictures.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{folder.name}: this folder contains no verdict of photos ({error}); create one with: uavcover judge-photos"
        ) from error
    placed = [row for row in rows if row.get("lon_deg") and row.get("lat_deg")]
    for gap in shapes[1]["features"]:
        gap["properties"]["reason"] = REASON_TEXTS.get(
            gap["properties"].get("reason"), "some planned photos are missing"
        )
    left_out = [[row["name"], row["reason"]] for row in rows if row["counted"] != "yes"]
    return {
        **{key: verdict.get(key) for key in _SHOWN},
        "photos": [
            {"name": row["name"], "why": row["reason"], "place": [float(row["lon_deg"]), float(row["lat_deg"])]}
            for row in placed
        ],
        "footprints": shapes[0]["features"], "gapShapes": shapes[1]["features"], "leftOut": left_out[:200],
        "refly": (folder / "refly" / "plan.json").is_file(),
    }  # fmt: skip


Words = tuple[str, list[str]]
"""The run folder that the command works on, and its command line."""
Builder = Callable[[Mapping[str, Any], Workspace], Words]
_BUDGET = re.compile(r"[0-9]{1,6}(\.[0-9]{1,3})?(s|m|min|h)")
_RULE = re.compile(r"[A-Za-z0-9<>=.,:%-]{1,80}")
_NUMBER = re.compile(r"[0-9]{1,9}")
_ADDRESS = re.compile(r"[A-Za-z0-9/._:\[\]?=,-]{1,120}")
_MOST_VEHICLES = 20
_WORD = re.compile(r"[a-z0-9-]{1,40}")


def command_of(kind: str, requested: Mapping[str, Any], workspace: Workspace, *, flights_allowed: bool) -> Words:
    """The command line of a button. Raises InputError: no such button, or a value of it is wrong."""
    builders: dict[str, Builder] = {**_BUILDERS, "fly": partial(_fly, flights_allowed=flights_allowed)}
    if kind not in builders:
        raise InputError(f"the page does not support the command {kind!r}")
    return builders[kind](requested, workspace)


def _plan(requested: Mapping[str, Any], workspace: Workspace) -> Words:
    scenario = workspace.path(text_in(requested, "scenario"))
    if not scenario.is_file():
        raise InputError(f"{scenario.name}: no such scenario; save it first")
    run = workspace.free_run(scenario.stem)
    words = ["plan", workspace.name(scenario), "-o", run.name]
    if requested.get("evaluations"):
        words += ["--evaluations", _match(requested, "evaluations", _NUMBER)]
    else:
        words += ["--budget", _match(requested, "budget", _BUDGET, default="30s")]
    for name, pattern in (("select", _RULE), ("seed", _NUMBER), ("vehicles", _NUMBER), ("autopilot", _WORD)):
        if requested.get(name):
            words += [f"--{name}", _match(requested, name, pattern)]
    return run.name, words


def _on_run(*command: str) -> Builder:
    def words(requested: Mapping[str, Any], workspace: Workspace) -> Words:
        run = _run(requested, workspace)
        return run, [command[0], run, *command[1:], *(["--force"] if requested.get("force") else [])]

    return words


def _select(requested: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(requested, workspace)
    return run, ["select", run, _match(requested, "rule", _RULE)]


def _edit(requested: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(requested, workspace)
    edited = workspace.free_run(f"{workspace.path(run).name}-edited")
    waypoints = workspace.path(text_in(requested, "waypoints"))
    return edited.name, ["edit", run, workspace.name(waypoints), "-o", edited.name]


def _export(requested: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(requested, workspace)
    file_format = _match(requested, "format", _WORD)
    suffix = {"wpml": ".kmz", "print": ".html", "litchi": ".csv", "mavproxy-fence": ".txt"}.get(
        file_format, f".{file_format}"
    )
    out = free_name(workspace.root, f"{workspace.path(run).name}-{file_format}", suffix)
    drone = ["--drone", _match(requested, "drone", _WORD)] if requested.get("drone") else []
    return run, ["export", run, "--format", file_format, *drone, "-o", out.name]


def _upload(requested: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(requested, workspace)
    return run, ["plan-upload", run, *_links(requested), *_sortie(requested)]


def _fly(requested: Mapping[str, Any], workspace: Workspace, *, flights_allowed: bool) -> Words:
    run = _run(requested, workspace)
    to = str(requested.get("to") or "mock:")
    words = ["fly", run, *_links(requested), *_sortie(requested)]
    if requested.get("mock_speed"):
        words += ["--mock-speed", _match(requested, "mock_speed", re.compile(r"[0-9]{1,3}(\.[0-9])?"))]
    words += [f"--{name}" for name in ("force", "resume") if requested.get(name)]
    if requested.get("sortie"):  # flights of one run that have vehicles of their own go on in parallel
        run = f"{run}/sortie-{_match(requested, 'sortie', _NUMBER)}"
    if requested.get("confirmed"):
        if not flights_allowed:
            raise InputError(
                "fly: this page flies only simulated vehicles; to fly real ones, start uavcover serve "
                "with --allow-flight"
            )
        if requested["confirmed"] != to:
            raise InputError(f"fly: to confirm, type the vehicle's address: {to}")
        words.append("--yes")
    return run, words


def _links(requested: Mapping[str, Any]) -> list[str]:
    """``--to`` for each vehicle: addresses with spaces between them, or one mock address that stands for all."""
    addresses = str(requested.get("to") or "mock:").split()
    count = int(_match(requested, "vehicles", _NUMBER, default="1"))
    if not 1 <= count <= _MOST_VEHICLES:
        raise InputError(f"vehicles: must be between 1 and {_MOST_VEHICLES}, not {count}")
    if count > 1 and len(addresses) == 1 and addresses[0].startswith("mock:"):
        addresses *= count
    if len(addresses) != count:
        raise InputError(
            f"to: specify {count} addresses, separated by spaces (one for each vehicle), not {len(addresses)}"
        )
    return [word for address in addresses for word in ("--to", _match({"to": address}, "to", _ADDRESS))]


def _check(requested: Mapping[str, Any], workspace: Workspace) -> Words:
    """The independent check of a run's mission file, against the scenario's elevation data, zones and limits."""
    run = _run(requested, workspace)
    folder = workspace.path(f"{run}/sortie-{_match(requested, 'sortie', _NUMBER)}" if requested.get("sortie") else run)
    mission = folder / "mission.plan"
    if not mission.is_file():
        raise InputError(f"{folder.name}: the run folder has no mission.plan; choose one of its sorties, or plan again")
    scenario = load_scenario(str(folder / "scenario.toml"))
    if not isinstance(scenario.terrain, RasterTerrain):
        raise InputError(f"{folder.name}: the scenario has no elevation data; the check requires it")
    ground, surface = terrain_source(scenario.terrain), surface_source(scenario.terrain)
    words = ["check", workspace.name(mission), "--vertical-datum", scenario.terrain.vertical_datum]
    words += ["--trust-dem"] if scenario.terrain.trust_heights else []
    for option, source in (("--dem", ground), ("--dsm", surface)):
        words += [word for file in (source.files if source is not None else ()) for word in (option, str(file))]
    words += ["--max-height", f"{scenario.transit_ceiling_agl_m:g}m", "--autopilot", scenario.vehicle.autopilot]
    for zone in scenario.no_fly:
        words += ["--no-fly", str(zone.file)] if zone.file else []
    return run, words


def _photos(requested: Mapping[str, Any], workspace: Workspace) -> Words:
    run = _run(requested, workspace)
    out = workspace.free_run(f"{workspace.path(run).name}-photos")
    photos = workspace.path(str(requested.get("photos") or f"{run}/{PHOTOS}"))
    if not photos.is_dir():
        raise InputError(f"photos: {photos.name} is not a folder in {workspace.root.name}; drop the photos on the page")
    return run, ["judge-photos", workspace.name(photos), "--scenario", run, "-o", out.name]


_BUILDERS: dict[str, Builder] = {
    "plan": _plan,
    "select": _select,
    "edit": _edit,
    "export": _export,
    "upload": _upload,
    "verify": _on_run("verify"),
    "gaps": _on_run("gaps"),
    "report": _on_run("report"),
    "photos": _photos,
    "check": _check,
}


def _run(requested: Mapping[str, Any], workspace: Workspace) -> str:
    path = workspace.path(text_in(requested, "run"))
    if not (path / "plan.json").is_file():
        raise InputError(f"{path.name}: this is not a run folder with a plan; plan first")
    return workspace.name(path)


def _sortie(requested: Mapping[str, Any]) -> list[str]:
    return ["--sortie", _match(requested, "sortie", _NUMBER)] if requested.get("sortie") else []


def text_in(requested: Mapping[str, Any], key: str) -> str:
    """A text of a request. Raises InputError: there is none."""
    value = requested.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{key}: the value is missing")
    return value


def _match(requested: Mapping[str, Any], key: str, pattern: re.Pattern[str], *, default: str = "") -> str:
    """A value as text; it never begins with a dash, so that it is no option."""
    value = str(requested.get(key) or default)
    if pattern.fullmatch(value) is None or value.startswith("-"):
        raise InputError(f"{key}: {value[:40]!r} is not a valid value")
    return value
