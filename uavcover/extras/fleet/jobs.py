"""The sorties of a fleet in flight: their vehicles, their times, and takeovers after losses."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from mission_io.model.plain_text import counted
from uavcover.errors import InfeasibleError, InputError
from uavcover.extras.fleet.tuning import FLEET
from uavcover.flight.connect import require_home
from uavcover.flight.resume import find_unfinished, save_part, save_rest, scenario_of_fleet
from uavcover.missions.fleet_schedule import Timeline, timeline_of
from uavcover.missions.mission_compiler import Sortie, compile_mission
from uavcover.model.route import Route
from uavcover.run.documents import TRACK, is_alike, read_planned
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site


def require_at_once(fleet: object, run: RunFolder) -> None:
    """Refuse several vehicles for flights that are planned one at a time.

    Args:
        fleet: of ``plan.json``.
        run: its folder.

    Raises:
        InputError: they are.
    """
    if isinstance(fleet, dict) and fleet.get("one_at_a_time", False):
        raise InputError(f"{run}: this plan flies one sortie at a time; use one --to, and --sortie N in this order")


class OnLoss(StrEnum):
    """Treatment of the unobserved cells of a lost vehicle."""

    SHARE = "share"
    GAPS = "gaps"


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A sortie to fly."""

    name: str  # its number, with a mark after it where it is the rest of a sortie that another vehicle began
    sortie: int  # the number of the planned sortie
    vehicle: int  # who flies it, from 1
    planned_s: float  # take-off, since the first take-off of all
    folder: RunFolder  # where its record goes
    site: Site  # the scenario on its ground
    route: Route  # its waypoints
    timeline: Timeline  # as planned
    # fraction of a full battery, in the worst of the winds that it is planned for; None without an endurance
    battery_used: float | None = None
    is_rest: bool = False  # whether it is the rest of a sortie that another vehicle began

    def of(self, vehicle: int, *, planned_s: float) -> "Job":
        """The same for another vehicle, at another time."""
        return replace(self, vehicle=vehicle, planned_s=planned_s)


def planned_jobs(run: RunFolder, vehicles: int) -> list[Job]:
    """All sorties of a plan, in the order of their take-offs; every leg is checked.

    Raises:
        InputError: the plan is for another number of vehicles, or cannot be read.
        InfeasibleError: a leg exceeds a limit.
    """
    document = run.read_json("plan.json", made_by="uavcover plan")
    fleet, rows = document.get("fleet"), document.get("sorties")
    require_at_once(fleet, run)
    flying = len(fleet.get("by_vehicle", [])) if isinstance(fleet, dict) else 1
    alike = not isinstance(fleet, dict) or fleet.get("alike", True)
    if not alike and isinstance(fleet, dict) and isinstance(fleet.get("vehicles"), int):
        flying = fleet["vehicles"]  # each has its own link, also one that stays on the ground
    if flying != vehicles or not isinstance(rows, list) or not rows:
        planned_for = fleet.get("vehicles", 0) if isinstance(fleet, dict) else 1
        more = (
            "; more vehicles would not finish sooner"
            if planned_for >= vehicles > flying
            else f", or plan again with: uavcover plan SCENARIO --vehicles {vehicles}"
        )
        raise InputError(
            f"{run}: the plan is for {counted(flying, 'vehicle')}, but --to is given {counted(vehicles, 'time')}; "
            f"use --to {'once' if flying == 1 else f'{flying} times'}{more}"
        )
    try:
        requested = [(int(row["number"]), int(row["vehicle"]), float(row["takeoff_s"])) for row in rows]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{run.file('plan.json')}: cannot read the key sorties ({type(error).__name__}: {error}); create the "
            "plan again with: uavcover plan"
        ) from error
    jobs = [_planned_job(run, number, vehicle, takeoff_s) for number, vehicle, takeoff_s in requested]
    flyers, all_of_them = {job.vehicle for job in jobs}, set(range(1, vehicles + 1))
    if flyers != all_of_them and (alike or not flyers < all_of_them):
        raise InputError(f"{run.file('plan.json')}: the sorties' vehicles must be 1 to {vehicles}; plan again")
    return sorted(jobs, key=lambda job: (job.planned_s, job.sortie))


def _planned_job(run: RunFolder, number: int, vehicle: int, takeoff_s: float) -> Job:
    folder = run.flight(number)
    site, planned = read_planned(folder)
    require_home(site)
    timeline, used = _planned_use(site, planned.route)
    return Job(f"{number:03d}", number, vehicle, takeoff_s, folder, site, planned.route, timeline, used)


def _planned_use(site: Site, route: Route) -> tuple[Timeline, float | None]:
    """The planned times of a sortie, and the fraction of a battery that it uses.

    Raises:
        InfeasibleError: a leg exceeds a limit, or the flight takes too long.
    """
    autopilot = site.scenario.vehicle.autopilot
    compiled = compile_mission(site, route)
    timeline = timeline_of(site, Sortie(0, len(route) - 1, route, compiled), autopilot=autopilot)
    return timeline, compiled.battery_used


