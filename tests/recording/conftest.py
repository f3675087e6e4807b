from pathlib import Path

import pytest

from tests.recording.flights import Flight, make_flight
from uavcover.recording.writer import write_recording


def write(path: Path, flight: Flight) -> Path:
    write_recording(
        path,
        coverage=flight.coverage,
        planned=flight.planned,
        track=flight.track,
        first_observed_s=flight.first_observed_s,
        events=flight.events,
        states=flight.states,
    )
    return path


@pytest.fixture(scope="session")
def flight() -> Flight:
    """Four of eleven lines over the demo's area, so that cells stay unseen."""
    return make_flight("jacksboro", cell_size_m=20.0, line_spacing_m=90.0, speed_m_s=10.0, rate_hz=5.0, lines=4)


@pytest.fixture(scope="session")
def recorded(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("recording") / "flight.rrd", flight)


@pytest.fixture(scope="session")
def nowhere_flight() -> Flight:
    """Over the paper's analytic surface, which has no position on Earth."""
    return make_flight("paper-R2", cell_size_m=0.5, line_spacing_m=2.0, speed_m_s=0.5, rate_hz=5.0)
