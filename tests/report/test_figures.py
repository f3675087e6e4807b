"""Figures as files."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from uavcover.errors import OutputError
from uavcover.report.content import ReportContent
from uavcover.report.plots import FIGURE_NAMES, save_figures, save_pareto_plot
from uavcover.terrain.ground import grid_ground, relief_grid


def test_both_views_are_drawn_and_equal_again(content: ReportContent, tmp_path: Path) -> None:
    drawn = save_figures(content, tmp_path / "a")
    assert [path.name for path in drawn] == list(FIGURE_NAMES)
    for path in drawn:
        photo = np.asarray(Image.open(path).convert("RGB")).astype(int)
        orange = (photo[..., 0] > 190) & (photo[..., 1] < 120) & (photo[..., 2] < 40)
        assert orange.sum() > 200, "the flown track"
    again = save_figures(content, tmp_path / "b")
    assert [path.read_bytes() for path in drawn] == [path.read_bytes() for path in again]


def test_the_formats_of_the_pareto_plot(content: ReportContent, tmp_path: Path) -> None:
    for name, start in (("p.png", b"\x89PNG"), ("p.svg", b"<?xml"), ("p.pdf", b"%PDF")):
        path = save_pareto_plot(content.members, content.plan, tmp_path / name)
        assert path.read_bytes().startswith(start)
    with pytest.raises(OutputError, match=r"p\.bmp.*use \.png, \.svg or \.pdf"):
        save_pareto_plot(content.members, content.plan, tmp_path / "p.bmp")
    with pytest.raises(OutputError, match="missing"):
        save_pareto_plot(content.members, content.plan, tmp_path / "missing" / "p.png")


def test_relief_goes_north_and_east() -> None:
    up = np.add.outer(np.arange(0.0, 100.0, 10.0), np.zeros(10))
    ground = grid_ground(up, east0_m=0.0, north0_m=0.0, step_m=10.0, source="", vertical_datum="local")
    grid = relief_grid(ground, (10.0, 20.0, 80.0, 60.0), nodes=8)
    np.testing.assert_allclose(grid.up_m, grid.north_m)
    assert grid.up_m.shape == (5, 8)
    assert (grid.east_m[0, 0], grid.north_m[0, 0], grid.east_m[-1, -1], grid.north_m[-1, -1]) == (
        10.0,
        20.0,
        80.0,
        60.0,
    )
