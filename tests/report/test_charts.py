"""Values on their places in the picture."""

import dataclasses
import doctest
import re

import numpy as np
import pytest

from uavcover.report import charts
from uavcover.report.charts import FRAMES, Plot, nice_ticks
from uavcover.report.content import ReportContent
from uavcover.report.plots import pareto_front


def points(path: str) -> np.ndarray:
    return np.array([[float(x), float(y)] for x, y in re.findall(r"[ML](\S+?) ([\d.]+)", path)])


def test_doctests() -> None:
    assert doctest.testmod(charts).failed == 0


@pytest.mark.parametrize("low", [-1234.5, 0.0, 3.0, 4e5])
@pytest.mark.parametrize("span", [1e-3, 0.7, 9.0, 1e4])
@pytest.mark.parametrize("about", [4, 8])
def test_ticks_are_round_inside_and_as_many_as_asked(low: float, span: float, about: int) -> None:
    ticks = nice_ticks(low, low + span, about=about)
    assert about / 2.6 <= len(ticks) <= about + 1
    for value, text in ticks:
        assert low - 1e-9 * span <= value <= low + span * (1.0 + 1e-9)
        assert float(text) == pytest.approx(value, abs=1e-6 * span)
    assert len({text for _, text in ticks}) == len(ticks)


@pytest.mark.parametrize("number", range(len(FRAMES)))
def test_the_corners_of_the_ranges_are_the_corners_of_the_picture(number: int) -> None:
    f = FRAMES[number]
    plot = Plot((10.0, 20.0), (-1.0, 1.0))
    plot.line("flown", np.array([10.0, 20.0]), np.array([-1.0, 1.0]), name="a line")
    plot.mark("chosen", 15.0, 0.0, radius=3.0, title="middle")
    chart = plot.finished("c", "C", x_label="x", y_label="y")
    picture = chart.pictures[number]
    assert picture.frame is f
    corners = [[f.left, f.height - f.bottom], [f.width - f.right, f.top]]
    np.testing.assert_allclose(points(picture.lines[0].path), corners)
    middle = (f.left + f.width - f.right) / 2.0, (f.top + f.height - f.bottom) / 2.0
    assert (picture.marks[0].x, picture.marks[0].y) == middle
    assert [(key.style, key.name, key.is_mark) for key in chart.keys] == [("flown", "a line", False)]


def test_a_line_is_broken_where_a_value_is_not_known() -> None:
    plot = Plot((0.0, 4.0), (0.0, 1.0))
    plot.line("flown", np.arange(5.0), np.array([0.0, 1.0, np.nan, 1.0, 0.0]))
    path = plot.finished("c", "C", x_label="", y_label="").wide.lines[0].path
    assert re.sub(r"[^ML]", "", path) == "MLML"


@pytest.mark.parametrize("number", range(len(FRAMES)))
def test_a_long_region_keeps_the_peaks_of_both_its_lines(number: int) -> None:
    f = FRAMES[number]
    x = np.linspace(0.0, 1.0, 50_000)
    low, high = np.zeros(x.size), 5.0 + np.sin(300.0 * x)
    low[12_345], high[40_001] = -3.0, 9.0
    plot = Plot((0.0, 1.0), (-3.0, 9.0))
    plot.between("ground", x, low, high, name="ground")
    (line,) = plot.finished("c", "C", x_label="x", y_label="y").pictures[number].lines
    found = points(line.path)
    assert len(found) < 10_000
    assert (found[:, 1].min(), found[:, 1].max()) == (f.top, f.height - f.bottom)
    width = f.width - f.right - f.left
    np.testing.assert_allclose(found[found[:, 1].argmin(), 0], f.left + x[40_001] * width, atol=0.06)
    np.testing.assert_allclose(found[found[:, 1].argmax(), 0], f.left + x[12_345] * width, atol=0.06)


@pytest.mark.parametrize("number", range(len(FRAMES)))
def test_thinning_keeps_every_peak_end_and_break(number: int) -> None:
    f = FRAMES[number]
    x = np.arange(100_000.0)
    y = np.sin(x / 1000.0)
    y[54_321], y[777], y[90_000:90_010] = 9.0, -9.0, np.nan
    plot = Plot((0.0, 1e5), (-10.0, 10.0))
    plot.line("flown", x, y)
    path = plot.finished("c", "C", x_label="", y_label="").pictures[number].lines[0].path
    positions = points(path)
    assert len(positions) < 1.4 * f.points
    assert path.count("M") == 2
    scale = (f.height - f.top - f.bottom) / 20.0
    np.testing.assert_allclose(np.ptp(positions[:, 1]), 18.0 * scale, atol=0.2)
    np.testing.assert_allclose(positions[[0, -1], 0], [f.left, f.width - f.right], atol=0.1)


def test_a_range_without_width_is_drawn() -> None:
    chart = Plot((5.0, 5.0), (0.0, 0.0)).finished("c", "C", x_label="", y_label="")
    assert chart.x_range == (4.5, 5.5)
    assert all(picture.x_ticks for picture in chart.pictures)


def test_the_trade_off_shows_where_one_chooses(content: ReportContent) -> None:
    chosen = next(member for member in content.members if member.chosen)
    fractions = np.linspace(0.02, 1.0, 60)
    members = tuple(
        dataclasses.replace(
            chosen, index=k, chosen=k == 57, coverage_of_coverable=float(fraction), path_length_m=100.0 * k
        )
        for k, fraction in enumerate(fractions)
    )
    planned = dataclasses.replace(content.planned, coverage_of_coverable=float(fractions[57]))
    plan = content.plan | {"baselines": []}
    near, whole = pareto_front(dataclasses.replace(content, members=members, planned=planned, plan=plan))
    assert len(whole.wide.marks) == 60
    assert near.y_range[0] > 80.0 > 10.0 > whole.y_range[0]
    assert 5 < len(near.wide.marks) < 12
    for chart in (near, whole):
        # The chosen one is drawn last, over the others; and all inside the frame.
        assert [mark.style for mark in chart.wide.marks].index("chosen") == len(chart.wide.marks) - 1
        for picture in chart.pictures:
            f = picture.frame
            assert all(f.left <= mark.x <= f.width - f.right for mark in picture.marks)
            assert all(f.top <= mark.y <= f.height - f.bottom for mark in picture.marks)
    # Nothing to leave out: one chart.
    few = tuple(member for member in members if member.index > 54)
    assert len(pareto_front(dataclasses.replace(content, members=few, planned=planned, plan=plan))) == 1
    assert pareto_front(dataclasses.replace(content, members=())) == ()
