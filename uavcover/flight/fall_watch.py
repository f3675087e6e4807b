"""Detect by motion alone that an armed vehicle falls, has hit something, or lies on the ground.

A motor that fails, a propeller that is lost or a hillside ends a flight while the autopilot still reports that it flies.
"""

import math

from mission_io.model.items import Command
from mission_io.wire import messages as m
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.session import Session
from uavcover.flight.tuning import FALL
from uavcover.model.outcome import Ending, FlightFaultError

_HIT_M_S2, _HIT_FROM_M_S, _STOPPED_M_S = 20.0, 4.0, 1.5
"""No multirotor brakes so hard: autopilots limit their acceleration to a few metres per second squared."""
_LANDINGS = (Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH)


class FallWatch:
    """Looks at height, motion and attitude all the time while a vehicle is armed.

    Args:
        session: with the vehicle.
        plan: what it flies; None on its return.
    """

    def __init__(self, session: Session, plan: FlightPlan | None) -> None:
        self._session, self._plan = session, plan
        descent_m_s = (None if plan is None else plan.max_descent_m_s) or 3.0
        self._fall_m_s = max(FALL.least_fall_m_s, FALL.fall_ratio * descent_m_s)
        self._seen: m.GlobalPositionInt | None = None
        self._fast = 0
        self._leans_since_s: float | None = None
        self._from_m = self._fastest_m_s = 0.0
        self._hit_m_s: float | None = None
        self._still_since_s: float | None = None
        self._aloft = False

    def look(self) -> None:
        """Look once.

        Raises:
            FlightFaultError: the vehicle has crashed.
        """
        here = self._session.monitor.latest(m.GlobalPositionInt)
        if here is None or here is self._seen:
            return
        before, self._seen = self._seen, here
        height_m = self._session.monitor.ground.height_m
        self._aloft = self._aloft or height_m > FALL.aloft_m
        if before is not None and here.time_boot_s > before.time_boot_s:
            self._look_for_hit(before, here)
        self._look_for_fall(here, height_m)
        self._look_whether_it_lies(here, height_m)

    def _look_for_fall(self, here: m.GlobalPositionInt, height_m: float) -> None:
        watch, lean_deg = self._session.watch, self._lean_deg()
        self._fast = self._fast + 1 if here.velocity_down_m_s > self._fall_m_s else 0
        if lean_deg <= FALL.lean_deg:
            self._leans_since_s = None
        elif self._leans_since_s is None:
            self._leans_since_s = here.time_boot_s
        tumbles = self._leans_since_s is not None and here.time_boot_s - self._leans_since_s >= FALL.tumbles_s
        falls = self._aloft and (self._fast > 1 or tumbles)
        if falls and not watch.is_open(Ending.FALLING):
            self._from_m, self._fastest_m_s = height_m, 0.0
        if falls:
            self._fastest_m_s = max(self._fastest_m_s, here.velocity_down_m_s)
        watch.measure(
            Ending.FALLING, max(1.0, here.velocity_down_m_s) if falls else None,
            f"the vehicle is falling: it sinks at {here.velocity_down_m_s:.0f} m/s, {height_m:.0f} m above the "
            f"ground, and is tilted by {lean_deg:.0f} degrees",
            "the vehicle has stopped falling",
        )  # fmt: skip

    def _look_for_hit(self, before: m.GlobalPositionInt, here: m.GlobalPositionInt) -> None:
        change_m_s = math.dist(_velocity(before), _velocity(here))
        was_m_s, is_m_s = math.hypot(*_velocity(before)), math.hypot(*_velocity(here))
        hard = change_m_s / (here.time_boot_s - before.time_boot_s) > _HIT_M_S2
        if hard and was_m_s > _HIT_FROM_M_S and is_m_s < _STOPPED_M_S and self._aloft:
            self._hit_m_s = was_m_s
        elif is_m_s > _STOPPED_M_S:
            self._hit_m_s = None

    def _look_whether_it_lies(self, here: m.GlobalPositionInt, height_m: float) -> None:
        still = math.hypot(*_velocity(here)) < FALL.still_m_s
        if not still or not self._aloft:
            self._still_since_s = None
            return
        if self._still_since_s is None:
            self._still_since_s = here.time_boot_s
        still_s = here.time_boot_s - self._still_since_s
        if self._session.watch.is_open(Ending.FALLING) and height_m < FALL.near_m and still_s >= 1.0:
            self._crashed(f"fell from {self._from_m:.0f} m at {self._fastest_m_s:.0f} m/s and is")
        if self._hit_m_s is not None and height_m < FALL.near_m and still_s >= FALL.hit_still_s:
            self._crashed(f"stopped abruptly at {self._hit_m_s:.0f} m/s and is")
        if height_m < FALL.lies_m and still_s >= FALL.lies_s and not self._may_stand():
            self._crashed("should be in the air but is")

    def _may_stand(self) -> bool:
        """Whether the vehicle may be on the ground: it lands, reports a landing, or its mode is unknown."""
        monitor, plan = self._session.monitor, self._plan
        if plan is None or monitor.ground.says_landed or not self._session.on_mission:
            return True
        index = plan.index_of(monitor.current_seq, self._session.autopilot)
        items = plan.mission.items
        return not 0 <= index < len(items) or items[index].command in _LANDINGS or index == 0

    def _crashed(self, how: str) -> None:
        session, here = self._session, self._seen
        place = "" if here is None else f" at {here.lat_deg:.6f}, {here.lon_deg:.6f}"
        text = (
            f"the vehicle {how} on the ground{place}; it is armed: keep away, because its motors may "
            f"start{session.recent_warnings}"
        )
        session.watch.open(Ending.CRASHED, text)
        raise FlightFaultError(Ending.CRASHED, text)

    def _lean_deg(self) -> float:
        attitude = self._session.monitor.latest(m.Attitude)
        if attitude is None:
            return 0.0
        tilt = math.cos(attitude.roll_rad) * math.cos(attitude.pitch_rad)
        return math.degrees(math.acos(max(-1.0, min(1.0, tilt))))


def _velocity(position: m.GlobalPositionInt) -> tuple[float, float, float]:
    return position.velocity_north_m_s, position.velocity_east_m_s, position.velocity_down_m_s
