"""What all tests share: hypothesis draws the same examples every time, and is patient on a machine with other work."""

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

from tests.long import mark_long_what_is_listed
from tests.thinned import mark_long_what_is_not_needed

settings.register_profile(
    "uavcover", derandomize=True, deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("uavcover")

# `derandomize` is not enough: hypothesis also draws constants that it reads from the source of every local module imported
# so far, so its examples would depend on which test files a process has loaded. A hook of that name has to be there: without
# it the constants come from elsewhere. tests/test_same_examples.py shows that this is enough.
if not callable(getattr(providers, "_get_local_constants", None)):
    raise RuntimeError(
        "this version of hypothesis collects the constants of local modules elsewhere: see tests/conftest.py"
    )
NO_CONSTANTS = providers.Constants()
providers._get_local_constants = lambda: NO_CONSTANTS

LONG = (
    "tests/test_setup.py", "tests/test_wheel.py", "tests/kernels/test_route_state.py", "tests/cli/test_fly.py",
    "tests/cli/test_verify.py", "tests/cli/test_plan.py", "sitl_tests/", "tests/cli/", "tests/flight/", "tests/mock/",
    "tests/planner/test_memetic.py", "tests/mission_io/test_presets.py",
)  # fmt: skip
"""Files and folders that take long, the longest first: begun last, one of them would keep a single process busy at the end."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, the others in their order."""
    mark_long_what_is_not_needed(items)
    mark_long_what_is_listed(items)
    items.sort(key=lambda item: next((k for k, name in enumerate(LONG) if item.nodeid.startswith(name)), len(LONG)))


@pytest.fixture
def attitudes_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Attitudes count unconfirmed: tracks that take corners in no time, or fly one long curve, have no lean to confirm."""
    monkeypatch.setattr("uavcover.verification.attitude._unconfirmed", lambda *_: None)
