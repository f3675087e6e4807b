"""Uploading a run's mission: check, send, read back, compare."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from mission_io.client.client import Client
from mission_io.client.read_back import ReadBack
from uavcover.routes.mission_compiler import CompiledMission
from uavcover.run.folder import SCHEMA_VERSION
from uavcover.scenario.site import Site
from uavcover.vehicle.modes import require_multirotor


def upload(
    client: Client,
    compiled: CompiledMission,
    *,
    progress: Callable[[str, int, int], None] | None = None,
    in_flight: bool = False,
) -> list[ReadBack]:
    """Upload mission, fence and rally points, read each back and compare.

    Args:
        client: connected, with a vehicle found.
        compiled: what to send.
        progress: told the list's name, items across and items in all.
        in_flight: whether an armed vehicle is meant.

    Raises:
        VehicleError: the vehicle is no multirotor; nothing was sent.
        MissionIoError: the vehicle refused, or fell silent; says what it holds now.
    """
    require_multirotor(client)
    results = []
    for name, content in (("mission", compiled.mission), ("fence", compiled.fence), ("rally", compiled.rally)):
        results.append(client.upload_and_verify(content, progress=_named(progress, name), in_flight=in_flight))
    return results


def _named(progress: Callable[[str, int, int], None] | None, name: str) -> Callable[[int, int], None] | None:
    return None if progress is None else partial(progress, name)


def upload_document(site: Site, compiled: CompiledMission, url: str, results: Sequence[ReadBack]) -> dict[str, Any]:
    """``upload.json``: what was sent, what came back, every difference and why it is or is not acceptable."""
    limit = compiled.max_height_above_home_m + 10.0
    return {
        "schema_version": SCHEMA_VERSION,
        "name": site.scenario.name,
        "url": url,
        "passed": all(result.passed for result in results),
        "first_waypoint_item": compiled.first_waypoint_item,
        "waypoint_count": compiled.waypoint_count,
        "return_advice": dataclasses.asdict(compiled.return_advice),
        "autopilot_max_height_above_home_m": limit,
        "lists": [result.as_json() for result in results],
    }
