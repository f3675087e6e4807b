"""The scenario: everything a plan depends on, including the uncertainty of positions and ground."""

import dataclasses
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from uavcover.kernels.sight import MIDPOINT
from uavcover.model.active_times import Window, window_of
from uavcover.model.area import Area
from uavcover.model.fleet import Fleet
from uavcover.model.home import Home
from uavcover.model.limits import FlightLimits
from uavcover.model.no_fly import NoFly
from uavcover.model.obstacles import Obstacles
from uavcover.model.sensor import Sensor
from uavcover.model.terrain import Terrain
from uavcover.model.value_checks import STRICT, require, require_not_negative, require_positive
from uavcover.model.vehicle import Vehicle, Wind


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Largest errors that a verdict has to withstand. With all of them 0, measurements are taken as exact.

    Each is a bound, not a standard deviation, and constant over the rays of one observation.

    Attributes:
        position_m: horizontal error of the flown positions.
        height_m: vertical error of the flown positions.
        terrain_m: vertical error of the elevation data against the true ground. The difference between the ground in use and
            the data is measured and added.
        attitude_deg: error of the camera's direction.
    """

    __pydantic_config__: ClassVar = STRICT

    position_m: float = 0.0
    height_m: float = 0.0
    terrain_m: float = 0.0
    attitude_deg: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(
            position_m=self.position_m,
            height_m=self.height_m,
            terrain_m=self.terrain_m,
            attitude_deg=self.attitude_deg,
        )
        require(self.attitude_deg < 90.0, f"attitude_deg: {self.attitude_deg} must be below 90 degrees")

    @property
    def vertical_m(self) -> float:
        """Largest error of a height above ground: vehicle and terrain together."""
        return self.height_m + self.terrain_m


PlannerAlgorithm = Literal["memetic", "local-search", "imodbo", "modbo", "nsga2", "moead", "lines", "contour-lines"]

Objective = Literal["mission-time", "flight-time", "length", "energy"]
InitialRoute = Literal["boustrophedon", "contour-lines", "greedy-set-cover", "set-cover"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Geodetic position of the local frame's origin, for areas given in metres.

    Attributes:
        lat_deg: latitude on WGS 84.
        lon_deg: longitude on WGS 84.
        alt_amsl_m: height above mean sea level.
    """

    __pydantic_config__: ClassVar = STRICT

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float

    def __post_init__(self) -> None:
        require(abs(self.lat_deg) <= 90.0, f"lat_deg: {self.lat_deg} is outside -90..90")
        require(abs(self.lon_deg) <= 180.0, f"lon_deg: {self.lon_deg} is outside -180..180")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerSettings:
    """Settings of the route search.

    Attributes:
        algorithm: "memetic": IMODBO, then a local search of what it and the baselines found. "local-search": from sampled routes
            and baselines alone. "imodbo", "modbo": the paper's optimizers, plain. "nsga2", "moead": pymoo's, for comparison.
            "lines": the best parallel lines of a scan, for sensors that look along the path. "contour-lines": the best of a
            scan of lines that follow the terrain's contours.
        line_heading_deg: of "lines": their heading, clockwise from north; default: along the longer side of the area.
        encoding: "swaths": parallel lines with their own gaps and heights, for sensors that look along the path.
            "waypoints": free points with activation genes, as the paper.
        population_size: members of the population.
        evaluations: full route evaluations when no budget is given; 50 proposals of the local search count as one.
        max_waypoints: most waypoints of a route, none by default; of the "waypoints" encoding its capacity, 60 by default, which
            does not count what is put in between where legs follow the terrain.
        cell_size_m: cell size of the search; default: twice the area's cell size, on which the result is judged.
        order: order of waypoints in the optimizer's routes. "nearest-neighbour": the paper's decoding. "improved": the same,
            then 2-opt. The local search finds its own order.
        initial: constructed routes with which the search starts, beside sampled ones (Latin hypercube), and against which its
            result is compared; default: "boustrophedon" for swaths and for a local search along the path, and "set-cover"
            for a local search that senses at waypoints. With objective = "energy" a local search along the path has
            "contour-lines" as well.
        seed: seed of the random numbers.
        parts: into how many parts the area is divided, each searched by itself and then along its seams with the others;
            "auto": one for a small area; more where the cells are too many for one search, or one for each flight where
            that is shorter. Requires encoding = "swaths" and a local search. Default: 1, the area in one piece.
        objective: the cost minimised beside coverage and the number of waypoints. "mission-time": from the ground at home to
            the ground at home, of all flights. "energy": what these take from the batteries by [vehicle.power], in seconds of
            hovering. "flight-time": of the route alone, with wind, climbs and turns. "length" of the route. Default:
            "mission-time" where there is a home, otherwise "length".
        band_deviation_price: cost for every metre of a waypoint above or below the middle of the height band (Eq. 7), in
            metres of path or in seconds (of hovering with "energy").
        waypoint_price: cost of every waypoint, in metres of path or in seconds (of hovering with "energy"). Default: 1 % of the
            radius that the sensor sees from the middle of the band, or its time at cruise speed; 0 for a sensor that looks from
            the waypoints.
        rally: rally points of the mission. "home": home alone, at a safe height. "auto": also places to land where the
            autopilot's own return home is not safe, as far as there are any.
    """

    __pydantic_config__: ClassVar = STRICT

    algorithm: PlannerAlgorithm = "memetic"
    line_heading_deg: float | None = None
    encoding: Literal["swaths", "waypoints"] = "swaths"
    population_size: int = 50
    evaluations: int = 5000
    max_waypoints: int | None = None
    cell_size_m: float | None = None
    order: Literal["nearest-neighbour", "improved"] = "improved"
    initial: tuple[InitialRoute, ...] | None = None
    seed: int = 1
    parts: int | Literal["auto"] = 1
    objective: Objective | None = None
    band_deviation_price: float = 0.0
    waypoint_price: float | None = None
    rally: Literal["home", "auto"] = "home"

    def __post_init__(self) -> None:
        require(self.population_size >= 20, f"population_size: {self.population_size} is below 20")
        require(
            self.evaluations >= self.population_size,
            f"evaluations: {self.evaluations} is less than one population of {self.population_size}",
        )
        require(
            self.line_heading_deg is None or self.algorithm == "lines",
            'line_heading_deg: requires algorithm = "lines"; the other algorithms choose the direction of every leg',
        )
        require(
            self.line_heading_deg is None or 0.0 <= self.line_heading_deg < 360.0,
            f"line_heading_deg: {self.line_heading_deg} is outside 0 to below 360, clockwise from north",
        )
        require(
            self.algorithm not in {"lines", "contour-lines"} or self.encoding == "swaths",
            f'encoding: "waypoints" are not lines; leave it out with algorithm = "{self.algorithm}"',
        )
        require(self.capacity >= 2, f"max_waypoints: {self.max_waypoints} is below 2")
        require_not_negative(band_deviation_price=self.band_deviation_price, waypoint_price=self.waypoint_price or 0.0)
        require(self.seed >= 0, f"seed: {self.seed} must not be negative")
        require(
            self.parts == "auto" or self.parts >= 1,
            f'parts: {self.parts} is below 1; give a number of parts, or "auto"',
        )
        if self.cell_size_m is not None:
            require_positive(cell_size_m=self.cell_size_m)

    @property
    def capacity(self) -> int:
        """Most nodes of the "waypoints" encoding."""
        return 60 if self.max_waypoints is None else self.max_waypoints

    @property
    def most_waypoints(self) -> int | None:
        """Most waypoints that a route may have where lines are planned; none where any number will do."""
        return self.max_waypoints if self.encoding == "swaths" else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirements:
    """Requirements on a flown track for ``verify`` to pass.

    Attributes:
        min_coverage_of_coverable: required fraction of the area that can be covered within the limits.
        min_sure_coverage_of_coverable: required fraction that is seen for every error within [uncertainty], or none.
        min_overlap_fraction: required fraction of the ground, as drawn, that is in as many photos as the camera's
            forward_overlap and side_overlap require, or none: then the overlap is reported, and not required.
        looks: number of observations required of a cell; more than 1 requires sensing at waypoints.
        look_distance_m: waypoints closer to each other than this count as one observation; required for more than one.
        max_deviation_m: largest distance of the flown track from the planned route, or none.
        max_ground_speed_m_s: largest speed over ground on the planned route, or none.
        max_gap_s: largest time between samples that are joined by a straight line.
        max_unobserved_fraction: largest fraction of the route's time without evidence; above it the flight is not proved.
        max_unobserved_gap_s: longest single stretch without evidence between take-off and landing; beyond it the same.
    """

    __pydantic_config__: ClassVar = STRICT

    min_coverage_of_coverable: float = 0.95
    min_sure_coverage_of_coverable: float | None = None
    min_overlap_fraction: float | None = None
    looks: int = 1
    look_distance_m: float | None = None
    max_deviation_m: float | None = None
    max_ground_speed_m_s: float | None = None
    max_gap_s: float = 2.0
    max_unobserved_fraction: float = 0.01
    max_unobserved_gap_s: float = 10.0

    def __post_init__(self) -> None:
        require(
            0.0 <= self.min_coverage_of_coverable <= 1.0,
            f"min_coverage_of_coverable: {self.min_coverage_of_coverable} is a share, 0..1",
        )
        sure = self.min_sure_coverage_of_coverable
        require(sure is None or 0.0 <= sure <= 1.0, f"min_sure_coverage_of_coverable: {sure} is a share, 0..1")
        overlap = self.min_overlap_fraction
        require(
            overlap is None or 0.0 < overlap <= 1.0, f"min_overlap_fraction: {overlap} is no share above 0, up to 1"
        )
        require(1 <= self.looks <= 20, f"looks: {self.looks} is outside 1..20")
        require(
            self.looks == 1 or self.look_distance_m is not None,
            "look_distance_m: is needed with more than one look: nearer waypoints count as one",
        )
        require(
            self.look_distance_m is None or (self.look_distance_m > 0.0 and self.looks > 1),
            "look_distance_m: must be above 0, and requires more than one look",
        )
        require_positive(max_gap_s=self.max_gap_s, max_unobserved_gap_s=self.max_unobserved_gap_s)
        require(
            0.0 <= self.max_unobserved_fraction <= 1.0,
            f"max_unobserved_fraction: {self.max_unobserved_fraction} is a share, 0..1",
        )
        require(self.max_deviation_m is None or self.max_deviation_m > 0.0, "max_deviation_m: must be above 0")
        require(
            self.max_ground_speed_m_s is None or self.max_ground_speed_m_s > 0.0,
            "max_ground_speed_m_s: must be above 0",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A validated scenario: the sections of the TOML file.

    Attributes:
        name: short name, used in files and reports.
        area: the area to cover.
        terrain: the elevation data.
        sensor: the sensor.
        limits: the hard limits.
        vehicle: the vehicle.
        origin: geodetic position of the local frame, for areas in metres; a geographic area needs none (default: its home).
        home: take-off and landing; needed for mission files.
        planner: settings of the route search.
        select: the rule that selects one route of the Pareto set.
        requirements: what the flown track must reach.
        obstacles: obstacles on the ground.
        no_fly: zones that the vehicle must not enter on any part of the flight.
        flight_window_utc: earliest take-off and latest landing, such as ["2026-06-01T06:00Z", "2026-06-01T18:00Z"]. No-fly
            zones that are not in force between them do not count; without a window every zone counts.
        wind: the wind the flight is planned for.
        fleet: how many vehicles fly the plan, and what keeps them apart.
        vehicles: those of [[vehicle]] given several times, where they differ; none where all are alike.
        uncertainty: errors of positions, ground and attitude.
        description: one line for people.
    """

    __pydantic_config__: ClassVar = STRICT

    name: str
    area: Area
    terrain: Terrain
    sensor: Sensor
    limits: FlightLimits
    vehicle: Vehicle = field(default_factory=Vehicle)
    origin: Origin | None = None
    home: Home | None = None
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    select: str = "weighted:0.6,0.2,0.2"
    requirements: Requirements = field(default_factory=Requirements)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    obstacles: Obstacles = field(default_factory=Obstacles)
    no_fly: tuple[NoFly, ...] = ()
    flight_window_utc: tuple[str, str] | None = None
    wind: Wind = field(default_factory=Wind)
    fleet: Fleet = field(default_factory=Fleet)
    vehicles: tuple[Vehicle, ...] = ()
    description: str = ""

    def __post_init__(self) -> None:
        require(
            self.requirements.min_overlap_fraction is None or all(v.sensor is None for v in self.vehicles),
            "requirements.min_overlap_fraction: is that of one camera; leave it out where vehicles have sensors of their own",
        )
        for number, vehicle in enumerate(self.vehicles):
            link, system_id = vehicle.link, vehicle.system_id
            if link is None or link.startswith("mock:") or self.has_launch_points:
                continue
            for other, before in enumerate(self.vehicles[:number]):
                require(
                    before.link != link or None not in (system_id, before.system_id),
                    f"vehicle.{number}.link: {link} is that of vehicle.{other}; each vehicle needs a link of its own, or a "
                    "system_id",
                )
                require(
                    before.link != link or system_id != before.system_id,
                    f"vehicle.{number}.system_id: {system_id} at {link} is vehicle.{other}",
                )
        self._require_fits(self.sensor, "sensor")
        for number, vehicle in enumerate(self.vehicles):
            if vehicle.sensor is not None:
                self._require_fits(vehicle.sensor, f"vehicle.{number}.sensor")
        if self.flight_window_utc is not None:
            window_of(*self.flight_window_utc, "flight_window_utc")
        require(
            len(self.vehicles) in (0, self.fleet.vehicles),
            f"fleet.vehicles: is {self.fleet.vehicles}, and [[vehicle]] lists {len(self.vehicles)} that are not alike",
        )
        require(
            bool(self.vehicles) or not self.fleet.one_at_a_time,
            "fleet.one_at_a_time: is for vehicles that differ, or one with launch points; give each a [[vehicle]], or a "
            "[[launch_point]]",
        )
        for number, vehicle in enumerate(self.vehicles or (self.vehicle,)):
            airspeed, which = vehicle.max_airspeed_m_s, f"vehicle.{number}" if self.vehicles else "vehicle"
            for key, speed_m_s in (("speed_m_s", self.wind.speed_m_s), ("most_m_s", self.wind.most_m_s or 0.0)):
                require(
                    speed_m_s == 0.0 or (airspeed is not None and airspeed > speed_m_s),
                    f"wind.{key}: {speed_m_s} m/s needs a larger {which}.max_airspeed_m_s, not {airspeed}",
                )
        require(
            self.planner.objective not in {"mission-time", "energy"} or self.home is not None,
            f'planner.objective: "{self.planner.objective}" needs a [home], from which the mission starts',
        )
        if self.area.is_geographic:
            require(self.home is not None, "home: give lat_deg and lon_deg of the take-off position")
            require(self.terrain.kind == "raster", "terrain.kind: a geographic area needs raster terrain")
            require(self.home is None or self.home.lat_deg is not None, "home: give lat_deg and lon_deg")
            for number, vehicle in enumerate(self.vehicles):
                which = f"launch_point.{number - 1}" if self.has_launch_points else f"vehicle.{number}.home"
                require(vehicle.home is None or vehicle.home.lat_deg is not None, f"{which}: give lat_deg and lon_deg")
        else:
            require(
                self.terrain.kind != "raster" or self.origin is not None,
                "origin: raster terrain under an area in metres needs the origin of the local frame",
            )
            require(
                self.home is None or self.home.east_m is not None or self.origin is not None,
                "home: lat_deg and lon_deg need an origin; give east_m and north_m, or an [origin]",
            )

    @property
    def has_launch_points(self) -> bool:
        """Whether its vehicles are one that takes off from several places: one at a time, alike but for their homes."""
        own = {dataclasses.replace(vehicle, home=None) for vehicle in self.vehicles}
        return self.fleet.one_at_a_time and len(own) == 1

    def _require_fits(self, sensor: Sensor, key: str) -> None:
        """Refuse a sensor that does not go with limits, cells and what is required."""
        reach_m, range_m = sensor.reach_m, sensor.slant_range_m
        require(
            range_m is None or range_m > self.limits.min_height_agl_m,
            f"{key}.range_m: {range_m} m does not reach the ground from limits.min_height_agl_m = "
            f"{self.limits.min_height_agl_m} m",
        )
        require(
            not (self.obstacles.file or self.obstacles.prisms) or sensor.sight.line_of_sight != MIDPOINT,
            f'{key}.line_of_sight: among obstacles it must be "ray"; "midpoint" tests one point of the ray only',
        )
        require(
            self.requirements.looks == 1 or not sensor.looks_along_path,
            f'requirements.looks: more than one requires {key}.sensing = "at-waypoints"; along the path give a frame '
            "camera's side_overlap",
        )
        require(
            self.requirements.min_overlap_fraction is None or sensor.asks_overlap,
            "requirements.min_overlap_fraction: requires a frame camera's forward_overlap and side_overlap; give these, or "
            "leave it out",
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
        """Cell size of the search: coarser than that on which the result is judged."""
        return self.planner.cell_size_m if self.planner.cell_size_m is not None else 2.0 * self.area.cell_size_m
