"""A flight in progress: the samples in ``track.csv``, and the cells that they observe.

The flight is another process, which does not depend on this one.
"""

import contextlib
import csv
import json
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from mission_io.model.plain_text import plain_text
from uavcover.extras.app.scene import Scene
from uavcover.flight.flight_log import LIVE_LINE
from uavcover.kernels.arrays import BoolArray
from uavcover.report.map_data import OBSERVED_RGB, UNOBSERVED_RGB, data_uri

_COLUMNS = ("time_s", "east_m", "north_m", "up_m", "yaw_deg", "lat_deg", "lon_deg")
_MOST_BYTES = 1 << 20

Rectangle = tuple[int, int, int, int]
"""First row and column of the picture, and the ones after the last; rows from the north."""


class Observed:
    """Cells that the flights of one plan saw so far. A browser is sent the rectangles that it lacks.

    Attributes:
        scene: the plan.
        covered: fraction of the coverable ground that was seen so far.
        version: number of changes.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.covered, self.version = scene, 0.0, 0
        self._lock = threading.Lock()
        self._of: dict[int, BoolArray] = {}
        self._observed: BoolArray | None = None
        self._changed: list[Rectangle] = []
        self._made: dict[int, dict[str, Any]] = {}

    def take(self, flight: int, observed: BoolArray) -> None:
        """Cells that a flight saw up to now; fewer than before where its track was replaced."""
        coverage = self.scene.coverage
        with self._lock:
            self._of[flight] = observed
            before = np.zeros(observed.size, dtype=bool) if self._observed is None else self._observed
            self._observed = np.logical_or.reduce(list(self._of.values()))
            changed = self._image(self._observed != before)
            rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
            if rows.size:
                self._changed.append((int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1))
            elif self.version:
                return
            self.covered = coverage.fraction_of_coverable(self._observed)
            self.version, self._made = self.version + 1, {}
            if not rows.size:
                self._changed.append((0, 0, 0, 0))

    def since(self, version: int) -> dict[str, Any]:
        """Changes after a version, 0 for everything: share, size of the whole picture, and its new rectangles."""
        with self._lock:
            if version not in self._made:
                self._made[version] = self._document(version)
            return self._made[version]

    def _document(self, version: int) -> dict[str, Any]:
        assert self._observed is not None
        observed, cells = self._image(self._observed), self._image(np.ones(self._observed.size, dtype=bool))
        height, width = observed.shape
        whole = not 0 < version <= self.version
        parts: list[Rectangle] = [(0, 0, height, width)] if whole else self._changed[version:]
        if len(parts) > 6:
            ends = np.array(parts)
            (top, left), (bottom, right) = ends[:, :2].min(axis=0), ends[:, 2:].max(axis=0)
            parts = [(int(top), int(left), int(bottom), int(right))]
        patches = []
        for top, left, bottom, right in parts:
            pixels = np.zeros((bottom - top, right - left, 4), dtype=np.uint8)
            if pixels.size:
                pixels[cells[top:bottom, left:right]] = (*UNOBSERVED_RGB, 150)
                pixels[observed[top:bottom, left:right]] = (*OBSERVED_RGB, 150)
                patches.append({"x": left, "y": top, "image": data_uri(pixels, "PNG")})
        return {
            "covered": self.covered, "version": self.version, "whole": whole, "size": [width, height],
            "corners": self.scene.corners(), "patches": patches,
        }  # fmt: skip

    def _image(self, where: BoolArray) -> BoolArray:
        """Cells as the picture has them: (rows from the north, columns from the west)."""
        lattice = self.scene.coverage.grid.cells.lattice
        image = np.zeros(lattice.shape, dtype=bool)
        image[lattice >= 0] = where[lattice[lattice >= 0]]
        return np.asarray(image[::-1])


class LiveFlight:
    """The growing track of a run folder. Many readers share one.

    Attributes:
        samples: longitude, latitude, height above ground, vehicle time, heading; one row a sample, only ever appended to.
        observed: cells that it and other flights of its plan saw.
        line: what the vehicle does: mode, height, battery, link, time left; empty while it does not fly.
        warning: the last alarm of the flight.
    """

    def __init__(self, observed: Observed, run: Path) -> None:
        self._scene, self._file = observed.scene, run / "track.csv"
        self.line = self.warning = ""
        self.observed = observed
        self._lock = threading.Lock()
        self._at, self._header, self._identity = 0, list[str](), (0, 0)
        self._fresh: list[list[float]] = []
        self._last: list[float] | None = None
        self._observed = np.zeros(0, dtype=bool)
        self.samples: list[list[float]] = []

    def poll(self) -> None:
        """Read what was appended since the last call. A file that was replaced is read from its beginning."""
        with self._lock:
            self._read_line()
            try:
                state = self._file.stat()
            except OSError:
                return
            if (state.st_dev, state.st_ino) != self._identity or state.st_size < self._at:
                self._identity, self._at, self._header = (state.st_dev, state.st_ino), 0, []
                self.samples, self._fresh, self._last = [], [], None
                self._observed = np.zeros(0, dtype=bool)
            if state.st_size == self._at:
                return
            with self._file.open("rb") as file:
                file.seek(self._at)
                raw = file.read(_MOST_BYTES)
            whole = raw[: raw.rfind(b"\n") + 1]
            self._at += len(whole)
            self._take(whole.decode("utf-8", errors="replace").splitlines())

    def _read_line(self) -> None:
        file = self._file.with_name(LIVE_LINE)
        try:
            # an older line belongs to no flight
            raw = file.read_text(encoding="utf-8") if time.time() - file.stat().st_mtime < 30.0 else "{"
        except (OSError, UnicodeDecodeError):
            raw = "{"
        if raw == "{":  # the flight has ended, or has not begun, or its program was killed
            self.line = ""
        with contextlib.suppress(ValueError, KeyError, TypeError):  # half written: the next one comes soon
            found = json.loads(raw)
            self.line, self.warning = plain_text(str(found["line"])), plain_text(str(found["warning"]))

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
        observed = coverage.observed(np.array(points))
        with self._lock:
            if self._observed.size != observed.size:
                self._observed = np.zeros(observed.size, dtype=bool)
            self._observed = self._observed | observed
        self.observed.take(id(self), self._observed)
