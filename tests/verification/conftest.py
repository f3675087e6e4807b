import pytest

from tests.planner.sites import flat, hills
from tests.verification.flights import Flight, make_site


@pytest.fixture(scope="module")
def level() -> Flight:
    return Flight(make_site(flat))


@pytest.fixture(scope="module")
def flight(level: Flight) -> Flight:
    return level


@pytest.fixture(scope="module")
def hilly() -> Flight:
    return Flight(make_site(hills))
