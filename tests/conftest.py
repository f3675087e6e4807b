"""What all tests share: hypothesis draws the same examples every time, and is patient on a machine with other work."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    "uavcover", derandomize=True, deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("uavcover")
