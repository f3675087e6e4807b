"""CSV of Litchi's Mission Hub, metric, as a mission (litchiutilities.com/docs/litchiCsv.php)."""

import csv
import io

from mission_io.errors import FormatError
from mission_io.formats.point_route import PointRoute, RouteStop, number_in, route_from_stops
from mission_io.formats.text import clean_text
from mission_io.model.items import Frame

_FRAMES = {0: Frame.ABOVE_HOME, 1: Frame.ABOVE_TERRAIN}


def is_litchi(text: str) -> bool:
    """Whether a CSV text has the header of Litchi's Mission Hub."""
    return text.lstrip("\ufeff \r\n")[:40].lower().startswith("latitude,longitude,altitude(")


def read_route(text: str) -> PointRoute:
    """Read a mission of Litchi's Mission Hub.

    Heights are above take-off (altitude mode 0) or above the ground (1); curved corners are told and become sharp. Litchi keeps
    what it does at the end outside of the file, so the mission ends above its last point.

    Raises:
        FormatError: another header, feet, or a value that is none, with its line.
    """
    clean = clean_text(text)
    if not is_litchi(clean.text):
        raise FormatError("the header is not that of Litchi's Mission Hub", where="line 1")
    try:
        rows = list(csv.DictReader(io.StringIO(clean.text.strip())))
    except csv.Error as error:
        raise FormatError(f"no CSV ({error})", where="text") from None
    header = {str(name).strip().lower() for name in (rows[0] if rows else {})}
    if "altitude(m)" not in header and rows:
        raise FormatError("heights are not in metres", where="line 1", advice="export it with metric units")
    repairs = list(clean.repairs)
    stops, curves = [], 0
    for line, row in enumerate(rows, start=2):
        fields = {str(name).strip().lower(): value if isinstance(value, str) else "" for name, value in row.items()}
        where = f"line {line}"
        lat, lon, alt = (
            number_in(fields.get(name), f"{where}, {name}") for name in ("latitude", "longitude", "altitude(m)")
        )
        mode = number_in(fields.get("altitudemode") or "0", f"{where}, altitudemode")
        if mode not in _FRAMES:
            raise FormatError(f"altitude mode {mode:g}", where=where, advice="it has to be 0 (take-off) or 1 (ground)")
        speed = number_in(fields.get("speed(m/s)") or "0", f"{where}, speed")
        curves += number_in(fields.get("curvesize(m)") or "0", f"{where}, curvesize") > 0.0
        stops.append(RouteStop(lat, lon, alt, _FRAMES[int(mode)], speed if speed > 0.0 else None))
    if curves:
        repairs.append(f"{curves} corners are curved; they are taken as sharp")
    return route_from_stops(stops, repairs=repairs)
