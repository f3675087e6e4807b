"""The design of a survey: heights, distances and speed from camera, ground sample distance and overlap."""

import math
from dataclasses import dataclass

from uavcover.errors import InputError
from uavcover.new.catalog import CameraBody, VehicleType
from uavcover.new.tuning import SURVEY


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyWish:
    """Requirements of a survey."""

    camera: CameraBody  # the camera
    gsd_m: float  # largest ground sample distance
    forward_overlap: float  # share of a photo's length that the next one shows again
    side_overlap: float  # share of its width that the next line shows again
    vehicle: VehicleType | None = None  # the vehicle, or none
    ceiling_agl_m: float | None = None  # largest height above ground; none: the usual limit
    speed_m_s: float | None = None  # speed over ground; none: the vehicle's usual one
    endurance_s: float | None = None  # time in the air on a full battery; none: the vehicle's
    margin_m: float | None = None  # how far beyond the area photos overlap; none: as far as they have to


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyDesign:
    """Flight values derived from the requirements.

    Distances on the ground are for flat ground.
    """

    wish: SurveyWish  # the requirements
    gsd_height_m: float  # height at which a pixel covers the required ground sample distance
    min_height_agl_m: float  # lower end of the height band
    max_height_agl_m: float  # upper end
    height_margin_m: float  # the planner stays this far inside both
    max_climb_angle_deg: float  # steepest leg; a multicopter climbs as steeply as the ground does
    picture_distance_m: float  # between two photos, for the overlap at the lower end
    line_distance_m: float  # between two lines, at the middle of the band
    speed_m_s: float  # over ground
    speed_reason: str  # why it is not the usual one; empty if it is
    endurance_s: float | None  # time in the air on a full battery; none: unknown
    margin_m: float  # how far the area is grown
    cell_size_m: float  # side of the cells on which results are judged
    range_m: float  # largest slant range, from the top of the band to the corners of a photo on a slope

    @property
    def is_capped(self) -> bool:
        """Whether the height limit, and not the ground sample distance, is the top of the band."""
        return self.max_height_agl_m < 0.99 * self.gsd_height_m

    def gsd_at_m(self, height_agl_m: float) -> float:
        """Ground sample distance straight below, from a height."""
        return height_agl_m / self.wish.camera.focal_px


def design_survey(wish: SurveyWish, *, slope_deg: float, area_m2: float, step_m: float = 0.0) -> SurveyDesign:
    """Heights, distances and speed of a survey.

    Args:
        wish: the requirements.
        slope_deg: slope that 95 % of the ground stays below; steeper ground gets a deeper height band, since straight legs cannot
            follow it as closely.
        area_m2: size of the area.
        step_m: tallest thing that lines pass over, trees or roofs of a surface model: the band has room for that step.

    Raises:
        InputError: it cannot be flown; says which of the wishes has to change.
    """
    camera = wish.camera
    gsd_height_m = wish.gsd_m * camera.focal_px
    ceiling_m = SURVEY.usual_ceiling_m if wish.ceiling_agl_m is None else wish.ceiling_agl_m
    top_m = math.floor(10.0 * min(gsd_height_m, ceiling_m)) / 10.0
    if top_m < SURVEY.lowest_top_m:
        _refuse_height(wish, gsd_height_m, top_m)
    steepness = min(max((slope_deg - SURVEY.flat_deg) / (SURVEY.steep_deg - SURVEY.flat_deg), 0.0), 1.0)
    bottom_m = math.ceil(min((0.75 - 0.15 * steepness) * top_m, top_m - 15.0))
    height_margin_m = 5.0 if top_m - bottom_m >= 20.0 else 3.5
    if step_m > 0.0:
        height_margin_m = 5.0
        bottom_m = min(bottom_m, math.floor(top_m - step_m - 2.0 * height_margin_m - 1.0))
        if bottom_m < SURVEY.lowest_bottom_m:
            raise InputError(
                f"--dsm: objects there are up to {step_m:.0f} m tall, so no lines fit between "
                f"{SURVEY.lowest_bottom_m:g} m above them and {top_m:g} m above open ground; use a coarser --gsd or "
                "a larger --max-height, or exclude these objects from the area"
            )
    across = camera.sensor_across_mm / camera.focal_length_mm
    along = camera.sensor_along_mm / camera.focal_length_mm
    picture_distance_m = (1.0 - wish.forward_overlap) * along * bottom_m
    line_distance_m = (1.0 - wish.side_overlap) * across * 0.5 * (bottom_m + top_m)
    speed_m_s, reason = _speed(wish, picture_distance_m)
    margin_m = wish.margin_m
    if margin_m is None:
        # a place at the edge is in as many photos as one inside when lines, and photos along them, reach as far beyond
        # the edge as a photo overlaps the next: f L along, s W / 2 across (docs/how-to/survey_from_files.md).
        margin_m = math.ceil(max(wish.forward_overlap * along, 0.5 * wish.side_overlap * across) * top_m)
    cell_m = min(max(math.sqrt(area_m2 / SURVEY.cells), SURVEY.finest_cell_m), max(line_distance_m / 4.0, 0.5))
    endurance_s = wish.endurance_s or (wish.vehicle.endurance_s if wish.vehicle is not None else None)
    diagonal = 0.5 * math.hypot(across, along)
    return SurveyDesign(
        wish=wish, gsd_height_m=gsd_height_m, min_height_agl_m=bottom_m, max_height_agl_m=top_m, height_margin_m=height_margin_m,
        max_climb_angle_deg=_climb_angle_deg(slope_deg),
        picture_distance_m=picture_distance_m, line_distance_m=line_distance_m, speed_m_s=speed_m_s, speed_reason=reason,
        endurance_s=endurance_s, margin_m=margin_m, cell_size_m=round(cell_m, 1),
        range_m=math.ceil(1.6 * top_m * math.hypot(1.0, diagonal)),
    )  # fmt: skip


