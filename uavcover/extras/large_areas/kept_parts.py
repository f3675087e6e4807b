"""Finished routes of parts, kept in the run folder, so that a plan continues after its process was killed.

The search in a part is a function of its task, of the site and of the program alone, and the name of a file is a hash of all
three. So what is kept is right for any later plan with the same inputs, and is never taken for anything else.
"""

import dataclasses
import hashlib
import io
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.extras.large_areas.part_search import PartTask
from uavcover.extras.large_areas.plan_by_parts import RunTasks
from uavcover.kernels.arrays import FloatArray
from uavcover.run.file_group import remove_half_written, write_file
from uavcover.run.program import program
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import Site

_DIGEST_BYTES = 32


class KeptParts:
    """A folder with the routes of parts.

    Attributes:
        path: where it is; made when the first route is kept.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def before(self, run_tasks: RunTasks, *, is_whole: Callable[[], bool]) -> RunTasks:
        """Search function that returns kept routes, has the others searched for, and keeps them.

        Args:
            run_tasks: who searches.
            is_whole: whether what comes now is what the task asks for, and not what there was when the user ended the search.
        """

        def run(site: Site, tasks: Sequence[PartTask]) -> Iterator[tuple[PartTask, FloatArray]]:
            remove_half_written(self.path.glob("*"))
            of_site = _site_sha256(site)
            files = {task.number: self.path / _name(task, of_site) for task in tasks if task.budget_s is None}
            missing = []
            for task in tasks:
                route_m = _read(files[task.number]) if task.number in files else None
                if route_m is None:
                    missing.append(task)
                else:
                    yield task, route_m
            for task, route_m in run_tasks(site, missing):
                if task.number in files and is_whole():
                    _write(files[task.number], route_m)
                yield task, route_m

        return run


def _name(task: PartTask, of_site: str) -> str:
    found = hashlib.sha256(f"{of_site} {json.dumps(program(), sort_keys=True)}".encode())
    _add(found, dataclasses.astuple(task))
    return f"{task.round}-{task.number}-{found.hexdigest()[:32]}.route"


def _site_sha256(site: Site) -> str:
    found = hashlib.sha256(dump_scenario(site.scenario).encode())
    for value in (site.ground.surface, site.bare_ground.surface, site.home_m):
        _add(found, value)
    return found.hexdigest()


def _add(found: Any, value: object) -> None:
    """Add numbers, bytes and arrays to a hash, so that different ones differ in what is added."""
    if isinstance(value, tuple | list):
        found.update(f"({len(value)}".encode())
        for each in value:
            _add(found, each)
    elif isinstance(value, np.ndarray):
        found.update(f"{value.dtype.str}{value.shape}".encode())
        found.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8))
    elif isinstance(value, bytes):
        found.update(f"b{len(value)}".encode() + value)
    else:
        found.update(f";{value!r};".encode())


def _write(path: Path, route_m: FloatArray) -> None:
    content = io.BytesIO()
    np.save(content, np.ascontiguousarray(route_m), allow_pickle=False)
    write_file(path, hashlib.sha256(content.getvalue()).digest() + content.getvalue())


def _read(path: Path) -> FloatArray | None:
    """A route that was kept; none where there is no whole one."""
    try:
        raw = path.read_bytes()
    except OSError:
        return None
    if len(raw) <= _DIGEST_BYTES or hashlib.sha256(raw[_DIGEST_BYTES:]).digest() != raw[:_DIGEST_BYTES]:
        return None
    route_m: FloatArray = np.load(io.BytesIO(raw[_DIGEST_BYTES:]), allow_pickle=False)
    return route_m
