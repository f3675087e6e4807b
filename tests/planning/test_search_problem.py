import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.planning.sites import with_scenario
from tests.terrain_kinds import write_scenario
from uavcover.planning.search.memetic import _search_problem
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import judging_map, planning_map


@pytest.mark.parametrize("fewest_places", [0, 25_000])
def test_at_waypoints_a_search_sees_what_judges_see_where_these_have_smaller_cells(
    fewest_places: int, tmp_path: Path
) -> None:
    site = load_site(str(write_scenario(tmp_path, "canyon", "sphere")))
    site = with_scenario(site, area=dataclasses.replace(site.scenario.area, fewest_places=fewest_places))
    planning = planning_map(site)
    cells = _search_problem(planning, judging_map(site)).numbers.cells
    assert np.array_equal(cells.centre_m, planning.grid.cells.centre_m) is (fewest_places == 0)
