"""Before arming: what a vehicle lacks, how often it is asked why, and how often its telemetry has to come."""

import itertools
from collections import Counter
from types import SimpleNamespace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.enums import AutopilotId, CommandResult, EkfFlag
from mission_io.model.items import GeoPoint
from mission_io.wire import messages as m
from tests.flight.scene import HOME, Scene, geodetic, make_scene, mission, plan_for
from uavcover.errors import VehicleError
from uavcover.flight.arming import check_home, check_home_position, check_telemetry, missing
from uavcover.flight.orders import FlightTimeouts
from uavcover.mock import reactions
from uavcover.mock.behaviour import quick
from uavcover.mock.state import MockState
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.track import EventKind

AUTOPILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
CHECKS = m.PREARM_CHECK_BIT
OTHER_SENSOR = 0x20
GOOD_FILTER = int(EkfFlag.ATTITUDE | EkfFlag.POSITION_HORIZONTAL_ABSOLUTE)
POSITION = m.GlobalPositionInt(1.0, HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m, 0.0, 0.0, 0.0, 0.0, 0.0)


def ready_scene(*args, **options) -> Scene:
    scene = make_scene(*args, **options)
    scene.upload(mission())
    return scene


# What it lacks


def fix(kind: int) -> m.GpsRawInt:
    return m.GpsRawInt(1.0, kind, HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m, 1.0, 1.0, 0.0, 0.0, 9)


def status(present: int, healthy: int) -> m.SysStatus:
    return m.SysStatus(present, present, healthy, 0.1, 15.0, 1.0, 90)


def lacked(*reported: m.Message, ardupilot: bool = True) -> list[str]:
    heard = {type(message): message for message in reported}
    return missing(
        SimpleNamespace(monitor=SimpleNamespace(latest=heard.get, doubts_positions=False), is_ardupilot=ardupilot)
    )


READY = (fix(3), m.EkfStatusReport(GOOD_FILTER), status(CHECKS, CHECKS), POSITION)


def test_a_vehicle_that_is_ready_lacks_nothing_and_a_silent_one_everything() -> None:
    assert lacked(*READY) == []
    assert lacked(fix(3), status(CHECKS, CHECKS), POSITION, ardupilot=False) == []
    assert lacked() == ["satellite fix", "position estimate", "passed pre-arm check", "position messages"]
    assert lacked(ardupilot=False) == ["satellite fix", "passed pre-arm check", "position messages"]


@pytest.mark.parametrize(
    ("reported", "lacks"),
    [
        (fix(0), ["satellite fix"]),
        (fix(2), ["satellite fix"]),
        (fix(4), []),
        (m.EkfStatusReport(int(EkfFlag.ATTITUDE)), ["position estimate"]),
        (m.EkfStatusReport(GOOD_FILTER | int(EkfFlag.CONSTANT_POSITION)), ["position estimate"]),
        (status(CHECKS | OTHER_SENSOR, OTHER_SENSOR), ["passed pre-arm check"]),
        (status(CHECKS | OTHER_SENSOR, CHECKS), []),  # another sensor that fails is the check's own matter
        (status(OTHER_SENSOR, OTHER_SENSOR), []),  # a vehicle that does not tell of its checks
        (status(0, 0), []),
    ],
    ids=str,
)
def test_what_one_message_says_is_lacking(reported: m.Message, lacks: list[str]) -> None:
    assert lacked(*READY, reported) == lacks


# Asked why


@pytest.mark.parametrize(
    ("answer", "asked_about"), [(CommandResult.ACCEPTED, 6), (CommandResult.FAILED, 6), (CommandResult.UNSUPPORTED, 1)]
)
def test_ardupilot_is_asked_why_every_15_s_as_long_as_it_knows_the_question(
    monkeypatch: pytest.MonkeyPatch, answer: CommandResult, asked_about: int
) -> None:
    scene = ready_scene(behaviour=quick(100.0))
    requested_s: list[float] = []

    def handle(*_: object) -> CommandResult:
        requested_s.append(scene.monitor.time_s or 0.0)
        return answer

    monkeypatch.setitem(reactions._HANDLERS, 401, handle)
    scene.fly()
    assert len(requested_s) == pytest.approx(asked_about, abs=1 if asked_about > 1 else 0)
    assert all(after - before >= 15.0 for before, after in itertools.pairwise(requested_s))


