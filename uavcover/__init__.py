"""Plan UAV flights that see all of a rugged terrain, fly them, and prove what was seen.

The whole chain, on a run folder that every ``uavcover`` command understands too::

    import uavcover as uc

    site = uc.load_site("jacksboro")
    plan = uc.plan(site, out="RUN", evaluations=40)
    with uc.connect("mock:", site) as vehicle:
        uc.upload(vehicle, "RUN")
        track = uc.fly(vehicle, "RUN")
    verdict = uc.verify("RUN")
    gaps = uc.find_gaps("RUN")
    uc.write_report("RUN")

What stands in ``__all__`` is public; everything else may change. Names are loaded when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uavcover.api import (
        compile_mission,
        find_gaps,
        fly,
        plan,
        select,
        upload,
        verify,
        verify_track,
    )
    from uavcover.errors import InfeasibleError, InputError, UavcoverError, VehicleError
    from uavcover.flight.command import FlightOptions
    from uavcover.flight.connect import VehicleLink, connect
    from uavcover.model.route import Plan, Route
    from uavcover.model.track import Track
    from uavcover.report.page import write_report
    from uavcover.scenario.site import Site, load_site
    from uavcover.verification.verify import Verdict

__all__ = [
    "FlightOptions",
    "InfeasibleError",
    "InputError",
    "Plan",
    "Route",
    "Site",
    "Track",
    "UavcoverError",
    "VehicleError",
    "VehicleLink",
    "Verdict",
    "compile_mission",
    "connect",
    "find_gaps",
    "fly",
    "load_site",
    "plan",
    "select",
    "upload",
    "verify",
    "verify_track",
    "write_report",
]

_PLACES = {
    "uavcover.errors": ("InfeasibleError", "InputError", "UavcoverError", "VehicleError"),
    "uavcover.verification.verify": ("Verdict",),
    "uavcover.model.route": ("Plan", "Route"),
    "uavcover.model.track": ("Track",),
    "uavcover.report.page": ("write_report",),
    "uavcover.api": (
        "compile_mission", "find_gaps", "fly", "plan", "select", "upload", "verify", "verify_track",
    ),
    "uavcover.flight.command": ("FlightOptions",),
    "uavcover.flight.connect": ("VehicleLink", "connect"),
    "uavcover.scenario.site": ("Site", "load_site"),
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """The public names, each loaded with what it needs when it is first used."""
    for module, names in _PLACES.items():
        if name in names:
            value = getattr(import_module(module), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
