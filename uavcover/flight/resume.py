"""Going on with a flight that ended before its plan: what is left of it."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.flight.tuning import RESUME
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.mission_files import compile_plan
from uavcover.missions.objectives import judge_member
from uavcover.model.route import Plan, Route
from uavcover.model.track import Track
from uavcover.planner.plan_files import save_plan
from uavcover.run.documents import (
    LINK,
    TRACK,
    PlannedDocument,
    flights_of,
    next_folder,
    read_plan_document,
    track_sha256,
)
from uavcover.run.folder import RunFolder
from uavcover.run.provenance import note_in_run, read_record
from uavcover.run.track_file import read_track
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map

# Which planned waypoints a track passed, where it left its route, and what remains to be flown.
#
# All of it is judged from the track alone.


class Passage:
    """Counts the planned waypoints that were passed, from the vehicle's reports and its position.

    A waypoint counts when the vehicle goes on from it to the very next one, or comes near it while it says that it flies to it
    or to a later one; the last one also when the vehicle is near it as it goes on to something else. A jump over waypoints, as
    when another ground station sets the current item, passes none of them.

    Args:
        waypoints_m: (n, 3) ENU, the planned waypoints.
        radius_m: how near is near.

    Attributes:
        reached: number of waypoints passed, counted from the first.
        number: the waypoint that was flown to at the last update; -1 for none.
    """

    def __init__(self, waypoints_m: FloatArray, *, radius_m: float) -> None:
        self._waypoints_m, self._near_m = waypoints_m, RESUME.near_radii * radius_m
        self._before_m: FloatArray | None = None
        self.reached, self.number = 0, -1

    @property
    def complete(self) -> bool:
        """Whether all were passed."""
        return self.reached >= len(self._waypoints_m)

    def take(self, number: int, place_m: FloatArray) -> None:
        """Look at one moment.

        Args:
            number: of the planned waypoint that is flown to; -1 for none.
            place_m: (3,) ENU, where the vehicle is.
        """
        before, self.number = self.number, number
        if before == self.reached and number == self.reached + 1:
            self.reached += 1
        last = len(self._waypoints_m) - 1
        heading = last if number < 0 and before == last else number
        while self.reached <= min(heading, last) and self._near(place_m):
            self.reached += 1
        self._before_m = np.array(place_m, dtype=float)

    def believe(self, count: int) -> None:
        """Count the first ``count`` waypoints as passed, as after a silence."""
        self.reached = max(self.reached, min(count, len(self._waypoints_m)))

    def _near(self, place_m: FloatArray) -> bool:
        """Whether the straight line since the last look comes near the next waypoint."""
        start_m = place_m if self._before_m is None else self._before_m
        way_m, waypoint_m = place_m - start_m, self._waypoints_m[self.reached]
        length2 = float(way_m @ way_m)
        share = 0.0 if length2 == 0.0 else min(1.0, max(0.0, float((waypoint_m - start_m) @ way_m) / length2))
        return float(np.linalg.norm(start_m + share * way_m - waypoint_m)) <= self._near_m


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """The end of what was flown of a planned route."""

    waypoint: int  # number of the first planned waypoint that was not passed; the number of waypoints when all were
    flown_m: float  # distance flown along the leg to it before the vehicle left it; 0 when that leg was not begun


def find_resume_point(track: Track, waypoints_m: FloatArray, *, radius_m: float) -> ResumePoint:
    """Where a track left its route.

    The vehicle's own count is believed where it begins, where it goes on one by one, and over a time that was not recorded; a
    jump passes nothing (see :class:`~uavcover.flight.resume.Passage`).

    Args:
        track: what was flown; its waypoint numbers are those of the route.
        waypoints_m: (n, 3) ENU, the planned route.
        radius_m: the vehicle's acceptance radius.
    """
    passage = Passage(waypoints_m, radius_m=radius_m)
    numbers, begun, begun_at = track.current_waypoint.tolist(), False, 0
    gaps = np.diff(track.time_s, prepend=track.time_s[:1]) > RESUME.unseen_s
    for row, (number, place_m) in enumerate(zip(numbers, track.enu_m, strict=True)):
        before = passage.reached
        if gaps[row] or (number >= 0 and not begun):
            passage.believe(number)
            begun = True
        passage.take(number, place_m)
        if passage.reached != before:
            begun_at = row
    flown_m = 0.0
    if 0 < passage.reached < len(waypoints_m):
        rows = slice(begun_at, None)
        leg = waypoints_m[passage.reached - 1 : passage.reached + 1]
        on_leg = (track.current_waypoint[rows] == passage.reached) & ~gaps[rows]
        flown_m = _along_m(track.enu_m[rows], on_leg, leg, corridor_m=RESUME.corridor_radii * radius_m)
    return ResumePoint(passage.reached, flown_m)


def remaining_route(
    waypoints_m: FloatArray, broken: ResumePoint, *, radius_m: float, sees_along_legs: bool
) -> FloatArray:
    """(k, 3) ENU: what is left of a planned route.

    A sensor that looks along the path has to fly the rest of the leg that was left, too: the route begins on that leg, a
    little before the place where it was left, because a vehicle cuts its first corner. The leg was checked at its full length
    and so was every part of it.

    Args:
        waypoints_m: (n, 3) ENU, the planned route.
        broken: where it was left.
        radius_m: the vehicle's acceptance radius.
        sees_along_legs: whether the sensor looks between the waypoints, too.
    """
    left = waypoints_m[broken.waypoint :]
    if not sees_along_legs or broken.waypoint == 0 or len(left) == 0:
        return left.copy()
    begin, end = waypoints_m[broken.waypoint - 1], waypoints_m[broken.waypoint]
    length_m = float(np.linalg.norm(end - begin))
    again_m = max(0.0, broken.flown_m - RESUME.overlap_radii * radius_m - RESUME.overlap_m)
    entry = begin if length_m == 0.0 else begin + min(1.0, again_m / length_m) * (end - begin)
    return np.vstack([entry, left])


def along_leg_m(place_m: FloatArray, leg_m: FloatArray) -> tuple[float, float]:
    """Distance of a (3,) position along a (2, 3) leg, and aside of it, in metres."""
    along = leg_m[1] - leg_m[0]
    length_m = float(np.linalg.norm(along))
    if length_m == 0.0:
        return 0.0, float(np.linalg.norm(place_m - leg_m[0]))
    flown_m = min(length_m, max(0.0, float((place_m - leg_m[0]) @ along) / length_m))
    return flown_m, float(np.linalg.norm(place_m - leg_m[0] - flown_m / length_m * along))


def _along_m(places_m: FloatArray, on_leg: NDArray[np.bool_], leg_m: FloatArray, *, corridor_m: float) -> float:
    """Length of the leg that the positions follow without leaving it, from the first one on it."""
    flown_m, begun = 0.0, False
    for place_m, on in zip(places_m, on_leg.tolist(), strict=True):
        along_m, aside_m = along_leg_m(place_m, leg_m)
        if not on or aside_m > corridor_m:
            if begun:
                break
            continue
        begun = True
        flown_m = max(flown_m, along_m)
    return flown_m


@dataclass(frozen=True, slots=True, eq=False)
class Unfinished:
    """A flight that left something of its plan."""

    flown: RunFolder  # folder of the latest flight: the run itself, or of a flight that resumed it
    planned: PlannedDocument  # what that flight was to fly
    track: Track  # what it flew
    broken: ResumePoint  # where it left its route
    route: Route  # what is left
    folder: RunFolder  # where the flight that goes on is kept

    @property
    def complete(self) -> bool:
        """Whether nothing is left."""
        return len(self.route) == 0


def find_unfinished(run: RunFolder, site: Site) -> Unfinished:
    """The unflown rest of a run's latest flight. Raises InputError: nothing was flown, or what was cannot be read."""
    run.existing(TRACK, made_by="uavcover fly (without --resume)")
    latest = flights_of(run)[-1]
    planned = read_plan_document(
        latest.read_json("plan.json", made_by="uavcover plan"), source=str(latest.file("plan.json"))
    )
    track = read_track(latest.file(TRACK))
    radius_m = site.scenario.vehicle.acceptance_radius_m
    broken = find_resume_point(track, planned.route.waypoints_m, radius_m=radius_m)
    left = remaining_route(
        planned.route.waypoints_m, broken, radius_m=radius_m,
        sees_along_legs=site.scenario.sensor.looks_along_path,
    )  # fmt: skip
    return Unfinished(latest, planned, track, broken, Route(left), next_folder(run))


