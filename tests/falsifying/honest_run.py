"""Honest flights for the tests: a small scenario with a ground of its own, planned, flown by the mock vehicle and recorded.

The vehicle flies on a simulated clock, so a flight is the same every time and takes a few seconds.
"""

import dataclasses
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from mission_io.links.opening import LoggedLink
from mission_io.links.simulated import Conditions, SimulatedLink
from uavcover.flight.command import FlightOptions, record_flight
from uavcover.flight.compiled_flight import fly, upload
from uavcover.flight.connect import Connected, require_home
from uavcover.flight.monitor import open_vehicle
from uavcover.flight.orders import Orders
from uavcover.flight.resume import find_unfinished, save_rest
from uavcover.missions.flights import compile_flights
from uavcover.missions.mission_compiler import AUTOPILOTS, compile_mission
from uavcover.missions.objectives import judge_member
from uavcover.mock.behaviour import Settings
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.route import Plan, Route
from uavcover.model.track import FlightOutcome
from uavcover.model.vehicle import AutopilotName
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.planner.plan_files import save_plan
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.user import Unattended
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.site_maps import judging_map
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.gaps import Band, geotiff

FRAME = LocalFrame(36.51, -84.23, 412.0)
"""Latitude, longitude and height are unlike each other: what is swapped shows."""

NADIR = """
kind = "nadir-camera"
fov_deg = 70.0
range_m = 200.0
"""
WIDE_PHOTO = """
kind = "frame-camera"
fov_across_deg = 70.0
fov_along_deg = 20.0
range_m = 200.0
"""
SURVEY_CAMERA = """
kind = "frame-camera"
fov_across_deg = 70.0
fov_along_deg = 56.0
range_m = 300.0
mount = "stabilised"
forward_overlap = 0.75
side_overlap = 0.6
"""
"""Triggered by distance."""
STABILISED = NADIR + 'mount = "stabilised"\n'

_SCENARIO = """
name = "{name}"
{top}

[area]
polygon_east_north_m = [[0.0, 0.0], [300.0, 0.0], [300.0, 200.0], [0.0, 200.0]]
cell_size_m = 10.0

[origin]
lat_deg = {frame.lat_deg!r}
lon_deg = {frame.lon_deg!r}
alt_amsl_m = {frame.alt_amsl_m!r}

[terrain]
kind = "raster"
file = "dem.tif"
vertical_datum = "EGM96"

[home]
east_m = -60.0
north_m = 30.0

[sensor]
{sensor}

[limits]
min_height_agl_m = 40.0
max_height_agl_m = 120.0
height_margin_m = 8.0
transit_clearance_m = 25.0
{limits}

[vehicle]
{vehicle}

[planner]
algorithm = "imodbo"
evaluations = 60

{more}
"""


@dataclass(frozen=True, kw_only=True)
class Base:
    """What is flown.

    Attributes:
        name: of the scenario.
        sensor: the lines of its section.
        limits: more lines of its section.
        vehicle: the lines of its section.
        more: more sections.
        top: lines before the first section.
        lines: how many parallel lines cover the area.
        height_agl_m: at which height.
        autopilot: whose behaviour the mock vehicle shows.
    """

    name: str
    sensor: str = NADIR
    limits: str = ""
    vehicle: str = ""
    more: str = ""
    top: str = ""
    lines: int = 3
    height_agl_m: float = 80.0
    autopilot: AutopilotName = "ardupilot"


HILLS = Base(name="hills")
OBLIQUE = Base(name="wide picture", sensor=WIDE_PHOTO, autopilot="px4")
BARNS = Base(
    name="barns",
    more="".join(
        f'[[obstacles.prisms]]\nname = "barn {k}"\nheight_m = 45.0\nrings_east_north_m = '
        f"[[[{e}, {n}], [{e + 12.0}, {n}], [{e + 12.0}, {n + 8.0}], [{e}, {n + 8.0}]]]\n"
        for k, (e, n) in enumerate([(60.0, 60.0), (150.0, 120.0), (230.0, 40.0)])
    ),
)