def left_of(job: Job) -> Route | None:
    """The unflown part of the route of a flight that ended early; None when nothing is left.

    Raises:
        InputError: what was flown cannot be read.
    """
    if not job.folder.file(TRACK).exists():
        return job.route
    unfinished = find_unfinished(_sortie_of(job), job.site)
    return None if unfinished.complete else unfinished.route


def rest_of(job: Job, site: Site, command: Sequence[str]) -> Job:
    """The unflown part of a flight that ended early, as a job for the vehicle of a site.

    Its plan is written into a folder inside that of the sortie, as ``fly --resume`` does, also for the rest of a rest.

    Raises:
        InfeasibleError: there is no checked way to it, or it takes too long for one flight.
    """
    if not job.folder.file(TRACK).exists():
        return replace(for_another(job, site, command), name=f"{job.name}+")
    unfinished = find_unfinished(_sortie_of(job), job.site)
    timeline, used = _planned_use(site, unfinished.route)
    unfinished.folder.path.mkdir(exist_ok=True)
    save_rest(unfinished, site, command=command)
    return replace(
        job, name=f"{job.name}+", folder=unfinished.folder, site=site, route=unfinished.route, timeline=timeline,
        battery_used=used, is_rest=True,
    )  # fmt: skip


def _sortie_of(job: Job) -> RunFolder:
    return RunFolder(job.folder.path.parent) if job.is_rest else job.folder


def is_for(job: Job, site: Site) -> bool:
    """Whether a job was planned for an identical vehicle with the same home."""
    return is_alike(job.site.scenario, site.scenario)


def for_another(job: Job, site: Site, command: Sequence[str]) -> Job:
    """An unflown job for the vehicle of a site, every leg checked; planned anew where the vehicles differ.

    Raises:
        InfeasibleError: a leg exceeds a limit of that vehicle, or the flight takes it too long.
    """
    if is_for(job, site):
        return job
    timeline, used = _planned_use(site, job.route)
    save_part(
        job.folder,
        site,
        job.route,
        "another party took control",
        command=command,
        scenario_sha256=scenario_of_fleet(job.folder),
    )
    return replace(job, site=site, timeline=timeline, battery_used=used)


def time_for(job: Job, route: Route, site: Site) -> float:
    """Time of a site's vehicle for a job or a part; as planned where it is like the job's own.

    Raises:
        InfeasibleError: that vehicle has another sensor, a leg exceeds a limit of it, or the flight takes it too long.
    """
    if job.site.scenario.sensor != site.scenario.sensor:
        raise InfeasibleError("it requires a sensor that the remaining vehicles do not have")
    return job.timeline.duration_s if is_for(job, site) else _planned_use(site, route)[0].duration_s


def require_gain(job: Job, rest: Job) -> None:
    """Refuse the rest of a flight that made no progress on a full battery: another one would repeat it.

    Raises:
        InfeasibleError: barely less is left than the flight had to fly.
    """
    if len(rest.route) >= len(job.route) and rest.route.length_m > job.route.length_m - FLEET.least_gain_m:
        raise InfeasibleError("one battery is enough only for the transits")


@dataclass(slots=True)
class Queues:
    """The sorties that no vehicle has begun; its methods may be called from several threads."""

    vehicles: set[int]  # those that can fly
    _waiting: list[Job] = field(default_factory=list)
    _busy: set[int] = field(default_factory=set)
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def add(self, job: Job) -> None:
        """A sortie that waits."""
        with self._lock:
            self._waiting.append(job)
            self._waiting.sort(key=lambda each: (each.planned_s, each.name))

    def take(self, vehicle: int) -> Job | None:
        """The next sortie of a vehicle, which is busy from here on; None when it has none now."""
        with self._lock:
            job = next((job for job in self._waiting if job.vehicle == vehicle), None)
            if job is not None:
                self._waiting.remove(job)
                self._busy.add(vehicle)
            return job

    def done(self, vehicle: int) -> None:
        """A vehicle's sortie is over."""
        with self._lock:
            self._busy.discard(vehicle)

    def give_up(self, vehicle: int) -> list[Job]:
        """A vehicle that flies no more; returns the sorties that it would have flown."""
        with self._lock:
            self.vehicles.discard(vehicle)
            left = [job for job in self._waiting if job.vehicle == vehicle]
            self._waiting = [job for job in self._waiting if job.vehicle != vehicle]
            return left

    def of(self, vehicle: int) -> list[Job]:
        """The sorties that wait for a vehicle."""
        with self._lock:
            return [job for job in self._waiting if job.vehicle == vehicle]

    @property
    def work_is_left(self) -> bool:
        """Whether a sortie is flown, or waits for a vehicle."""
        with self._lock:
            return bool(self._busy or self._waiting)

    def work_may_come(self, vehicle: int) -> bool:
        """Whether a vehicle without a sortie may get one: another one may still be lost."""
        with self._lock:
            return vehicle in self.vehicles and bool((self._busy - {vehicle}) or self._waiting)
