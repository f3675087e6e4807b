"""``plan --memory``: parts and workers within a limit."""

import dataclasses

import pytest

from uavcover.errors import InputError
from uavcover.extras.large_areas.divided_plan import (
    MIB,
    MemoryNeed,
    at_a_time_within,
    count_text,
    memory_need,
    parts_within,
)
from uavcover.new.quantities import memory_bytes
from uavcover.planner.plan_search import SearchRequest, plan
from uavcover.scenario.site import Site, load_site

GIB = 1024 * MIB
NEED = MemoryNeed(command=500.0 * MIB, worker=0.0, cells=1_000_000.0)
BESIDE = dataclasses.replace(NEED, worker=300.0 * MIB)


@pytest.fixture(scope="module")
def site() -> Site:
    return load_site("ridge-obstacles")


def within(limit: int, **changes: int | bool) -> int:
    required = {"parts": 1, "most_parts": 1000, "given": False, **changes}
    return parts_within(
        NEED, limit, parts=required["parts"], most_parts=required["most_parts"], given=bool(required["given"])
    )


def test_more_memory_means_fewer_parts_and_none_breaks_the_limit() -> None:
    limits = [520 * MIB, 560 * MIB, 700 * MIB, GIB, 4 * GIB]
    counts = [within(limit) for limit in limits]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[1] > 1
    assert counts[-1] == 1
    for limit, count in zip(limits, counts, strict=True):
        assert NEED.total(count, 1) <= limit
        assert count == 1 or NEED.total(count - 1, 1) > limit


def test_parts_that_fit_stay_as_they_are() -> None:
    assert within(4 * GIB, parts=7) == 7
    assert within(4 * GIB, parts=7, given=True) == 7


def test_a_number_that_was_asked_for_is_refused_with_one_that_would_do() -> None:
    with pytest.raises(
        InputError, match=r"--memory: 2 parts take about .* MiB; use --parts \d+ or --parts auto"
    ) as error:
        within(600 * MIB, parts=2, given=True)
    enough = int(str(error.value).split("--parts ")[1].split()[0])
    assert NEED.total(enough, 1) <= 600 * MIB < NEED.total(enough - 1, 1)


def test_too_little_for_any_number_of_parts_is_refused_with_what_it_takes() -> None:
    with pytest.raises(InputError, match=r"planning 1,000,000 cells takes at least about 510 MiB"):
        within(499 * MIB)
    with pytest.raises(InputError, match="takes at least about 710 MiB"):
        within(600 * MIB, most_parts=2)


def test_as_many_at_a_time_as_fit_but_one_at_least() -> None:
    assert at_a_time_within(NEED, 4 * GIB, parts=8, workers=3) == 3
    for limit in (900 * MIB, 1500 * MIB, 2 * GIB):
        for need in (NEED, BESIDE):
            count = at_a_time_within(need, limit, parts=8, workers=50)
            assert count == 1 or need.total(8, count) <= limit < need.total(8, count + 1)
    assert at_a_time_within(BESIDE, 600 * MIB, parts=8, workers=4) == 1


def test_the_need_grows_with_cells_and_with_processes_beside_it(site: Site) -> None:
    fine = dataclasses.replace(site.scenario.area, cell_size_m=0.5 * site.scenario.area.cell_size_m)
    finer = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, area=fine))
    need, four_times = memory_need(site, processes=False), memory_need(finer, processes=False)
    assert four_times.cells == pytest.approx(4.0 * need.cells)
    assert four_times.command > need.command
    assert need.worker == 0.0
    assert memory_need(site, processes=True).worker > 100 * MIB


def test_an_area_that_is_judged_block_by_block_takes_less(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = memory_need(site, processes=True)
    monkeypatch.setattr("uavcover.sensing.site_maps._MOST_AT_ONCE", 0)
    monkeypatch.setattr("uavcover.extras.large_areas.divided_plan._OF_BLOCKS", 0)
    blocks = memory_need(site, processes=True)
    assert blocks.command < whole.command
    assert dataclasses.replace(blocks, command=whole.command) == whole


def test_elevation_data_is_counted_once_where_workers_map_it(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = site.ground.surface.up_m.size
    needs = {}
    for shared in (True, False):
        monkeypatch.setattr("uavcover.extras.large_areas.divided_plan.can_share_files", lambda shared=shared: shared)
        needs[shared] = memory_need(site, processes=True)
    assert needs[True].command - memory_need(site, processes=False).command == 8 * nodes
    assert needs[False].worker - needs[True].worker == 24 * nodes


def test_workers_elsewhere_have_a_memory_of_their_own(site: Site) -> None:
    request = SearchRequest(memory_bytes=GIB, scheduler="tcp://127.0.0.1:1", parts=2)
    with pytest.raises(InputError, match=r"--memory applies only here.*dask worker --memory-limit"):
        plan(site, request)


@pytest.mark.parametrize(
    ("text", "bytes_"), [("4GiB", 4 * GIB), ("1.5 gib", 1536 * MIB), ("800MiB", 800 * MIB), ("2GB", 2_000_000_000)]
)
def test_sizes_are_understood(text: str, bytes_: int) -> None:
    assert memory_bytes(text, option="--memory") == bytes_


@pytest.mark.parametrize("text", ["4", "GiB", "-4GiB", "0GiB", "0.5MiB", "4G", "nan GiB", "1e9GiB"])
def test_other_sizes_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"--memory: .*4GiB"):
        memory_bytes(text, option="--memory")


def test_sizes_in_words_are_never_less() -> None:
    assert [count_text(size) for size in (1.0, 10.0 * MIB, 10.1 * MIB, 1.01 * GIB, 16.0 * GIB)] == [
        "10 MiB", "10 MiB", "20 MiB", "1.1 GiB", "16.0 GiB",
    ]  # fmt: skip