SURVEY = Base(
    name="survey",
    sensor=SURVEY_CAMERA,
    lines=6,
    more="[requirements]\nmin_coverage_of_coverable = 0.9\nmin_overlap_fraction = 0.8\n",
)
DATED = Base(
    name="dated",
    top='flight_window_utc = ["2024-06-01T06:00Z", "2024-06-01T18:00Z"]',
    more=f"""
[[no_fly]]
name = "closed"
center_lon_lat_deg = [{FRAME.lon_deg + 150.0 / 89_400.0!r}, {FRAME.lat_deg + 100.0 / 111_000.0!r}]
radius_m = 60.0
from_utc = "2004-01-01T00:00Z"
until_utc = "2004-01-02T00:00Z"
""",
)
"""A no-fly zone in the middle of the area, which is in force on one day long ago."""
RESUMED = Base(name="resumed")
SORTIES = Base(name="sorties", vehicle="endurance_s = 195.0")
"""A route that takes several flights."""


def make_site(folder: Path, base: Base) -> Site:
    """Write the scenario and its ground into a folder, and load them."""
    folder.mkdir(parents=True, exist_ok=True)
    low_m, high_m, step_m = -900.0, 1300.0, 10.0
    axis = np.arange(low_m, high_m + 0.5 * step_m, step_m)
    east, north = np.meshgrid(axis, axis)
    up = 14.0 * np.sin(east / 90.0) * np.cos(north / 70.0) + 0.04 * east + 3.0
    positions = np.column_stack([east.ravel(), north.ravel(), up.ravel()])
    alts = FRAME.geodetic_from_enu(positions)[2].reshape(up.shape)
    ground = geotiff(FRAME, [Band("height", "m", alts)], east0_m=low_m, north0_m=low_m, up_m=0.0, step_m=step_m)
    (folder / "dem.tif").write_bytes(ground)
    text = _SCENARIO.format(
        name=base.name,
        frame=FRAME,
        sensor=base.sensor,
        limits=base.limits,
        vehicle=base.vehicle,
        more=base.more,
        top=base.top,
    )
    (folder / "scenario.toml").write_text(text)
    return load_site(folder / "scenario.toml")


def lines_over(site: Site, *, lines: int, height_agl_m: float) -> Plan:
    """Parallel lines over the area as a plan."""
    layout = regular_layout(angle_rad=0.0, lines=lines, height_agl_m=height_agl_m, inset=0.0, tolerance_m=10.0)
    route = fly_layout(site, layout)
    member = judge_member(judging_map(site), route, "lines", margin_m=0.0)
    return Plan(
        chosen=member, members=(member,), baselines=(), rule="none", rule_met=True, algorithm="lines", evaluations=0,
        wall_s=0.0,
    )  # fmt: skip


def save_lines(run: RunFolder, site: Site, base: Base) -> None:
    """Plan parallel lines, as sorties where endurance asks for it, and save them as ``uavcover plan`` does."""
    plan = lines_over(site, lines=base.lines, height_agl_m=base.height_agl_m)
    run.path.mkdir(parents=True, exist_ok=True)
    sorties = compile_flights(site, plan.chosen.route, autopilot=base.autopilot)
    single = sorties[0].compiled if len(sorties) == 1 else None
    save_plan(
        run, site, plan, compiled=single, autopilot=base.autopilot, seed=0, command=["plan"],
        sorties=() if single is not None else sorties,
    )  # fmt: skip


