"""A flight while it goes on: samples as they come into ``track.csv``, and the cells that they saw.

The flight is another process, which does not depend on this one.
"""

import csv
import threading
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.extras.app.scene import Scene, seen_image

_COLUMNS = ("time_s", "east_m", "north_m", "up_m", "yaw_deg", "lat_deg", "lon_deg")
_MOST_BYTES = 1 << 20


class LiveFlight:
    """The growing track of a run folder. Many readers share one.

    Attributes:
        samples: longitude, latitude, height above ground, vehicle time, heading; one row a sample, only ever appended to.
        covered: share of the coverable ground that was seen so far.
        image: cells as they are now, a data URI; empty before the first sample.
        version: number of changes of the image.
    """

    def __init__(self, scene: Scene, run: Path) -> None:
        self._scene, self._file = scene, run / "track.csv"
        self._lock = threading.Lock()
        self._at, self._header, self._identity = 0, list[str](), (0, 0)
        self._fresh: list[list[float]] = []
        self._last: list[float] | None = None
        self._seen = np.zeros(0, dtype=bool)
        self.samples: list[list[float]] = []
        self.covered, self.image, self.version = 0.0, "", 0

    def poll(self) -> None:
        """Read what was appended since the last call. A file that was replaced is read from its beginning."""
        with self._lock:
            try:
                state = self._file.stat()
            except OSError:
                return
            if (state.st_dev, state.st_ino) != self._identity or state.st_size < self._at:
                self._identity, self._at, self._header = (state.st_dev, state.st_ino), 0, []
                self.samples, self._fresh, self._last = [], [], None
                self._seen[:] = False
            if state.st_size == self._at:
                return
            with self._file.open("rb") as file:
                file.seek(self._at)
                raw = file.read(_MOST_BYTES)
            whole = raw[: raw.rfind(b"\n") + 1]
            self._at += len(whole)
            self._take(whole.decode("utf-8", errors="replace").splitlines())

    def _take(self, lines: list[str]) -> None:
        rows = [row for row in csv.reader(line for line in lines if not line.startswith("#")) if row]
        if not self._header and rows:
            self._header = rows.pop(0)
        try:
            columns = [self._header.index(name) for name in _COLUMNS]
        except ValueError:
            return
        for row in rows:
            try:
                time_s, east, north, up, yaw, lat, lon = (float(row[column]) for column in columns)
            except (ValueError, IndexError):
                continue
            agl = float(self._scene.site.ground.heights_agl_m(np.array([[east, north, up]]))[0])
            lon_lat = (
                (lon, lat)
                if self._scene.site.frame is not None
                else self._scene.lon_lat(np.array([[east, north, up]]))[0]
            )
            values = [float(lon_lat[0]), float(lon_lat[1]), agl, time_s, yaw]
            self.samples.append([round(v, 7) if np.isfinite(v) else 0.0 for v in values])
            self._fresh.append([east, north, up])

    def look(self) -> None:
        """Add what the samples since the last call saw; for a camera along the path, between them too."""
        with self._lock:
            fresh, self._fresh = self._fresh, []
            if not fresh:
                return
            points = ([] if self._last is None else [self._last]) + fresh
            self._last = fresh[-1]
        coverage = self._scene.coverage
        seen = coverage.seen(np.array(points))
        with self._lock:
            if self._seen.size != seen.size:
                self._seen = np.zeros(seen.size, dtype=bool)
            before = int(self._seen.sum())
            self._seen |= seen
            if int(self._seen.sum()) != before or not self.image:
                self.covered = coverage.share_of_coverable(self._seen)
                self.image = seen_image(coverage, self._seen)
                self.version += 1

    def state(self) -> dict[str, Any]:
        """Coverage so far, with its image."""
        return {"covered": self.covered, "image": self.image, "corners": self._scene.corners(), "version": self.version}
