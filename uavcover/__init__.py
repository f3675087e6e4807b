"""Plan UAV flights that cover rugged terrain, fly them, and verify the coverage.

The whole chain, on a run folder that every ``uavcover`` command reads, too::

    import uavcover as uc

    site = uc.load_site("jacksboro")
    plan = uc.plan(site, out="RUN", evaluations=40)
    with uc.connect("mock:", site) as vehicle:
        uc.upload(vehicle, "RUN")
        track = uc.fly(vehicle, "RUN")
    verdict = uc.verify("RUN")
    gaps = uc.find_gaps("RUN")
    uc.write_report("RUN")

Each function does the same as the command of its name, with the same checks and the same run folder, so you can mix both. See
docs/reference/python_api.md.

The names in ``__all__`` are public; everything else may change. Names and stages are loaded on first use: planning loads no mock
vehicle and no recording.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uavcover.run.user import Unattended, User

if TYPE_CHECKING:
    from uavcover.errors import InfeasibleError, InputError, UavcoverError, VehicleError
    from uavcover.flight.command import FlightOptions
    from uavcover.flight.connect import Connected, VehicleLink, connect
    from uavcover.missions.mission_compiler import CompiledMission
    from uavcover.model.route import Plan, Route
    from uavcover.model.track import Track
    from uavcover.model.vehicle import AutopilotName
    from uavcover.planner.close_gaps import GapMission
    from uavcover.report.page import write_report
    from uavcover.scenario.site import Site, load_site
    from uavcover.verification.verify import Verdict

__all__ = [
    "FlightOptions",
    "InfeasibleError",
    "InputError",
    "Plan",
    "Route",
    "Site",
    "Track",
    "UavcoverError",
    "VehicleError",
    "VehicleLink",
    "Verdict",
    "compile_mission",
    "connect",
    "find_gaps",
    "fly",
    "load_site",
    "plan",
    "select",
    "upload",
    "verify",
    "verify_track",
    "write_report",
]

BEGUN_S = time.monotonic()
"""Start of this process, from which the time budget of a command counts."""

_MODULES = {
    "uavcover.errors": ("InfeasibleError", "InputError", "UavcoverError", "VehicleError"),
    "uavcover.verification.verify": ("Verdict",),
    "uavcover.model.route": ("Plan", "Route"),
    "uavcover.model.track": ("Track",),
    "uavcover.report.page": ("write_report",),
    "uavcover.flight.command": ("FlightOptions",),
    "uavcover.flight.connect": ("VehicleLink", "connect"),
    "uavcover.scenario.site": ("Site", "load_site"),
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """The public names, each loaded on first use."""
    for module, names in _MODULES.items():
        if name in names:
            value = getattr(import_module(module), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


UNATTENDED = Unattended()


def plan(
    site: "Site",
    *,
    out: str | Path,
    evaluations: int | None = None,
    budget_s: float | None = None,
    seed: int | None = None,
    algorithm: str | type | None = None,
    select: str | None = None,
    force: bool = False,
    user: User = UNATTENDED,
) -> "Plan":
    """Plan a route that observes the area, and write the run folder with its mission files, as ``uavcover plan`` does.

    Args:
        site: the scenario on its ground.
        out: the run folder.
        evaluations: of the search; equal seed and evaluations give an equal plan. Default: the scenario's.
        budget_s: search this long instead.
        seed: of every random number. Default: the scenario's.
        algorithm: a name, ``module:Class``, or a class with ``ask`` and ``tell``. Default: the scenario's.
        select: the rule by which one route of the Pareto set is chosen. Default: the scenario's.
        force: whether to replace an existing plan with all its files.
        user: receives messages, and may stop the search.

    Returns:
        The Pareto set and the chosen route; ``rule_met`` states whether the rule was met.

    Raises:
        InfeasibleError: no route keeps the limits, or the chosen one has no checked mission.
        OutputError: the folder already contains a plan.
    """
    from uavcover.planner.command import PlanRequest, plan_into

    request = PlanRequest(
        scenario=site, folder=Path(out), command=sys.argv, force=force, seed=seed, evaluations=evaluations,
        budget_s=budget_s, algorithm=algorithm, select=select,
    )  # fmt: skip
    return replace(plan_into(request, user, check_site=lambda _: None).plan, folder=str(out))


def select(run: str | Path, rule: str, *, force: bool = False) -> "Plan":
    """Choose another route of the Pareto set of a run folder, and write its mission files, as ``uavcover select`` does.

    Args:
        run: the run folder.
        rule: see :mod:`uavcover.planner.selection_rule`.
        force: even if the previous route was flown; it is kept in its own folder.
    """
    from uavcover.planner.command import choose
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import RunFolder, flown_in

    folder = RunFolder(run)
    site, _ = read_planned(folder)
    with folder.reserved(flown_in(folder), force=force):
        plan = choose(folder, site, rule, autopilot=site.scenario.vehicle.autopilot, command=sys.argv)[0]
    return replace(plan, folder=str(run))


def compile_mission(
    site: "Site", route: "Plan | Route", *, autopilot: "AutopilotName | None" = None
) -> "CompiledMission":
    """The mission, fence and rally points of a route, every leg checked at its full length.

    Args:
        site: the scenario on its ground.
        route: a route, or a plan, whose chosen route is compiled.
        autopilot: the autopilot. Default: the scenario's.

    Raises:
        InfeasibleError: a leg or a transit exceeds a hard limit; names it, the position and the excess.
    """
    from uavcover.missions.mission_compiler import compile_mission
    from uavcover.model.route import Plan

    return compile_mission(site, route.chosen.route if isinstance(route, Plan) else route, autopilot=autopilot)


def upload(vehicle: "Connected", run: str | Path, *, in_flight: bool = False, user: User = UNATTENDED) -> bool:
    """Upload the mission, fence and rally points of a run, read each back and compare; writes ``upload.json``.

    Returns:
        Whether the vehicle holds the intended lists.

    Raises:
        VehicleError: the vehicle is not a multirotor, or not at the planned home; nothing was sent.
        mission_io.MissionIoError: the vehicle refused or fell silent; states what it holds now.
    """
    from uavcover.flight.compiled_flight import send_and_compare
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import RunFolder

    folder = RunFolder(run)
    site, planned = read_planned(folder)
    with folder.reserved((), force=True):
        document = send_and_compare(folder, site, planned.route, vehicle, user, in_flight=in_flight)
    return bool(document["passed"])


def fly(
    vehicle: "Connected", run: str | Path, *, options: "FlightOptions | None" = None, user: User = UNATTENDED
) -> "Track":
    """Fly the mission that the vehicle holds, and keep the record in the run folder, as ``uavcover fly`` does.

    Args:
        vehicle: connected, on the ground.
        run: the run folder whose mission it holds.
        options: ``confirmed=True`` arms a real vehicle.
        user: receives messages, and may stop or pause the flight. Without one, Ctrl-C leaves the vehicle as it is, possibly in
            the air.

    Returns:
        The flown track, as in ``track.csv``.

    Raises:
        FlightFailedError: the flight did not end as planned; the run folder contains the record.
        OutputError: the folder already contains a flight; ``force=True`` replaces it.
    """
    from uavcover.flight.command import USUAL_FLIGHT, fly_connected, refuse_older_flight
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import FLIGHT_FILES, RunFolder
    from uavcover.run.track_file import read_track

    options = USUAL_FLIGHT if options is None else options
    folder = RunFolder(run)
    site, planned = read_planned(folder)
    refuse_older_flight(folder, options)
    with folder.reserved(FLIGHT_FILES, force=options.force):
        fly_connected(folder, site, planned.route, vehicle, user, options)
    return read_track(folder.file("track.csv"))


def verify(
    run: str | Path, *, logs: Sequence[str | Path] = (), accepted: Sequence[str] = (), user: User = UNATTENDED
) -> "Verdict":
    """Judge the flight of a run folder from its own track, or from other logs, and write ``verification.json``.

    Args:
        run: the run folder.
        logs: ``.csv``, ``.rrd``, ``.bin``, ``.tlog``, ``.ulg`` or ``.gpx``. Default: the run's tracks.
        accepted: accepted changes since planning or flight: "scenario", "terrain", ...
        user: receives messages.

    Raises:
        InputError: a log cannot be read, or something changed since planning or flight and was not accepted.
    """
    from uavcover.run.folder import RunFolder
    from uavcover.verification.command import verify_run

    return verify_run(RunFolder(run), user, command=sys.argv, logs=[Path(log) for log in logs], accepted=accepted)[0]


def verify_track(site: "Site", track: "Track", plan: "Plan | None" = None) -> "Verdict":
    """Judge a track in memory; nothing is written, and nothing proves that it is the recorded track.

    Args:
        site: the scenario on its ground.
        track: the flown track.
        plan: its plan, for the deviation and the planned coverage.
    """
    from uavcover.sensing.site_maps import judging_map
    from uavcover.verification.flown_route import PlannedRoute
    from uavcover.verification.verify import FlownTrack, verify_flight

    chosen = None if plan is None else plan.chosen
    planned = None if chosen is None else PlannedRoute(chosen.route.waypoints_m, chosen.metrics.coverage_fraction)
    return verify_flight(site, judging_map(site), [FlownTrack(track, planned)])


def find_gaps(
    run: str | Path,
    *,
    target: float | None = None,
    min_area_m2: float = 0.0,
    force: bool = False,
    user: User = UNATTENDED,
) -> "GapMission | None":
    """Group the unobserved cells of a run's flight and plan the mission that observes them, as ``uavcover gaps`` does.

    Args:
        run: the run folder of a flight.
        target: fraction of the visible ground that is enough, 0..1. Default: everything.
        min_area_m2: smaller gaps remain open.
        force: whether to replace an older gap mission and its flight.
        user: receives messages.

    Returns:
        The mission, with its own run folder ``gaps`` inside the run's; None without gaps to close.
    """
    from uavcover.planner.close_gaps import GapRequest, close_gaps
    from uavcover.run.folder import RunFolder

    request = GapRequest(target=target, min_area_m2=min_area_m2, force=force)
    return close_gaps(RunFolder(run), user, request, command=sys.argv)[0]