@dataclass(kw_only=True)
class Field:
    """A vehicle at home behind a simulated link, and whoever flies it.

    Attributes:
        site: where.
        autopilot: whose behaviour it shows.
        seed: of wind, noise and losses.
        loss: share of the datagrams that the link loses, each way.
        options: of the mock vehicle's configuration.
        vehicle_class: the mock vehicle, or one that does something otherwise.
    """

    site: Site
    autopilot: AutopilotName = "ardupilot"
    seed: int = 1
    loss: float = 0.0
    options: dict[str, Any] = field(default_factory=dict)
    vehicle_class: type[MockVehicle] = MockVehicle

    def __post_init__(self) -> None:
        vehicle = self.site.scenario.vehicle
        self.vehicle = self.vehicle_class(
            AUTOPILOTS[self.autopilot],
            require_home(self.site),
            MockConfig(
                **{
                    "settings": Settings.for_vehicle(vehicle),
                    "battery": BatteryData(endurance_s=6000.0),
                    **self.options,
                }
            ),
            ground=self._ground_alt_amsl_m,
            rng=np.random.default_rng(self.seed),
        )
        self.link = SimulatedLink(
            InMemoryPeer(self.vehicle), rng=Random(self.seed), conditions=Conditions(loss=self.loss, delay_s=0.002)
        )

    def _ground_alt_amsl_m(self, lat_deg: float, lon_deg: float) -> float:
        """Of the scenario: wherever the vehicle lands, it lands on that."""
        alt_amsl_m = self.site.ground_alt_amsl_m(lat_deg, lon_deg)
        assert alt_amsl_m is not None
        return alt_amsl_m

    @property
    def flown_s(self) -> float:
        """Vehicle time since it took off; negative before."""
        began = self.vehicle.took_off_at_s
        return -1.0 if began is None else self.vehicle.powered_s - began

    def fly(
        self, run: RunFolder, *, stop: Callable[[], int] = lambda: 0, pause: Callable[[], bool] = lambda: False
    ) -> FlightOutcome:
        """Upload the plan of a run folder, fly it from the ground, and keep the record there as ``uavcover fly`` does.

        Raises:
            uavcover.model.track.FlightFailedError: it did not end as it should.
        """
        route = read_planned(run)[1].route

        def begin(station: Connected, orders: Orders) -> FlightOutcome:
            compiled = compile_mission(self.site, route, autopilot=self.autopilot)
            upload(station.client, compiled)
            return fly(station, self.site, compiled, orders)

        return self.recorded(run, route, begin, stop=stop, pause=pause)

    def recorded(
        self, run: RunFolder, route: Route, begin: Callable[[Connected, Orders], FlightOutcome],
        *, stop: Callable[[], int] = lambda: 0, pause: Callable[[], bool] = lambda: False,
    ) -> FlightOutcome:  # fmt: skip
        """Let ``begin`` fly, and keep the record in the run folder."""
        link = LoggedLink(self.link)
        client, monitor = open_vehicle(link)
        monitor.listen_to(client.wait_for_vehicle().address)
        station = Connected(client, monitor, self.autopilot, link)
        return record_flight(
            run, self.site, route, Unattended(), station,
            lambda orders: begin(station, dataclasses.replace(orders, stop=stop, pause=pause)),
            options=FlightOptions(force=True),
        )[0]  # fmt: skip


def honest_run(folder: Path, base: Base) -> Path:
    """A run folder with a flight that passes, or with those of its sorties; ``folder`` is made."""
    site = make_site(folder / "scenario", base)
    run = RunFolder(folder / "run")
    save_lines(run, site, base)
    for flight in run.sorties() or [run]:
        Field(site=site, autopilot=base.autopilot).fly(flight)
    return run.path


def resumed_run(folder: Path, base: Base, *, stop_s: float) -> Path:
    """A run folder whose flight was stopped so long after take-off, returned, and was gone on with from the ground."""
    site = make_site(folder / "scenario", base)
    run = RunFolder(folder / "run")
    save_lines(run, site, base)
    field = Field(site=site, autopilot=base.autopilot)
    field.fly(run, stop=lambda: int(field.flown_s >= stop_s))
    unfinished = find_unfinished(run, site)
    unfinished.folder.path.mkdir()
    save_rest(unfinished, site, command=["fly", "--resume"])
    Field(site=site, autopilot=base.autopilot, seed=2).fly(unfinished.folder)
    return run.path


BASES = {
    "hills": HILLS,
    "wide picture": OBLIQUE,
    "slow": dataclasses.replace(HILLS, name="slow", vehicle="cruise_speed_m_s = 5.0"),
    "gimbal": dataclasses.replace(HILLS, name="gimbal", sensor=STABILISED, vehicle="cruise_speed_m_s = 6.0"),
    "dated": DATED,
    "barns": BARNS,
    "survey": SURVEY,
    "sorties": SORTIES,
    "resumed": RESUMED,
}
"""The flights that are falsified."""


def base_run(folder: Path, name: str) -> Path:
    """The run folder of one of ``BASES``, flown unless it is there."""
    noted = folder / "flown.txt"
    if not noted.is_file():
        shutil.rmtree(folder, ignore_errors=True)  # of a run that was broken off
        run = resumed_run(folder, RESUMED, stop_s=60.0) if name == "resumed" else honest_run(folder, BASES[name])
        noted.write_text(str(run.relative_to(folder)))
    return folder / noted.read_text()
