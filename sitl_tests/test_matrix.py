"""Every cell of the matrix as a test; simulators that are not there skip and say how they could be."""

from pathlib import Path

import pytest

from sitl_tests.errors import MissingSimulatorError
from sitl_tests.matrix import Cell, load_matrix
from sitl_tests.run import run_cell

_WATCHDOG_S = 600
_LONG_WATCHDOG_S = 7200


def _once_more_by_mavsdk(cell: Cell) -> bool:
    return cell.name.endswith("-mavsdk") and "mission-round-trip" not in cell.name


def _parameters() -> list[object]:
    return [
        pytest.param(
            cell,
            id=cell.name,
            marks=[
                pytest.mark.timeout(_LONG_WATCHDOG_S if cell.long else _WATCHDOG_S),
                *([pytest.mark.long] if cell.long or _once_more_by_mavsdk(cell) else []),
            ],
        )
        for cell in load_matrix()
    ]


@pytest.mark.parametrize("cell", _parameters())
def test_the_vehicle_does_what_the_matrix_says(cell: Cell, tmp_path: Path) -> None:
    try:
        result = run_cell(cell, tmp_path / cell.name)
    except MissingSimulatorError as error:
        pytest.skip(str(error))
    assert result.finding.outcome == cell.expected.outcome, result.finding.detail