def test_px4_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = ready_scene(PX4)
    requested: list[object] = []
    monkeypatch.setitem(reactions._HANDLERS, 401, lambda *what: (requested.append(what), CommandResult.ACCEPTED)[1])
    monkeypatch.setattr(MockVehicle, "checks_pass", False)
    with pytest.raises(VehicleError, match="vehicle 1 has no passed pre-arm check within 120 s"):
        scene.fly()
    assert requested == []


# Rates


INTERVALS_S = {
    m.GlobalPositionInt: 0.1, m.Attitude: 0.1, m.MissionCurrent: 0.2, m.ExtendedSysState: 0.5, m.SysStatus: 1.0,
    m.GpsRawInt: 1.0, m.EkfStatusReport: 1.0,
}  # fmt: skip


@AUTOPILOTS
def test_what_following_needs_is_asked_for(autopilot, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = ready_scene(autopilot)
    requested: list[tuple[type[m.Message], float | None]] = []
    original = MockState.set_interval

    def record(vehicle: MockState, kind: type[m.Message], interval_s: float | None) -> None:
        requested.append((kind, interval_s))
        original(vehicle, kind, interval_s)

    monkeypatch.setattr(MockState, "set_interval", record)
    scene.fly()
    wanted = dict(INTERVALS_S)
    if autopilot is PX4:
        del wanted[m.EkfStatusReport], wanted[m.MissionCurrent]
    first = requested[: len(wanted)]
    assert {kind: pytest.approx(interval_s) for kind, interval_s in first} == wanted
    assert scene.reported(EventKind.WARNING) == []


@pytest.mark.parametrize(
    ("kind", "interval_s", "needs"),
    [
        (m.GlobalPositionInt, 0.25, "5"),
        (m.Attitude, 0.7, "2"),
        (m.MissionCurrent, 4.0, "0.4"),
        (m.ExtendedSysState, 4.0, "0.4"),
        (m.SysStatus, 9.0, "0.2"),
        (m.GpsRawInt, 9.0, "0.2"),
        (m.EkfStatusReport, 9.0, "0.2"),
    ],
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_what_comes_too_rarely_is_asked_for_three_times_and_refused(
    monkeypatch: pytest.MonkeyPatch, kind: type[m.Message], interval_s: float, needs: str
) -> None:
    scene = ready_scene()
    requested: list[type[m.Message]] = []
    original = MockState.set_interval

    def slow(vehicle: MockState, what: type[m.Message], wanted_s: float | None) -> None:
        requested.append(what)
        original(vehicle, what, interval_s if what is kind else wanted_s)

    monkeypatch.setattr(MockState, "set_interval", slow)
    with pytest.raises(
        VehicleError,
        match=rf"the vehicle sends {kind.__name__} \d.\d times a second .* requires {needs}; the flight was not started",
    ):
        scene.fly()
    assert requested.count(kind) == 3
    assert all(requested.count(other) == 1 for other in INTERVALS_S if other is not kind)
    assert not scene.vehicle.armed


def test_what_comes_often_enough_on_the_second_asking_is_flown_with(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = ready_scene()
    requested: list[type[m.Message]] = []
    original = MockState.set_interval

    def slow_at_first(vehicle: MockState, what: type[m.Message], wanted_s: float | None) -> None:
        requested.append(what)
        late = what is m.Attitude and requested.count(what) == 1
        original(vehicle, what, 2.0 if late else wanted_s)

    monkeypatch.setattr(MockState, "set_interval", slow_at_first)
    scene.fly()
    assert requested.count(m.Attitude) == 2
    assert requested.count(m.GlobalPositionInt) == 1


class Telling:
    """A session in which every half second so many messages of each kind arrive."""

    is_px4, is_ardupilot = True, False

    def __init__(self, **per_half_second: int) -> None:
        self.requested: list[type[m.Message]] = []
        self.timeouts = FlightTimeouts()
        self.monitor = SimpleNamespace(time_s=0.0, counts=Counter())
        self.client = SimpleNamespace(
            vehicle=SimpleNamespace(mav_autopilot=AutopilotId.PX4), clock=SimpleNamespace(now=lambda: self.monitor.time_s),
            request_message_interval=lambda kind, _interval_s: self.requested.append(kind),
        )  # fmt: skip
        self._per_half_second = per_half_second

    def stop(self) -> int:
        return 0

    def pump(self) -> None:
        self.monitor.time_s += 0.5
        for kind in INTERVALS_S:
            self.monitor.counts[kind] += self._per_half_second.get(kind.__name__, 1)


def test_exactly_as_often_as_needed_is_often_enough() -> None:
    # Attitudes have to come twice a second, positions five times.
    enough = Telling(GlobalPositionInt=3)
    check_telemetry(enough)
    assert enough.requested == []
    with pytest.raises(
        VehicleError,
        match=r"the vehicle sends GlobalPositionInt 4\.0 times a second .* requires 5; the flight was not started",
    ):
        check_telemetry(Telling(GlobalPositionInt=2))
    with pytest.raises(
        VehicleError,
        match=r"the vehicle sends GlobalPositionInt 2\.0 .* and Attitude 0\.0 .* requires 5 and 2; .* was not started",
    ):
        check_telemetry(Telling(Attitude=0))


# Home and position


def talking(home: GeoPoint, here: GeoPoint | None = None) -> SimpleNamespace:
    """A session with a vehicle that says where its home is, and where it is itself."""
    reported = m.HomePosition(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    position = here and m.GlobalPositionInt(1.0, here.lat_deg, here.lon_deg, here.alt_amsl_m, 0.0, 0.0, 0.0, 0.0, 0.0)
    return SimpleNamespace(
        client=SimpleNamespace(request_message=lambda _kind: reported),
        monitor=SimpleNamespace(latest=lambda _kind: position),
    )


@pytest.mark.parametrize(
    ("off_m", "words"),
    [
        ((0.0, 0.0, 0.0), None),
        ((6.0, -7.9, 9.9), None),
        ((0.0, 0.0, -9.9), None),
        ((6.0, -8.1, 0.0), r"is 10\.1 m from the planned home"),
        ((-10.1, 0.0, 0.0), r"is 10\.1 m from the planned home"),
        ((0.0, 10.1, 0.0), r"is 10\.1 m from the planned home"),
        ((0.0, 0.0, 10.1), r"10\.1 m above the planned home"),
        ((0.0, 0.0, -10.1), r"10\.1 m below the planned home"),
    ],
)
def test_home_and_position_are_where_the_plan_has_them(off_m: tuple[float, float, float], words: str | None) -> None:
    plan = plan_for(mission())
    moved = geodetic(off_m)
    check_home(talking(HOME), plan)
    for name, session in (("home", talking(moved)), ("position", talking(HOME, moved))):
        if words is None:
            check_home(session, plan)
        else:
            with pytest.raises(VehicleError, match=f"the vehicle's {name} .*{words}"):
                check_home(session, plan)


@pytest.mark.parametrize(("off_m", "fits"), [(9.9, True), (-9.9, True), (10.1, False), (-10.1, False)])
def test_home_stands_on_the_terrain(off_m: float, fits: bool) -> None:
    plan = plan_for(mission(), ground_alt_amsl_m=HOME.alt_amsl_m + off_m)
    if fits:
        check_home_position(talking(HOME), plan)
    else:
        with pytest.raises(VehicleError, match=r"home is at 312\.5 m above sea level and the terrain there at"):
            check_home_position(talking(HOME), plan)
