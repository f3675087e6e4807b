"""The one comparison of planned and held missions: its tolerances, and missions that other programs loaded from our files."""

import json
import math
import random
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavwp
from pymavlink.dialects.v20 import common as dialect

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.comparison import SAME_POSITION_M, Meaning, compare_items, fault_text, faults, meaning_of
from mission_io.autopilots.mission_lists import stored_item, wire_items
from mission_io.formats import plan, wpl
from mission_io.model.actions import PointGimbal, PointMount, item_of
from mission_io.model.items import (
    Fence,
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    RallyPoints,
    change_speed,
    delay,
    ground_distance_m,
    land,
    look_ahead,
    look_at,
    return_to_launch,
    takeoff,
    trigger_camera_every,
    waypoint,
)
from mission_io.wire.codec import Codec
from mission_io.wire.messages import MissionItemInt, item_from_message

AUTOPILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
HOMES = [(46.5, -7.25), (-33.123456789, 179.99999), (0.0, 0.0), (69.7, -179.99999), (-77.85, 166.7)]


def any_mission(rng: random.Random, *, lat_deg: float, lon_deg: float, px4: bool) -> Mission:
    """A mission with every command that a plan can have, at places with all their digits."""

    def position() -> tuple[float, float, float]:
        return (
            lat_deg + rng.uniform(-0.01, 0.01),
            (lon_deg + rng.uniform(-0.01, 0.01) + 180.0) % 360.0 - 180.0,
            rng.uniform(2.0, 150.0),
        )

    relative = Frame.ABOVE_HOME
    items = [
        takeoff(lat_deg, lon_deg, 20.0, frame=relative),
        change_speed(rng.uniform(1.0, 20.0)),
        item_of(PointMount(-90.0)) if px4 else item_of(PointGimbal(-90.0, 0.0, 0.0, 0.0)),
        look_at(*position(), frame=relative),
        waypoint(
            *position(), frame=relative, hold_s=float(rng.randrange(9)), acceptance_radius_m=rng.uniform(1.0, 5.0)
        ),
        trigger_camera_every(rng.uniform(3.0, 60.0)),
        *(waypoint(*position(), frame=relative) for _ in range(8)),
        delay(float(rng.randrange(1, 20))),
        trigger_camera_every(0.0),
        look_ahead(),
        return_to_launch() if rng.random() < 0.5 else land(*position(), frame=relative),
    ]
    if px4:
        items[4] = replace(items[4], params=(*items[4].params[:3], rng.uniform(0.0, 360.0)))
    home = GeoPoint(lat_deg, lon_deg, rng.uniform(0.0, 3000.0))
    return Mission(home, tuple(items))


def missions(autopilot: Autopilot) -> list[Mission]:
    rng = random.Random(f"compare {autopilot.name}")
    return [any_mission(rng, lat_deg=a, lon_deg=o, px4=autopilot is PX4) for a, o in HOMES]


def held_by(autopilot: Autopilot, sent: list[MissionItem] | tuple[MissionItem, ...]) -> list[MissionItem]:
    """What comes back of what was sent, coordinates rounded to the wire's steps."""
    return [
        replace(i, lat_deg=round(i.lat_deg * 1e7) / 1e7, lon_deg=round(i.lon_deg * 1e7) / 1e7)
        for i in (stored_item(item, autopilot) for item in sent)
    ]


def moved(item: MissionItem, towards_deg: float, by_m: float) -> MissionItem:
    """The item ``by_m`` metres aside, by bisection on the distance that the tests of geodesy hold against pyproj."""
    north, east = math.cos(math.radians(towards_deg)), math.sin(math.radians(towards_deg))

    def at(scale: float) -> MissionItem:
        lon_deg = item.lon_deg + scale * east / math.cos(math.radians(item.lat_deg))
        return replace(item, lat_deg=item.lat_deg + scale * north, lon_deg=lon_deg)

    low, high = 0.0, by_m / 50_000.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        there = at(middle)
        if ground_distance_m(item.lat_deg, item.lon_deg, there.lat_deg, there.lon_deg) < by_m:
            low = middle
        else:
            high = middle
    return at(high)


# Tolerances: just under and just above, for every place of every command.


