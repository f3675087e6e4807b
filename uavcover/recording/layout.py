"""What is where in a recording: the names of entities and of the timeline, and the colours.

Everything in ``WORLD`` is in the local east-north-up frame in metres, everything in ``MAP`` in degrees of latitude and
longitude. Readers of recordings depend on ``TIMELINE`` and ``TRACK``; the rest is for eyes.
"""

from typing import Final

TIMELINE: Final = "mission_time"
"""Vehicle time, as a duration."""

WORLD: Final = "/world"
TERRAIN: Final = f"{WORLD}/terrain"
AREA: Final = f"{WORLD}/area"
FENCE: Final = f"{WORLD}/fence"
OBSTACLES: Final = f"{WORLD}/obstacles"
HOME: Final = f"{WORLD}/home"
PLANNED: Final = f"{WORLD}/planned"
WAYPOINTS: Final = f"{PLANNED}/waypoints"
FLOWN: Final = f"{WORLD}/flown"
VEHICLE: Final = f"{WORLD}/vehicle"
HEADING: Final = f"{VEHICLE}/heading"
FOOTPRINT: Final = f"{WORLD}/footprint"
CAMERA: Final = f"{WORLD}/camera"
COVERAGE: Final = f"{WORLD}/coverage"

MAP: Final = "/map"
MAP_FLOWN: Final = f"{MAP}/flown"
MAP_VEHICLE: Final = f"{MAP}/vehicle"

SERIES: Final = "/series"
HEIGHT_AGL: Final = f"{SERIES}/height/above_ground_m"
HEIGHT_MIN: Final = f"{SERIES}/height/lowest_allowed_m"
HEIGHT_MAX: Final = f"{SERIES}/height/highest_allowed_m"
SEEN: Final = f"{SERIES}/coverage/seen_percent"
SEEN_COVERABLE: Final = f"{SERIES}/coverage/seen_of_coverable_percent"
GROUND_SPEED: Final = f"{SERIES}/speed/ground_m_s"
CLIMB_SPEED: Final = f"{SERIES}/speed/climb_m_s"
BATTERY_PERCENT: Final = f"{SERIES}/battery/left_percent"
BATTERY_V: Final = f"{SERIES}/battery/volts"
LINK_LOST: Final = f"{SERIES}/link/lost_percent"
LINK_RATE: Final = f"{SERIES}/link/messages_a_second"

EVENTS: Final = "/events"
LEGEND: Final = "/legend"
TRACK: Final = "/track"
"""The track in float64, one component for each column of ``track.csv``."""

SAMPLE_COUNT: Final = "sample_count"
"""Static component of ``TRACK``: how many samples were written, by which a reader knows a recording that was cut off."""

UNFINISHED: Final = "unfinished"
"""Static component of ``TRACK`` in a recording that is being made while the vehicle flies."""

CELL_NUMBERS: Final = "cell_numbers"
"""Static component of every coverage tile: which cells of the area its points are."""

Rgb = tuple[int, int, int]

OBSTACLE_RGB: Final[Rgb] = (142, 111, 193)
PLANNED_RGB: Final[Rgb] = (255, 255, 255)
FLOWN_RGB: Final[Rgb] = (255, 196, 0)
VEHICLE_RGB: Final[Rgb] = (255, 64, 64)
FOOTPRINT_RGB: Final[Rgb] = (64, 224, 255)
CAMERA_RGB: Final[Rgb] = (170, 240, 255)
AREA_RGB: Final[Rgb] = (120, 190, 255)
FENCE_RGB: Final[Rgb] = (255, 96, 64)
HOME_RGB: Final[Rgb] = (255, 64, 192)
LIMIT_RGB: Final[Rgb] = (255, 96, 64)
SEEN_RGB: Final[Rgb] = (46, 204, 113)
UNSEEN_RGB: Final[Rgb] = (118, 124, 140)
NOT_COVERABLE_RGB: Final[Rgb] = (86, 48, 92)
