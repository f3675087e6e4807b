"""An honest flight as a falsifier holds it: its columns, its plan, its ground; and its text as ``track.csv``."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavcover import pipeline
from uavcover.after_flight import read_planned_route
from uavcover.flight.track_file import read_track
from uavcover.model.track import COLUMNS
from uavcover.run_folder import RunFolder
from uavcover.site import Site

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Flown:
    """A flight's record and what it was made with.

    Attributes:
        site: the scenario on its ground.
        plan_m: (k, 3) planned waypoints, ENU.
        time_s: (n,).
        geodetic: (n, 3) latitude, longitude, height above sea level.
        enu_m: (n, 3).
        attitude_deg: (n, 3) roll, pitch, yaw; NaN where it is not known.
        waypoint: (n,) numbers of planned waypoints, -1 off the route.
    """

    site: Site
    plan_m: FloatArray
    time_s: FloatArray
    geodetic: FloatArray
    enu_m: FloatArray
    attitude_deg: FloatArray
    waypoint: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def on_route(self) -> BoolArray:
        """(n,) whether a sample lies between the first and the last planned waypoint."""
        return self.waypoint >= 1

    @property
    def step_s(self) -> float:
        """Usual time between two samples."""
        return float(np.median(np.diff(self.time_s)))

    def moment(self, share: float) -> float:
        """The time at which this share of the route's time is over; of the whole record where it knows no route."""
        times = self.time_s[self.on_route] if self.on_route.any() else self.time_s
        return float(times[0] + share * (times[-1] - times[0]))

    def between(self, begin_s: float, end_s: float) -> BoolArray:
        """(n,) which samples lie in a span of time."""
        return (self.time_s >= begin_s) & (self.time_s < end_s)

    def taken(self, keep: NDArray[np.int64] | BoolArray) -> "Flown":
        """Some of its samples, in any order."""
        return replace(
            self, time_s=self.time_s[keep], geodetic=self.geodetic[keep], enu_m=self.enu_m[keep],
            attitude_deg=self.attitude_deg[keep], waypoint=self.waypoint[keep],
        )  # fmt: skip

    def placed(self, enu_m: FloatArray) -> "Flown":
        """The same with other places, in both pairs of columns."""
        frame = self.site.frame
        assert frame is not None
        return replace(self, enu_m=enu_m, geodetic=np.column_stack(frame.geodetic_from_enu(enu_m)))

    def located(self, geodetic: FloatArray) -> "Flown":
        """The same with other latitudes, longitudes and heights, the local columns as they follow from them."""
        frame = self.site.frame
        assert frame is not None
        return replace(self, geodetic=geodetic, enu_m=frame.enu_from_geodetic(*geodetic.T))

    def held(self, source: NDArray[np.int64]) -> "Flown":
        """Each sample at the place of sample ``source[k]``, at its own time."""
        return replace(self, geodetic=self.geodetic[source], enu_m=self.enu_m[source])

    def text(self) -> str:
        """As ``track.csv``; an unknown attitude is an empty cell."""
        numbers = np.column_stack([self.time_s, self.geodetic, self.enu_m, self.attitude_deg]).tolist()
        lines = [
            ",".join(["" if value != value else repr(value) for value in row]) + f",{waypoint}"
            for row, waypoint in zip(numbers, self.waypoint.tolist(), strict=True)
        ]
        return "\n".join([",".join(COLUMNS), *lines]) + "\n"


Change = Callable[[Flown], Flown]
"""One falsification, or a step of one; it may be given a record that is falsified already."""


def read_flown(run: Path) -> Flown:
    """The flight in a run folder, or in a folder of one of its sorties.

    Raises:
        uavcover.errors.InputError: it has no scenario, plan or track that can be read.
    """
    folder = RunFolder(run)
    site = pipeline.load_site(folder.existing("scenario.toml", made_by="uavcover plan"))
    planned = read_planned_route(folder)
    track = read_track(folder.existing("track.csv", made_by="uavcover fly"))
    return Flown(
        site=site,
        plan_m=np.empty((0, 3)) if planned is None else planned.waypoints_m,
        time_s=track.time_s,
        geodetic=track.geodetic,
        enu_m=track.enu_m,
        attitude_deg=track.attitude_deg,
        waypoint=track.current_waypoint,
    )
