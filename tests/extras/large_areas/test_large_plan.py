"""A plan of a large area, judged block by block from the search to the files of its sorties, is that of one piece."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.planner.sites import hills, make_site
from uavcover import UNATTENDED
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.sensing import site_maps

RING = ((0.0, 0.0), (700.0, 0.0), (700.0, 500.0), (0.0, 500.0))
PLANNER = {"algorithm": "memetic", "evaluations": 20, "population_size": 20, "parts": 2}


def documents(folder: Path) -> dict[str, Any]:
    site = make_site(hills, ring=RING, home=(350.0, 240.0), planner=PLANNER, vehicle={"endurance_s": 370.0})
    plan_into(
        PlanRequest(scenario=site, folder=folder, command=["test"], force=False, select="coverage>=0.9"),
        UNATTENDED,
        check_site=lambda _: None,
    )
    found = {str(path.relative_to(folder)): json.loads(path.read_text()) for path in sorted(folder.rglob("plan.json"))}
    for document in found.values():
        del document["wall_s"]
    return found


def test_a_plan_of_blocks_is_the_plan_of_one_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = documents(tmp_path / "whole")
    monkeypatch.setattr(site_maps, "_MOST_AT_ONCE", 100)
    monkeypatch.setattr(site_maps, "_BLOCK_CELLS", 700)
    made = []
    real = site_maps.BlockMap.look_at
    monkeypatch.setattr(site_maps.BlockMap, "look_at", lambda *given: [made.append(given), real(*given)][1])
    blocks = documents(tmp_path / "blocks")
    assert made
    assert len(whole) > 2  # sorties
    # Proving bounds for a large area takes long, and is left to --bounds.
    assert "shortest_path_m" in whole["plan.json"]["bounds"]
    for found in (whole, blocks):
        found["plan.json"]["bounds"].pop("shortest_path_m", None)
    assert blocks == whole
