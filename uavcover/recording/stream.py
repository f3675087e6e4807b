"""Sending to a recording in an order that is the same every time."""

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from uavcover.recording.layout import TIMELINE
from uavcover.site import Site


def log_static(recording: rr.RecordingStream, entity: str, *parts: rr.AsComponents) -> None:
    """Log what does not change in time.

    Single calls go through a batching thread and columns do not; without waiting for it here, two recordings of one
    flight would hold the same chunks in another order.
    """
    recording.log(entity, *parts, static=True)
    recording.flush()


def nanoseconds(time_s: ArrayLike) -> NDArray[np.timedelta64]:
    """Durations (n,) to the nearest nanosecond."""
    return np.rint(np.asarray(time_s, float) * 1e9).astype("timedelta64[ns]")


def time_column(time_s: ArrayLike) -> rr.TimeColumn:
    """Vehicle times (n,) in seconds on the timeline of recordings."""
    return rr.TimeColumn(TIMELINE, duration=nanoseconds(time_s))


def ui_points(size: float) -> rr.components.Radius:
    """A radius in points of the screen, whatever the distance; rerun knows them by their sign."""
    return rr.components.Radius(-size)


def any_values(values: Mapping[str, NDArray[Any]]) -> rr.AnyValues:
    """Components of our own, by name."""
    return rr.AnyValues(True, **values)


def any_value_columns(columns: Mapping[str, NDArray[Any]]) -> rr.ComponentColumnList:
    """Components of our own by name, each (n,) with one value in a row."""
    return rr.AnyValues.columns(True, **columns)


def application_id(site: Site) -> str:
    """The application decides which blueprint the viewer applies, so it is one for each scenario."""
    return f"uavcover_{site.scenario.name}"


@contextlib.contextmanager
def strict_mode() -> Iterator[None]:
    """Wrong calls of rerun raise instead of being logged, inside the block only."""
    before = rr.error_utils.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)
