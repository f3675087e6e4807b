import json
import re
import signal
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import WATCHDOG_S, Cli, command, mock_vehicle, started, wait_for_line

DEM = "uavcover/data/jacksboro.tif"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_serves_until_it_is_told_to_stop_and_says_how_much(number: signal.Signals) -> None:
    with mock_vehicle("-q", "--behaviour", "observed", "--speed", "20") as (port, _):
        arguments = command("terrain-server", "--dem", DEM, "--to", f"udpout://127.0.0.1:{port}")
        with started(arguments) as server:
            wait_for_line(server, "terrain block; sent")
            server.send_signal(number)
            out, err = server.communicate(timeout=WATCHDOG_S)
    assert server.returncode == 0
    reported = re.search(r"for 1 block; sent parts: (\d+); parts not sent because data is missing: 0", out)
    assert reported is not None
    assert int(reported[1]) >= 56  # it asks 20 times as often, and again for what is on its way
    assert err.strip() == "stopping"


def test_json_has_the_counts_and_the_end_of_the_data_is_said() -> None:
    with mock_vehicle("-q", "--behaviour", "observed", "--speed", "20", "--home", "36.73,-84.2,400") as (port, _):
        arguments = command("terrain-server", "--dem", DEM, "--to", f"udpout://127.0.0.1:{port}", "--json")
        with started(arguments) as server:
            assert server.stderr is not None
            observed = next(line for line in server.stderr if "keeps waiting" in line)
            server.send_signal(signal.SIGINT)
            out, _ = server.communicate(timeout=WATCHDOG_S)
    document = json.loads(out)
    assert server.returncode == 0
    assert document["blocks"] == document["blocks_incomplete"] == 1
    assert document["vertical_datum"] in ("EGM96", "EGM2008")
    assert "no elevation data for" in observed


@pytest.mark.parametrize(
    ("arguments", "code", "telling"),
    [
        ((), 2, "--dem: specify elevation data"),
        (("--dem", "nowhere.tif"), 2, "nowhere.tif: no such file"),
        (("--dem", "tests/naive"), 2, "contains no tile"),
        (("--dem", "README.md"), 2, "README.md: the file cannot be read as elevation data"),
        (("--dem", DEM, "--vertical-datum", "WGS84"), 2, "must be EGM96 (SRTM), EGM2008 (Copernicus) or ellipsoid"),
        (("--dem", DEM, "--vertical-datum", "EGM2008"), 2, "omit this option"),
        (("--dem", DEM, "--height-unit", "fathoms"), 2, "unknown unit 'fathoms'; use m, dm, cm, ft or us-ft"),
        (("--dem", DEM, "--band", "7"), 2, "has no band '7'"),
        (("--dem", DEM, "--timeout", "0.1"), 3, "no vehicle sent a heartbeat"),
    ],
)
def test_bad_input_is_one_line(cli: Cli, arguments: tuple[str, ...], code: int, telling: str) -> None:
    ended = cli("terrain-server", *arguments, "--to", "udpin://127.0.0.1:0")
    assert ended.code == code
    assert telling in ended.error


def test_a_run_answers_by_itself(planned: Path, cli: Cli) -> None:
    """plan-upload from the scenario's own files, which reach farther than the ground that was read for planning."""
    from mission_io.protocol.terrain import position_in_block, positions_of_block
    from uavcover.flight.connect import connect, heights_of_site, home_of
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import RunFolder

    site, _ = read_planned(RunFolder(planned))
    home = home_of(site)
    assert home is not None
    with connect("mock:", site) as connected:
        assert len(connected.client.services) == 1
    heights = heights_of_site(site, lambda text: pytest.fail(text))
    assert heights is not None
    corner = position_in_block(home.lat_deg, home.lon_deg, 100).block.corner_e7
    found = heights(positions_of_block(corner[0] / 1e7, corner[1] / 1e7, 100))
    assert np.isfinite(found).all()
    assert heights([(home.lat_deg, home.lon_deg)])[0] == pytest.approx(home.alt_amsl_m, abs=0.2)
    cli("plan-upload", planned, "--to", "mock:", code=0)