@pytest.mark.thinned
@AUTOPILOTS
@pytest.mark.parametrize("towards_deg", range(0, 360, 30))
@pytest.mark.no_cover
def test_places_agree_within_two_centimetres_or_a_step_of_the_wire(autopilot: Autopilot, towards_deg: int) -> None:
    looked_at = 0
    for mission in missions(autopilot):
        sent = wire_items(mission, autopilot)
        for number, item in enumerate(sent):
            if not item.has_position or (number == 0 and autopilot.home_in_item_0):
                continue
            for by_m, same in ((0.0199, True), (0.0205, False), (25.0, False)):
                held = list(sent)
                held[number] = moved(item, towards_deg, by_m)
                steps = max(abs(held[number].lat_deg - item.lat_deg), abs(held[number].lon_deg - item.lon_deg)) / 1e-7
                wrong = faults(compare_items(sent, held, autopilot))
                assert (not wrong) == (same or steps <= 1.0), (number, by_m)
                looked_at += 1
                if wrong:
                    assert wrong[0].field in ("lat_deg", "lon_deg")
                    assert wrong[0].size_m == pytest.approx(by_m, rel=1e-3)
    assert looked_at > 100


@AUTOPILOTS
def test_heights_agree_within_two_centimetres(autopilot: Autopilot) -> None:
    for mission in missions(autopilot):
        sent = wire_items(mission, autopilot)
        for number, item in enumerate(sent):
            if not item.has_position or (number == 0 and autopilot.home_in_item_0):
                continue
            for by_m, same in ((0.0199, True), (-0.0199, True), (0.0201, False), (-0.0201, False), (-25.0, False)):
                held = list(sent)
                held[number] = replace(item, alt_m=item.alt_m + by_m)
                wrong = faults(compare_items(sent, held, autopilot))
                assert (not wrong) == same, (number, by_m)
                if wrong:
                    assert wrong[0].size_m == pytest.approx(abs(by_m))


@AUTOPILOTS
def test_a_whole_mission_as_it_is_stored_is_the_same(autopilot: Autopilot) -> None:
    for mission in missions(autopilot):
        sent = wire_items(mission, autopilot)
        assert fault_text(compare_items(sent, held_by(autopilot, sent), autopilot)) is None


ALIKE: dict[Meaning, list[tuple[float, float]]] = {
    Meaning.RESERVED: [(0.0, math.nan), (0.0, 7.0), (-1.0, 1e9)],
    Meaning.NUMBER: [(7.0, 7.0000005), (1e6, 1000000.06)],
    Meaning.OR_DEFAULT: [(0.0, math.nan), (math.nan, 0.0), (3.0, 3.0000005)],
    Meaning.IF_ABOVE_ZERO: [(0.0, -1.0), (-1.0, math.nan), (3.0, 3.0000005)],
    Meaning.IF_NOT_NEGATIVE: [(-1.0, -2.0), (-1.0, math.nan), (0.0, 0.0000005)],
    Meaning.HEADING: [(350.0, -10.0), (0.0, 360.0), (math.nan, math.nan), (0.0000002, 359.9999999)],
}
DIFFERENT: dict[Meaning, list[tuple[float, float]]] = {
    Meaning.NUMBER: [(7.0, 7.00001), (7.0, math.nan), (0.0, -1.0), (1e6, 1000001.0)],
    Meaning.OR_DEFAULT: [(0.0, 0.01), (math.nan, 1.0), (3.0, -3.0), (3.0, 3.00001)],
    Meaning.IF_ABOVE_ZERO: [(0.0, 1.0), (3.0, 3.00001)],
    Meaning.IF_NOT_NEGATIVE: [(-1.0, 0.0), (math.nan, 0.0), (3.0, 3.00001)],
    Meaning.HEADING: [(0.0, math.nan), (350.0, 10.0), (90.0, 90.001), (0.0, 180.0)],
}


@pytest.mark.parametrize("meaning", list(Meaning), ids=lambda m: m.name)
def test_parameters_are_compared_by_what_they_mean(meaning: Meaning) -> None:
    for a, b in ALIKE[meaning]:
        assert meaning.same(a, b), (a, b)
        assert meaning.same(b, a), (a, b)
    for a, b in DIFFERENT.get(meaning, []):
        assert not meaning.same(a, b), (a, b)
        assert not meaning.same(b, a), (a, b)


@pytest.mark.parametrize("number", range(1, 5))
def test_each_parameter_of_each_emitted_command_has_its_meaning(number: int) -> None:
    """PX4 stores what it is given, but for a waypoint's pass radius: what differs there is what the meaning says."""
    mission = missions(PX4)[0]
    for item in mission.items:
        meaning = meaning_of(item.command, number)
        if (item.command, number) == (16, 3):
            continue
        for pairs, same in ((ALIKE[meaning], True), (DIFFERENT.get(meaning, []), False)):
            for a, b in pairs:
                one, other = (
                    replace(item, params=(*item.params[: number - 1], value, *item.params[number:])) for value in (a, b)
                )
                assert (not faults(compare_items([one], [other], PX4))) == same, (item, number, a, b)


