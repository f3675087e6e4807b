import math
import struct
import time
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_io.autopilots.comparison import Edit, MissionDiff, apply_diff, apply_edits, diff, diff_items
from mission_io.errors import MisuseError
from mission_io.model.items import Frame, GeoPoint, Mission, MissionItem, delay, items_from_fence
from tests.mission_io.formats.samples import FENCE, HOME, MISSION

_FEW = [delay(float(n)) for n in range(4)] + [
    replace(delay(0.0), alt_m=-0.0), replace(delay(0.0), alt_m=float("nan")), replace(delay(0.0), autocontinue=False),
]  # fmt: skip
_HOMES = st.none() | st.builds(GeoPoint, *[st.sampled_from([0.0, -0.0, 1.5, float("nan")])] * 3)
_MISSIONS = st.builds(Mission, _HOMES, st.lists(st.sampled_from(_FEW), max_size=12).map(tuple))


def bits(mission: Mission) -> object:
    home = mission.home
    return (
        home and struct.pack("<3d", home.lat_deg, home.lon_deg, home.alt_amsl_m),
        [(i.command, i.frame, struct.pack("<7d", *(v for _, v in i.values())), i.autocontinue) for i in mission.items],
    )


@settings(derandomize=True, max_examples=500)
@given(_MISSIONS, _MISSIONS)
def test_a_difference_loses_nothing_and_can_be_taken_back(a: Mission, b: Mission) -> None:
    change = diff(a, b)
    assert bits(apply_diff(change, a)) == bits(b)
    assert bits(apply_diff(change.inverse(), b)) == bits(a)
    assert bool(change) == (bits(a) != bits(b))
    assert not diff(a, a)


def test_a_difference_is_as_small_as_the_change() -> None:
    items = MISSION.items
    moved = replace(items[3], alt_m=70.0)
    other = replace(MISSION, items=(*items[:3], moved, *items[4:6], delay(3.0), *items[6:]))
    assert diff(MISSION, other) == MissionDiff(None, (Edit(3, (items[3],), (moved,)), Edit(6, (), (delay(3.0),))))
    higher = replace(HOME, alt_amsl_m=1.0)
    assert diff(MISSION, replace(MISSION, home=higher)) == MissionDiff((HOME, higher), ())


def test_fences_and_rally_points_differ_as_item_lists() -> None:
    old = items_from_fence(FENCE)
    new = items_from_fence(replace(FENCE, circles=()))
    (edit,) = diff_items(old, new)
    assert [item.command for item in edit.removed] == [5004]
    assert apply_edits((edit,), old) == new


def test_a_change_only_fits_the_mission_it_was_made_from() -> None:
    change = diff(MISSION, replace(MISSION, items=MISSION.items[1:]))
    with pytest.raises(MisuseError, match="does not match the mission at item 0"):
        apply_diff(change, replace(MISSION, items=MISSION.items[2:]))
    with pytest.raises(
        MisuseError, match="the change belongs to a mission with a different home; create it again from"
    ):
        apply_diff(diff(MISSION, replace(MISSION, home=None)), replace(MISSION, home=replace(HOME, lat_deg=1.0)))
    late = (Edit(0, MISSION.items[:2], ()), Edit(1, MISSION.items[1:2], ()))
    with pytest.raises(MisuseError, match="does not match the mission at item 1"):
        apply_edits(late, MISSION.items)


@pytest.mark.parametrize("kind", ["reversed", "all equal", "pairs"])
@pytest.mark.no_cover
def test_long_lists_take_time_in_proportion(kind: str) -> None:
    def seconds(count: int) -> float:
        items: list[MissionItem] = [delay(float(n if kind == "reversed" else n // 2)) for n in range(count)]
        old = [delay(1.0)] * count if kind == "all equal" else items
        new = [delay(1.0)] * (count // 2) if kind == "all equal" else items[::-1]
        best = float("inf")
        for _ in range(3):
            start = time.process_time()
            edits = diff_items(old, new)
            best = min(best, time.process_time() - start)
        assert list(apply_edits(edits, old)) == new
        return best

    assert seconds(16_000) < 10.0 * seconds(4_000) + 0.05


def test_a_difference_as_text() -> None:
    change = diff(MISSION, replace(MISSION, items=(MISSION.items[0], *MISSION.items[2:])))
    lines = str(change).splitlines()
    assert len(lines) == sum(len(edit.removed) + len(edit.inserted) for edit in change.edits)
    assert all(line[:2] in ("- ", "+ ") for line in lines)
    assert str(diff(MISSION, MISSION)) == "no difference"
    unknown = MissionItem(31999, Frame.COMMAND, (1.5, math.nan, 0.0, 0.0))
    assert str(MissionDiff(None, (Edit(0, (), (unknown,)),))) == "+ 1 command 31999(1.5, nan, 0.0, 0.0, 0.0, 0.0, 0.0)"
    moved = MissionDiff((HOME, None), ())
    assert str(moved) == f"- home {HOME.lat_deg}, {HOME.lon_deg}, {HOME.alt_amsl_m} m AMSL\n+ home unknown"
