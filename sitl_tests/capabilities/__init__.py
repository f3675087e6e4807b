"""What the vehicles are asked, a function each; ``ALL`` has them by the names of ``matrix.toml``."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from sitl_tests.capabilities import (
    demonstration,
    disturbances,
    failsafes,
    flights,
    identity,
    logs,
    preconditions,
    refusals,
    stations,
    transfers,
)
from sitl_tests.case import Case, Finding, Judge

ALL: Mapping[str, Callable[[Case], Finding | Judge]] = MappingProxyType(
    {
        "connect": transfers.connect,
        "mission-round-trip": transfers.mission_round_trip,
        "fence-round-trip": transfers.fence_round_trip,
        "rally-round-trip": transfers.rally_round_trip,
        "upload-under-loss": transfers.upload_under_loss,
        "mission-as-file": transfers.mission_as_file,
        "part-of-mission": transfers.part_of_mission,
        "refused-mission": refusals.refused_mission,
        "failed-upload": refusals.failed_upload,
        "terrain-frames": refusals.terrain_frames,
        "second-station": stations.second_station,
        "mission-lowered": stations.mission_lowered,
        "mission-from-file": stations.mission_from_file,
        "mavsdk-start": stations.mavsdk_start,
        "arming": flights.arming,
        "fly-square": flights.fly_square,
        "terrain-flight": flights.terrain_flight,
        "pause-and-resume": flights.pause_and_resume,
        "second-flight": flights.second_flight,
        "stop-and-return": flights.stop_and_return,
        "wrong-home": flights.wrong_home,
        "change-in-flight": flights.change_in_flight,
        "foreign-type": identity.foreign_type,
        "meddling-companion": identity.meddling_companion,
        "hostile-text": identity.hostile_text,
        "force-disarm": identity.force_disarm,
        "blackout": disturbances.blackout,
        "motor-failure": disturbances.motor_failure,
        "gps-glitch": disturbances.gps_glitch,
        "strong-wind": disturbances.strong_wind,
        "item-set-back": disturbances.item_set_back,
        "slowed-down": disturbances.slowed_down,
        "hold-ends": disturbances.hold_ends,
        "pilot-gives-back": disturbances.pilot_gives_back,
        "fence-breach": failsafes.fence_breach,
        "link-loss": failsafes.link_loss,
        "rally-return": failsafes.rally_return,
        "restart-pause": flights.pause_and_resume,
        "restart-return": flights.stop_and_return,
        "heading-fixed": preconditions.refused_settings,
        "mission-broken-off": preconditions.refused_settings,
        "other-station-minded": preconditions.other_station_minded,
        "home-moved": preconditions.home_moved,
        "home-moved-return": preconditions.home_moved_return,
        "setting-changed": preconditions.setting_changed,
        "fence-changed": preconditions.fence_changed,
        "log-download": logs.log_download,
        "fly-demo": demonstration.fly_demo,
    }
)
"""Name of a capability to what tries it."""

PREPARATIONS: Mapping[str, Callable[[Path], object]] = MappingProxyType({"fly-demo": demonstration.planned_run})
"""What a capability needs before its vehicle is started, since it takes long; in the folder of all cases."""