def test_what_ardupilot_stores_whole_is_rounded_and_not_made_up() -> None:
    sent = waypoint(46.0, 7.0, 40.0, frame=Frame.ABOVE_HOME, hold_s=2.9)
    for hold_s, same in ((2.0, True), (3.0, True), (2.5, False), (4.0, False), (1.0, False)):
        held = replace(sent, params=(hold_s, 0.0, 0.0, 0.0))
        assert (not faults(compare_items([sent] * 2, [sent, held], ARDUPILOT))) == same, hold_s


@AUTOPILOTS
def test_a_command_without_a_place_means_the_same_in_every_frame(autopilot: Autopilot) -> None:
    for item in (change_speed(8.0), delay(3.0), trigger_camera_every(20.0), return_to_launch()):
        for frame in Frame:
            held = replace(item, frame=frame, lat_deg=0.0, lon_deg=0.0)
            assert fault_text(compare_items([item] * 2, [item, held], autopilot)) is None


# The largest difference comes first.


@AUTOPILOTS
def test_the_largest_difference_is_named_first_with_its_size(autopilot: Autopilot) -> None:
    sent = wire_items(missions(autopilot)[0], autopilot)
    lowered = [replace(i, alt_m=i.alt_m - 25.0) if i.command == 16 and n else i for n, i in enumerate(sent)]
    at = next(n for n, i in enumerate(sent) if n > 6 and i.command == 16)
    lowered[at] = replace(sent[at], alt_m=sent[at].alt_m - 31.5)
    text = fault_text(compare_items(sent, lowered, autopilot)) or ""
    assert text.startswith(f"alt_m in item {at} is ")
    assert ": 31.50 m lower, the largest of " in text
    far = list(sent)
    far[3], far[at] = replace(sent[3], params=(math.inf, 1.0, 1.0, 1.0)), moved(sent[at], 80.0, 43.21)
    assert ": 43.21 m away" in (fault_text(compare_items(sent, far, autopilot)) or "")
    assert (fault_text(compare_items(sent, far[:-1], autopilot)) or "").startswith("count is ")
    assert SAME_POSITION_M == 0.02


# Missions that other programs loaded from our own files.


def by_mavproxy(mission: Mission, autopilot: Autopilot, folder: Path) -> list[MissionItem]:
    """pymavlink's loader, and MAVProxy's way to MISSION_ITEM_INT: ``int`` cuts off, so places come back a step off."""
    file = folder / "mission.waypoints"
    file.write_text(wpl.write_mission(mission), encoding="ascii")
    loader = mavwp.MAVWPLoader()
    loader.load(str(file))
    first = 0 if autopilot.home_in_item_0 else 1
    frames = {3: 6, 0: 5, 10: 11}
    return [
        through_pymavlink(
            replaced(loader.wp(n), seq=n, x=int(loader.wp(n).x * 1.0e7), y=int(loader.wp(n).y * 1.0e7), frames=frames)
        )
        for n in range(first, loader.count())
    ]


def replaced(wp: Any, *, seq: int, x: int, y: int, frames: dict[int, int]) -> tuple[Any, ...]:
    numbers = (wp.param1, wp.param2, wp.param3, wp.param4, x, y, wp.z)
    return (1, 1, seq, frames.get(wp.frame, wp.frame), wp.command, 0, wp.autocontinue, *numbers, 0)


def through_pymavlink(values: tuple[Any, ...]) -> MissionItem:
    """Packed by pymavlink, unpacked by our codec."""
    wire = dialect.MAVLink_mission_item_int_message(*values).pack(dialect.MAVLink(None, srcSystem=255))
    (received,) = Codec(system_id=1, component_id=1).decode(wire)
    assert isinstance(received.message, MissionItemInt)
    return item_from_message(received.message)


def by_mission_planner(mission: Mission, autopilot: Autopilot, folder: Path) -> list[MissionItem]:
    """Its table holds text, its upload casts; every row gets the frame of the height, commands too."""
    del folder
    rows = [line.split("\t") for line in wpl.write_mission(mission).splitlines()[1:]]
    sent = []
    for row in rows if autopilot.home_in_item_0 else rows[1:]:
        lat, lon, alt = (float(text) for text in row[8:11])
        single = struct.unpack("<f", struct.pack("<f", alt))[0]
        frame = 0 if row[0] == "0" else 3
        numbers = [struct.unpack("<f", struct.pack("<f", float(text)))[0] for text in row[4:8]]
        sent.append(
            through_pymavlink(
                (1, 1, int(row[0]), frame, int(row[3]), 0, 1, *numbers, int(lat * 1e7), int(lon * 1e7), single, 0)
            )
        )
    return sent