def took_off_s(run: RunFolder) -> float | None:
    """Take-off in vehicle time of the flight whose gaps a run closes; none without such a flight.

    Raises:
        InputError: its track cannot be read.
    """
    before = RunFolder(run.path.resolve().parent)
    if not (before.file("plan.json").is_file() and before.file(TRACK).is_file()):
        return None
    return float(read_track(flights_of(before)[-1].file(TRACK)).time_s[0])


def save_rest(unfinished: Unfinished, site: Site, *, command: Sequence[str]) -> None:
    """Write the rest's plan and mission from home into its folder, and the flight that it continues.

    Raises:
        InfeasibleError: there is no checked way to it.
    """
    save_part(
        unfinished.folder, site, unfinished.route, "resumed", command=command,
        scenario_sha256=scenario_of_fleet(unfinished.flown),
    )  # fmt: skip
    note_in_run(unfinished.folder, LINK, {"track_sha256": track_sha256(unfinished.flown.file(TRACK))})


def save_part(
    folder: RunFolder, site: Site, route: Route, made_by: str, *, command: Sequence[str], scenario_sha256: str | None
) -> None:
    """Write the plan of a part of a route, with its mission from home, into a folder.

    Args:
        folder: where to.
        site: of the vehicle that flies it.
        route: the part.
        made_by: what its plan calls its algorithm.
        command: the command line.
        scenario_sha256: as :func:`scenario_of_fleet`.

    Raises:
        InfeasibleError: there is no checked way to it.
    """
    started = time.monotonic()
    compiled = compile_plan(site, route)
    member = judge_member(judging_map(site), route, made_by, margin_m=site.scenario.limits.height_margin_m)
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule=made_by, rule_met=True, algorithm=made_by,
        evaluations=0, wall_s=time.monotonic() - started,
    )  # fmt: skip
    save_plan(
        folder, site, plan, compiled=compiled, autopilot=site.scenario.vehicle.autopilot,
        seed=site.scenario.planner.seed, command=command, scenario_sha256=scenario_sha256,
    )  # fmt: skip


def scenario_of_fleet(sortie: RunFolder) -> str | None:
    """SHA-256 of the fleet's scenario, for a sortie of a vehicle unlike the others; none for other plans."""
    record = read_record(sortie)
    asked = None if record.inputs is None else record.inputs.get("scenario")
    return asked if asked != record.files.get("scenario.toml") else None
