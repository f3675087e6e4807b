import csv
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "kill_fly.py"


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_killed_flight_leaves_its_track_and_its_recording(planned: Path, tmp_path: Path) -> None:
    out = tmp_path / "killed.md"
    arguments = ["--run", planned, "--kills", 2, "--seed", 1, "--speed", 20, "-o", out]
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *map(str, arguments)],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    with out.with_suffix(".csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2
    for row in rows:
        assert int(row["in_recording"]) > 100
        assert 0.99 * int(row["sent"]) - 1 <= int(row["in_track"]) <= int(row["sent"])
        assert max(float(row["track_lost_s"]), float(row["recording_lost_s"])) <= 1.0
        assert (row["verify_track"], row["verify_recording"], row["inspect"]) == ("1", "1", "0")
    assert not list(planned.glob("track.csv")), "copies are flown"