def by_qgroundcontrol(mission: Mission, autopilot: Autopilot, folder: Path) -> list[MissionItem]:
    """From the .plan: null is NaN, degrees are cast to whole steps, items of a command go in the mission frame."""
    del folder
    document = json.loads(
        plan.write(plan.PlanFile(mission, Fence(()), RallyPoints(()), mav_autopilot=int(autopilot.mav_autopilot)))
    )
    sent = []
    home = document["mission"]["plannedHomePosition"]
    if autopilot.home_in_item_0:
        sent.append((1, 1, 0, 0, 16, 1, 1, 0, 0, 0, 0, int(home[0] * 1e7), int(home[1] * 1e7), home[2], 0))
    for number, item in enumerate(document["mission"]["items"], start=len(sent)):
        numbers = [math.nan if value is None else value for value in item["params"]]
        if item["frame"] != 2:
            numbers[4:6] = [int(value * 1e7) for value in numbers[4:6]]
        numbers[4:6] = [0 if math.isnan(value) else int(value) for value in numbers[4:6]]
        sent.append((1, 1, number, item["frame"], item["command"], 0, 1, *numbers, 0))
    return [through_pymavlink(values) for values in sent]


STATIONS: list[Callable[[Mission, Autopilot, Path], list[MissionItem]]] = [
    by_mavproxy,
    by_mission_planner,
    by_qgroundcontrol,
]


@AUTOPILOTS
@pytest.mark.parametrize("station", STATIONS, ids=lambda s: s.__name__)
def test_a_mission_that_another_station_loaded_from_our_file_is_the_same(
    station: Callable[[Mission, Autopilot, Path], list[MissionItem]], autopilot: Autopilot, tmp_path: Path
) -> None:
    steps = 0
    for mission in missions(autopilot):
        sent = wire_items(mission, autopilot)
        held = held_by(autopilot, station(mission, autopilot, tmp_path))
        assert fault_text(compare_items(sent, held, autopilot)) is None
        ours = held_by(autopilot, sent)
        steps += sum(a.lat_deg != b.lat_deg for a, b in zip(ours, held, strict=True))
    assert steps > 5, "the other station rounds as we do: nothing was tested"


@AUTOPILOTS
@pytest.mark.parametrize("station", STATIONS, ids=lambda s: s.__name__)
@pytest.mark.no_cover
def test_what_another_station_changed_is_not_the_same(
    station: Callable[[Mission, Autopilot, Path], list[MissionItem]], autopilot: Autopilot, tmp_path: Path
) -> None:
    for mission in missions(autopilot):
        sent = wire_items(mission, autopilot)
        for number, item in enumerate(mission.items):
            if not item.has_position:
                continue
            for change in ({"alt_m": item.alt_m - 0.05}, {"lat_deg": item.lat_deg + 6e-7}, {"frame": Frame.AMSL}):
                other = replace(
                    mission, items=(*mission.items[:number], replace(item, **change), *mission.items[number + 1 :])
                )
                held = held_by(autopilot, station(other, autopilot, tmp_path))
                if station is by_mission_planner and "frame" in change:
                    continue  # the stand-in gives every row the same frame
                assert faults(compare_items(sent, held, autopilot)), (number, change)


def test_pymavlinks_own_file_has_six_decimals_and_is_refused_for_the_six_centimetres(tmp_path: Path) -> None:
    mission = missions(ARDUPILOT)[0]
    ours, theirs = tmp_path / "ours.waypoints", tmp_path / "theirs.waypoints"
    ours.write_text(wpl.write_mission(mission), encoding="ascii")
    loader = mavwp.MAVWPLoader()
    loader.load(str(ours))
    loader.save(str(theirs))
    again = wpl.read(theirs.read_text(encoding="ascii")).mission()
    wrong = faults(compare_items(wire_items(mission, ARDUPILOT), wire_items(again, ARDUPILOT), ARDUPILOT))
    assert wrong
    assert 0.02 < wrong[0].size_m < 0.08
    assert {d.field for d in wrong} <= {"lat_deg", "lon_deg"}


def test_a_free_heading_is_kept_by_a_plan_and_lost_by_waypoints(tmp_path: Path) -> None:
    """For PX4 a heading of 0 is north: only its own file keeps it free. ArduPilot has no heading to lose."""
    for autopilot in (ARDUPILOT, PX4):
        items = (waypoint(46.0, 7.0, 40.0, frame=Frame.ABOVE_HOME),) * 2
        mission = Mission(
            GeoPoint(46.0, 7.0, 500.0), tuple(replace(i, params=(0.0, 0.0, 0.0, math.nan)) for i in items)
        )
        sent = wire_items(mission, autopilot)
        by_plan = held_by(autopilot, by_qgroundcontrol(mission, autopilot, tmp_path))
        by_waypoints = held_by(autopilot, by_mavproxy(mission, autopilot, tmp_path))
        assert fault_text(compare_items(sent, by_plan, autopilot)) is None
        lost = [d.field for d in faults(compare_items(sent, by_waypoints, autopilot))]
        assert lost == ([] if autopilot is ARDUPILOT else ["param4", "param4"])