def _climb_angle_deg(slope_deg: float) -> float:
    """Steepest leg over sloping ground, in steps of 5 degrees. It is steeper than the ground: lines across it end at the foot."""
    wanted_deg = 5.0 * math.ceil((slope_deg + SURVEY.climb_over_slope_deg) / 5.0)
    return min(max(wanted_deg, SURVEY.usual_climb_deg), SURVEY.steepest_climb_deg)


def _refuse_height(wish: SurveyWish, gsd_height_m: float, top_m: float) -> None:
    if gsd_height_m < SURVEY.lowest_top_m:
        coarser_cm = 100.0 * SURVEY.lowest_top_m / wish.camera.focal_px
        raise InputError(
            f"--gsd: {100.0 * wish.gsd_m:g} cm with {wish.camera.name} requires a height of {gsd_height_m:.1f} m "
            f"above ground, but the minimum is {SURVEY.lowest_top_m:g} m; use {coarser_cm:.2g} cm or more, or a "
            "camera with a longer lens"
        )
    raise InputError(
        f"--max-height: {top_m:g} m leaves no room for a height band above trees and houses; use "
        f"{SURVEY.lowest_top_m:g} m or more"
    )


def _speed(wish: SurveyWish, picture_distance_m: float) -> tuple[float, str]:
    """Speed over ground, and why it is not the usual one."""
    vehicle = wish.vehicle
    largest = vehicle.max_speed_m_s if vehicle is not None else None
    if wish.speed_m_s is not None and largest is not None and wish.speed_m_s > largest:
        raise InputError(
            f"--speed: {wish.speed_m_s:g} m/s exceeds the maximum of {wish.vehicle and wish.vehicle.name}, "
            f"{largest:g} m/s; use a lower speed"
        )
    usual = SURVEY.usual_speed_m_s
    if vehicle is not None and vehicle.cruise_speed_m_s is not None:
        usual = vehicle.cruise_speed_m_s
    elif largest is not None:
        usual = min(usual, SURVEY.speed_share * largest)
    speed = usual if wish.speed_m_s is None else wish.speed_m_s
    interval_s = wish.camera.min_interval_s
    if interval_s is None:
        return speed, ""
    fastest = picture_distance_m / (interval_s * SURVEY.trigger_slack)
    if speed <= fastest:
        return speed, ""
    needed = f"a photo every {picture_distance_m:.1f} m and the {interval_s:g} s interval of {wish.camera.name}"
    if wish.speed_m_s is not None or fastest < SURVEY.slowest_m_s:
        raise InputError(
            f"{'--speed' if wish.speed_m_s is not None else '--overlap'}: {needed} allow only {fastest:.1f} m/s; use "
            "less forward overlap, a coarser --gsd or a lower --speed, or use a faster camera"
        )
    return math.floor(10.0 * fastest) / 10.0, f"{needed} do not allow a higher speed"
