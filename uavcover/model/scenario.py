"""The scenario: everything a plan depends on, including the uncertainty of positions and ground."""

import dataclasses
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from mission_io.data_tables import (
    STRICT,
    require,
    require_between,
    require_lon_lat,
    require_not_negative,
    require_positive,
)
from uavcover.kernels.sight import MIDPOINT
from uavcover.model.area import Area, Terrain
from uavcover.model.limits import FlightLimits, Home, NoFly, Obstacles, Window, window_of
from uavcover.model.sensor import Sensor
from uavcover.model.vehicle import Fleet, Vehicle, Wind


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Largest errors that verification takes into account. If all are 0, it treats measurements as exact.

    Each value is a bound and not a standard deviation. It is constant during one observation.
    """

    __pydantic_config__: ClassVar = STRICT

    position_m: float = 0.0  # horizontal error of the recorded positions
    height_m: float = 0.0  # vertical error of the recorded positions
    # vertical error of the elevation data. The difference between the interpolated ground and the data is measured and
    # added.
    terrain_m: float = 0.0
    attitude_deg: float = 0.0  # error of the camera direction

    def __post_init__(self) -> None:
        require_not_negative(self, "position_m", "height_m", "terrain_m", "attitude_deg")
        require(self.attitude_deg < 90.0, f"attitude_deg: must be below 90 degrees, not {self.attitude_deg}")

    @property
    def vertical_m(self) -> float:
        """Largest error of a height above ground: vehicle and terrain together."""
        return self.height_m + self.terrain_m


PlannerAlgorithm = Literal["memetic", "local-search", "imodbo", "modbo", "nsga2", "moead", "lines", "contour-lines"]

Objective = Literal["mission-time", "flight-time", "length", "energy"]
InitialRoute = Literal["boustrophedon", "contour-lines", "greedy-set-cover", "set-cover"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Geodetic position of the local frame's origin, for areas given in metres."""

    __pydantic_config__: ClassVar = STRICT

    lat_deg: float  # latitude on WGS 84
    lon_deg: float  # longitude on WGS 84
    alt_amsl_m: float  # height above mean sea level

    def __post_init__(self) -> None:
        require_between(self, -90.0, 90.0, "lat_deg")
        require_between(self, -180.0, 180.0, "lon_deg")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerSettings:
    """Settings of the route search."""

    __pydantic_config__: ClassVar = STRICT

    # the search method. "memetic": IMODBO, then a local search from its routes and the baselines. "local-search": the
    # local search from sampled routes and the baselines. "imodbo", "modbo": the optimizers of the paper. "nsga2",
    # "moead": algorithms of pymoo, for comparison. "lines": the best of a scan of parallel lines. "contour-lines": the
    # best of a scan of lines along the contours. The last two require a sensor that observes along the path.
    algorithm: PlannerAlgorithm = "memetic"
    # direction of the algorithm "lines", clockwise from north; default: along the longer side of the area
    line_heading_deg: float | None = None
    # "swaths": parallel lines with their own spacing and heights, for sensors that observe along the path. "waypoints":
    # free points with activation genes, as in the paper.
    encoding: Literal["swaths", "waypoints"] = "swaths"
    population_size: int = 50  # number of members of the population
    # number of route evaluations if no budget is given. 50 proposals of the local search count as one.
    evaluations: int = 5000
    # largest number of waypoints of a route; default: no limit. For the encoding "waypoints", it is the number of nodes
    # (default: 60) and does not include waypoints that are inserted to follow the terrain.
    max_waypoints: int | None = None
    cell_size_m: float | None = None  # cell size of the search; default: twice the cell size of the area
    # order of the waypoints in the routes of an optimizer. "nearest-neighbour": the order of the paper. "improved": the
    # same order, shortened by 2-opt. The local search finds its own order.
    order: Literal["nearest-neighbour", "improved"] = "improved"
    # initial solutions and baselines, in addition to sampled routes. Default: "boustrophedon" for swaths and for a
    # local search along the path, "set-cover" for a local search with a sensor that observes at waypoints. With
    # objective = "energy", a local search along the path also uses "contour-lines".
    initial: tuple[InitialRoute, ...] | None = None
    seed: int = 1  # seed of the random numbers
    # number of parts into which the area is divided. The planner searches each part and then the seams. "auto": one
    # part for a small area, and more if the area has too many cells or if one part per flight gives a shorter mission.
    # Requires encoding = "swaths" and a local search. Default: 1.
    parts: int | Literal["auto"] = 1
    # the cost that the planner minimises in addition to coverage and the number of waypoints. "mission-time": time from
    # take-off to landing of all flights. "energy": battery use of all flights, in seconds of hovering
    # ([vehicle.power]). "flight-time": time of the route without transit. "length": length of the route. Default:
    # "mission-time" with a home, otherwise "length".
    objective: Objective | None = None
    # penalty for each metre of a waypoint above or below the middle of the height band (Eq. 7), in metres of path or in
    # seconds.
    band_deviation_price: float = 0.0
    # penalty for each waypoint, in metres of path or in seconds. Default: 1 % of the radius that the sensor observes
    # from the middle of the height band, or the time for it at cruise speed; 0 for a sensor that observes at waypoints.
    waypoint_price: float | None = None
    # rally points of the mission. "home": only home, at a safe height. "auto": additional landing positions if the
    # autopilot's own return to home is not safe. Or a list of [longitude, latitude] of your own landing positions,
    # which are added to home.
    rally: Literal["home", "auto"] | tuple[tuple[float, float], ...] = "home"

    def __post_init__(self) -> None:
        if not isinstance(self.rally, str):
            require(self.rally != (), 'rally: the list is empty; specify positions, "home" or "auto"')
            require_lon_lat(self.rally, "rally")
        require(self.population_size >= 20, f"population_size: must be at least 20, not {self.population_size}")
        require(
            self.evaluations >= self.population_size,
            f"evaluations: must be at least population_size = {self.population_size}, not {self.evaluations}",
        )
        require(
            self.line_heading_deg is None or self.algorithm == "lines",
            'line_heading_deg: requires algorithm = "lines"; the other algorithms choose the direction of every leg',
        )
        require(
            self.line_heading_deg is None or 0.0 <= self.line_heading_deg < 360.0,
            f"line_heading_deg: must be at least 0 and below 360 (clockwise from north), not {self.line_heading_deg}",
        )
        require(
            self.algorithm not in {"lines", "contour-lines"} or self.encoding == "swaths",
            f'encoding: "waypoints" does not apply to lines; remove this key with algorithm = "{self.algorithm}"',
        )
        require(self.capacity >= 2, f"max_waypoints: must be at least 2, not {self.max_waypoints}")
        require_not_negative(self, "band_deviation_price", "waypoint_price")
        require(self.seed >= 0, f"seed: must not be negative, but is {self.seed}")
        require(
            self.parts == "auto" or self.parts >= 1,
            f'parts: must be "auto" or at least 1, not {self.parts}',
        )
        require_positive(self, "cell_size_m")

    @property
    def capacity(self) -> int:
        """Most nodes of the "waypoints" encoding."""
        return 60 if self.max_waypoints is None else self.max_waypoints

    @property
    def most_waypoints(self) -> int | None:
        """Most waypoints that a route may have where lines are planned; None where any number will do."""
        return self.max_waypoints if self.encoding == "swaths" else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirements:
    """Requirements on a flown track for ``verify`` to pass."""

    __pydantic_config__: ClassVar = STRICT

    min_coverage_of_coverable: float = 0.95  # required coverage of the visible ground
    # required coverage of the visible ground for every error within [uncertainty]; default: no requirement
    min_sure_coverage_of_coverable: float | None = None
    # required fraction of the area that is in as many photos as forward_overlap and side_overlap require. Default: the
    # overlap is reported but not required.
    min_overlap_fraction: float | None = None
    # required number of observations of each cell; more than 1 requires a sensor that observes at waypoints
    looks: int = 1
    # smallest distance between two waypoints that count as separate observations; required if looks is greater than 1
    look_distance_m: float | None = None
    # largest distance of the flown track from the planned route; default: no limit
    max_deviation_m: float | None = None
    max_ground_speed_m_s: float | None = None  # largest ground speed on the planned route; default: no limit
    max_gap_s: float = 2.0  # longest time between two samples that are connected by a straight line
    # largest fraction of the route time without evidence. If it is exceeded, the flight is not proved.
    max_unobserved_fraction: float = 0.01
    # longest single interval without evidence between take-off and landing. If it is exceeded, the flight is not
    # proved.
    max_unobserved_gap_s: float = 10.0

    def __post_init__(self) -> None:
        require_between(self, 0.0, 1.0, "min_coverage_of_coverable", "min_sure_coverage_of_coverable")
        require_between(self, 0.0, 1.0, "max_unobserved_fraction")
        overlap = self.min_overlap_fraction
        require(
            overlap is None or 0.0 < overlap <= 1.0,
            f"min_overlap_fraction: must be above 0 and at most 1, not {overlap}",
        )
        require_between(self, 1, 20, "looks")
        require(
            self.looks == 1 or self.look_distance_m is not None,
            "look_distance_m: this key is required with more than one look, because closer waypoints count as one",
        )
        require(
            self.look_distance_m is None or (self.look_distance_m > 0.0 and self.looks > 1),
            "look_distance_m: must be greater than 0, and requires more than one look",
        )
        require_positive(self, "max_gap_s", "max_unobserved_gap_s", "max_deviation_m", "max_ground_speed_m_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A validated scenario: the sections of the TOML file."""

    __pydantic_config__: ClassVar = STRICT

    name: str  # short name for files and reports
    area: Area  # the area to cover
    terrain: Terrain  # the elevation data
    sensor: Sensor  # the sensor
    limits: FlightLimits  # the hard limits
    vehicle: Vehicle = field(default_factory=Vehicle)  # the vehicle
    # geodetic position of the local frame, for areas in metres; a geographic area needs none (default: its home)
    origin: Origin | None = None
    home: Home | None = None  # take-off and landing; needed for mission files
    planner: PlannerSettings = field(default_factory=PlannerSettings)  # settings of the route search
    select: str = "weighted:0.6,0.2,0.2"  # the rule that selects one route of the Pareto set
    requirements: Requirements = field(default_factory=Requirements)  # requirements on the flown track
    uncertainty: Uncertainty = field(default_factory=Uncertainty)  # errors of positions, ground and attitude
    obstacles: Obstacles = field(default_factory=Obstacles)  # obstacles on the ground
    no_fly: tuple[NoFly, ...] = ()  # zones that the vehicle must not enter on any part of the flight
    # earliest take-off and latest landing, such as ["2026-06-01T06:00Z", "2026-06-01T18:00Z"]. No-fly zones that are
    # inactive in this window do not count. Without a window, every zone counts.
    flight_window_utc: tuple[str, str] | None = None
    wind: Wind = field(default_factory=Wind)  # the wind the flight is planned for
    fleet: Fleet = field(default_factory=Fleet)  # number of vehicles, and their separation
    # the [[vehicle]] tables of different vehicles; empty if all are identical
    vehicles: tuple[Vehicle, ...] = ()
    description: str = ""  # one-line description

    def __post_init__(self) -> None:
        require(
            self.requirements.min_overlap_fraction is None or all(v.sensor is None for v in self.vehicles),
            "requirements.min_overlap_fraction: this key applies to a single camera; remove it if vehicles have "
            "their own sensors",
        )
        for number, vehicle in enumerate(self.vehicles):
            link, system_id = vehicle.link, vehicle.system_id
            if link is None or link.startswith("mock:") or self.has_launch_points:
                continue
            for other, before in enumerate(self.vehicles[:number]):
                require(
                    before.link != link or None not in (system_id, before.system_id),
                    f"vehicle.{number}.link: {link} is already used by vehicle.{other}; each vehicle needs its own "
                    "link, or a system_id",
                )
                require(
                    before.link != link or system_id != before.system_id,
                    f"vehicle.{number}.system_id: {system_id} at {link} is already used by vehicle.{other}",
                )
        self._require_fits(self.sensor, "sensor")
        for number, vehicle in enumerate(self.vehicles):
            if vehicle.sensor is not None:
                self._require_fits(vehicle.sensor, f"vehicle.{number}.sensor")
        if self.flight_window_utc is not None:
            window_of(*self.flight_window_utc, "flight_window_utc")
        require(
            len(self.vehicles) in (0, self.fleet.vehicles),
            f"fleet.vehicles: the value is {self.fleet.vehicles}, but there are {len(self.vehicles)} different "
            "[[vehicle]] tables",
        )
        require(
            bool(self.vehicles) or not self.fleet.one_at_a_time,
            "fleet.one_at_a_time: this key applies to different vehicles, or to one vehicle with launch points; add "
            "a [[vehicle]] for each vehicle, or a [[launch_point]]",
        )
        for number, vehicle in enumerate(self.vehicles or (self.vehicle,)):
            airspeed, which = vehicle.max_airspeed_m_s, f"vehicle.{number}" if self.vehicles else "vehicle"
            for key, speed_m_s in (("speed_m_s", self.wind.speed_m_s), ("most_m_s", self.wind.most_m_s or 0.0)):
                require(
                    speed_m_s == 0.0 or (airspeed is not None and airspeed > speed_m_s),
                    f"wind.{key}: {speed_m_s} m/s requires a larger {which}.max_airspeed_m_s than {airspeed or 'none'}",
                )
            ceiling_m, margin_m = self.transit_ceiling_agl_m, self.limits.height_margin_m
            require(
                self.home is None or vehicle.takeoff_height_m <= ceiling_m - margin_m,
                f"{which}.takeoff_height_m: must be at most limits.max_transit_height_agl_m = {ceiling_m} m less "
                f"height_margin_m = {margin_m} m, not {vehicle.takeoff_height_m} m",
            )
        require(
            self.planner.objective not in {"mission-time", "energy"} or self.home is not None,
            f'planner.objective: "{self.planner.objective}" requires a [home], where the mission starts',
        )
        if self.area.is_geographic:
            require(self.home is not None, "home: specify lat_deg and lon_deg of the take-off position")
            require(self.terrain.kind == "raster", "terrain.kind: an area in degrees requires raster terrain")
            require(self.home is None or self.home.lat_deg is not None, "home: specify lat_deg and lon_deg")
            for number, vehicle in enumerate(self.vehicles):
                which = f"launch_point.{number - 1}" if self.has_launch_points else f"vehicle.{number}.home"
                require(
                    vehicle.home is None or vehicle.home.lat_deg is not None, f"{which}: specify lat_deg and lon_deg"
                )
        else:
            require(
                self.terrain.kind != "raster" or self.origin is not None,
                "origin: raster terrain with an area in metres requires an [origin] for the local frame",
            )
            require(
                self.home is None or self.home.east_m is not None or self.origin is not None,
                "home: lat_deg and lon_deg require an origin; use east_m and north_m, or add an [origin]",
            )

    @property
    def has_launch_points(self) -> bool:
        """Whether its vehicles are a single one with several take-off positions, flown one at a time."""
        own = {dataclasses.replace(vehicle, home=None) for vehicle in self.vehicles}
        return self.fleet.one_at_a_time and len(own) == 1

    def _require_fits(self, sensor: Sensor, key: str) -> None:
        """Refuse a sensor that does not suit the limits, cells and requirements."""
        reach_m, range_m = sensor.reach_m, sensor.slant_range_m
        require(
            range_m is None or range_m > self.limits.min_height_agl_m,
            f"{key}.range_m: {range_m} m does not reach the ground from limits.min_height_agl_m = "
            f"{self.limits.min_height_agl_m} m",
        )
        require(
            not (self.obstacles.file or self.obstacles.prisms) or sensor.sight.line_of_sight != MIDPOINT,
            f'{key}.line_of_sight: with obstacles, this must be "ray", because "midpoint" tests only one point of the ray',
        )
        require(
            self.requirements.looks == 1 or not sensor.looks_along_path,
            f'requirements.looks: more than one look requires {key}.sensing = "at-waypoints"; along the path, use a '
            "frame camera's side_overlap",
        )
        require(
            self.requirements.min_overlap_fraction is None or sensor.requires_overlap,
            "requirements.min_overlap_fraction: this key requires a frame camera's forward_overlap and side_overlap; "
            "add them, or remove this key",
        )
        require(
            self.area.cell_size_m <= reach_m,
            f"area.cell_size_m: cells of {self.area.cell_size_m} m are larger than the reach of {key}, {reach_m} m",
        )

    @property
    def flight_window(self) -> Window | None:
        """Time from the earliest take-off to the latest landing; None where it may be flown at any time."""
        return None if self.flight_window_utc is None else window_of(*self.flight_window_utc, "flight_window_utc")

    @property
    def objective(self) -> Objective:
        """The cost that the planner minimises: ``planner.objective`` or its default."""
        return self.planner.objective or ("length" if self.home is None else "mission-time")

    @property
    def transit_ceiling_agl_m(self) -> float:
        """Largest height above ground in transit: the limit, or its default for missions over steep ground.

        The default is 30 m above the largest of: the top of the band, the take-off and return heights above home, and 20 m
        above the target height of transits.
        """
        limits, vehicle = self.limits, self.vehicle
        if limits.max_transit_height_agl_m is not None:
            return limits.max_transit_height_agl_m
        aim_m = limits.transit_clearance_m + limits.height_margin_m + 20.0
        return 30.0 + max(limits.max_height_agl_m, vehicle.takeoff_height_m, vehicle.return_height_m, aim_m)

    @property
    def planning_cell_size_m(self) -> float:
        """Cell size of the search: coarser than that of the evaluation grid."""
        return self.planner.cell_size_m if self.planner.cell_size_m is not None else 2.0 * self.area.cell_size_m
