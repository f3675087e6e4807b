"""Readers of other programs' routes, of no-fly zones, of picture metadata and lists, and of the bytes of a link."""

import functools
import io
import json
import math
import tempfile
from collections.abc import Callable
from pathlib import Path

from PIL import Image

from mission_io.errors import FormatError
from mission_io.formats import csv_tables, map_xml, wpml
from mission_io.formats.point_route import PointRoute
from mission_io.model.items import GeoPoint, Mission, MissionType
from mission_io.protocol.ftp import FtpMessage
from mission_io.wire import messages as wire
from mission_io.wire.codec import LARGEST_FRAME, Codec, Framer
from mission_io.wire.messages import item_from_message, message_from_item
from scripts.attack.fuzz_files import Target, check, of_latin, of_text
from uavcover.cli.main import _one_line
from uavcover.errors import InputError, UavcoverError
from uavcover.extras.photos.lists import read_geo_txt, read_images_json, read_mrk, read_table
from uavcover.extras.photos.photo import Photo
from uavcover.extras.photos.readers import read_photo
from uavcover.new.catalog import CURVES
from uavcover.scenario.airspace.zone_file import _of_text as read_zone_text


def try_route(read_route: Callable[[str], PointRoute]) -> Callable[[str], None]:
    """A route of points."""

    def attempt(text: str) -> None:
        read = read_route(text)
        items = read.mission.items
        check(all(items[number - 1].command == 16 for number in read.numbers), "every point is a waypoint")
        written = csv_tables.write_csv(Mission(GeoPoint(1.0, 2.0, 3.0), items))
        check(csv_tables.read_csv(written).mission.items == items, "the route survives as a table")

    return attempt


def try_zones(suffix: str) -> Callable[[str], None]:
    """No-fly zones as authorities and glider pilots publish them."""

    def attempt(text: str) -> None:
        try:
            read = read_zone_text(text, suffix)
        except InputError as error:
            raise FormatError(str(error)) from None
        for zone in read.zones if read is not None else ():
            check(bool(zone.polygons) != (zone.circle is not None), "a zone is an outline or a circle")

    return attempt


def _route_seeds() -> dict[str, list[str]]:
    points = ((33.2, -98.1, 30.5), (33.25, -98.15, 41.0), (33.3, -98.05, 25.0))
    positions = " ".join(f"{lon},{lat},{up}" for lat, lon, up in points)
    rows = "".join(f'<rtept lat="{lat}" lon="{lon}"><ele>{up}</ele></rtept>' for lat, lon, up in points)
    line = f"<LineString><altitudeMode>absolute</altitudeMode><coordinates>{positions}</coordinates></LineString>"
    marks = "".join(
        f"<Placemark><Point><coordinates>{lon},{lat}</coordinates></Point><index>{n}</index>"
        f"<executeHeight>{up}</executeHeight><waypointSpeed>{n + 3}</waypointSpeed></Placemark>"
        for n, (lat, lon, up) in enumerate(points)
    )
    folder = f"<executeHeightMode>relativeToStartPoint</executeHeightMode><autoFlightSpeed>5</autoFlightSpeed>{marks}"
    config = "<finishAction>goHome</finishAction><takeOffSecurityHeight>20</takeOffSecurityHeight>"
    table = "".join(f"{lat},{lon},{up},90,0.2,0,7.5\n" for lat, lon, up in points)
    return {
        "gpx": [f"<gpx><rte>{rows}</rte></gpx>", f"<gpx><trk><trkseg>{rows.replace('rtept', 'trkpt')}</trkseg></trk></gpx>"],
        "kml_route": [f"<kml><Placemark>{line}</Placemark></kml>", f"<kml>{line.replace('absolute', 'relativeToGround')}</kml>"],
        "wpml": [f"<kml><missionConfig>{config}</missionConfig><Folder>{folder}</Folder></kml>"],
        "litchi": [f"latitude,longitude,altitude(m),heading(deg),curvesize(m),altitudemode,speed(m/s)\n{table}"],
    }  # fmt: skip


def _zone_seeds() -> dict[str, list[str]]:
    openair = (
        "AC R\nAN Range\nAL SFC\nAH 2500ft MSL\nDP 33:10:00 N 098:05:00 W\nDP 33:20:00 N 098:05:00 W\n"
        "V D=+\nV X=33:15:00 N 098:10:00 W\nDA 2.5,10,200\n\nAC D\nAN Circle\nAL 500ft AGL\nAH FL65\n"
        "V X=33:15:00 N 098:10:00 W\nDC 3.0\n"
    )
    ring = [[-98.2, 33.1], [-98.1, 33.1], [-98.1, 33.2], [-98.2, 33.1]]
    volume = {"uomDimensions": "M", "lowerLimit": 0, "lowerVerticalReference": "AGL", "upperLimit": 120,
              "upperVerticalReference": "AMSL", "horizontalProjection": {"type": "Polygon", "coordinates": [ring]}}  # fmt: skip
    circle = {**volume, "horizontalProjection": {"type": "Circle", "center": [-98.2, 33.1], "radius": 900.0}}
    old = {"features": [{"identifier": "A1", "name": "One", "restriction": "PROHIBITED", "geometry": [volume, circle],
                         "applicability": [{"startDateTime": "2026-01-01T00:00:00Z", "endDateTime": "2026-02-01T00:00:00Z",
                                            "permanent": "NO"}]}]}  # fmt: skip
    layer = {"upper": 120, "upperReference": "AGL", "lower": 0, "lowerReference": "AGL", "uom": "m"}
    shapes = [{"type": "Polygon", "coordinates": [ring], "layer": layer},
              {"type": "Point", "coordinates": [-98.2, 33.1], "extent": {"subType": "Circle", "radius": 90.0}}]  # fmt: skip
    new = {"type": "FeatureCollection", "features": [
        {"type": "Feature", "geometry": {"type": "GeometryCollection", "geometries": shapes},
         "properties": {"identifier": "B2", "type": "PROHIBITED"}}]}  # fmt: skip
    return {"openair": [openair], "zones": [json.dumps(old), json.dumps(new)]}


def _route_targets() -> dict[str, Target]:
    """By name, of routes and zones."""
    good = {**_route_seeds(), **_zone_seeds()}
    readers = {
        "gpx": try_route(map_xml.read_gpx_route),
        "kml_route": try_route(map_xml.read_kml_route),
        "wpml": try_route(wpml.read_route),
        "litchi": try_route(csv_tables.read_litchi),
        "openair": try_zones(".txt"),
        "zones": try_zones(".json"),
    }
    return {name: of_text(read, good[name]) for name, read in readers.items()}


_DJI = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" drone-dji:AbsoluteAltitude="+345.67" '
    'drone-dji:RelativeAltitude="+60.25" drone-dji:GimbalRollDegree="0.00" drone-dji:GimbalYawDegree="-12.30" '
    'drone-dji:GimbalPitchDegree="-90.00" drone-dji:RtkFlag="50" drone-dji:GpsLatitude="33.2191234" '
    'drone-dji:GpsLongitude="-98.1240001"/></rdf:RDF></x:xmpmeta>'
)


@functools.cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="fuzzed-")


def _in_file(name: str, read: Callable[[Path], None]) -> Callable[[bytes], None]:
    """A reader of files as one of bytes."""

    def attempt(data: bytes) -> None:
        path = Path(_folder().name) / name
        path.write_bytes(data)
        read(path)

    return attempt


def _check_photo(one: Photo) -> None:
    """What was read of a picture can be reckoned with."""
    for name in ("lat_deg", "lon_deg", "alt_m", "time_s", "yaw_deg", "pitch_deg", "roll_deg", "exposure_s",
                 "horizontal_error_m", "vertical_error_m"):  # fmt: skip
        value = getattr(one, name)
        check(value is None or math.isfinite(value), f"{name} is a number or not known")
    check(one.lacks() is None or bool(one.lacks()), "what a picture lacks has a name")


def try_list(read: Callable[[Path], list[Photo]]) -> Callable[[Path], None]:
    """A list of pictures."""

    def attempt(path: Path) -> None:
        for one in read(path):
            _check_photo(one)

    return attempt


def try_photo(path: Path) -> None:
    """A picture."""
    _check_photo(read_photo(path))


def try_curve(path: Path) -> None:
    """A curve of detection."""
    table = CURVES.named(str(path)).table
    check(bool((table.probability >= 0.0).all() and (table.probability <= 1.0).all()), "a probability is one")


def _photos() -> list[bytes]:
    """Small pictures as cameras write them, in JPEG and TIFF."""
    image = Image.new("RGB", (32, 24))
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0132] = "DJI", "FC6310", "2026:05:01 12:00:00"
    exif.get_ifd(0x8769).update(
        {0x829A: (1, 1000), 0x9003: "2026:05:01 12:00:00", 0x920A: 8.8, 0x9011: "+02:00", 0x9291: "12"}
    )
    exif.get_ifd(0x8825).update(
        {
            1: "N",
            2: (33.0, 13.0, 8.8),
            3: "W",
            4: (98.0, 7.0, 26.4),
            5: b"\0",
            6: 345.67,
            7: (10.0, 0.0, 1.5),
            29: "2026:05:01",
        }
    )
    out = []
    for kind, more in (("JPEG", {"xmp": _DJI.encode()}), ("JPEG", {}), ("TIFF", {})):
        file = io.BytesIO()
        image.save(file, kind, exif=exif, **more)
        out.append(file.getvalue())
    return out


def _photo_targets() -> dict[str, Target]:
    """By name, of pictures."""
    row = {
        "filename": "a.jpg", "latitude": 33.2, "longitude": -98.1, "altitude": 345.5, "utc_time": 1.7e12, "yaw": 12.0,
        "pitch": 0.5, "roll": -0.5, "width": 4000, "height": 3000, "camera_make": "DJI",
        "camera_model": "FC6310", "exposure_time": 0.001,
    }  # fmt: skip
    position = "33.21912340,Lat\t-98.12400010,Lon\t345.678,Ellh"
    mrk = f"1\t303505.678\t[2312]\t   1,N\t  -2,E\t 193,V\t{position}\t0.011, 0.012, 0.033\t50,Q\n"
    heads = "name;latitude;longitude;altitude;yaw;pitch;roll;time"
    table = f"{heads}\na.jpg;33.2;-98.1;345.5;12;-90;0;5.5\nb.jpg;33.3;-98.1;346;;;;\n"
    own = (
        'title = "a"\nsource = "b"\nground_sample_m = [0.01, 0.02]\noff_vertical_deg = [0, 30]\n'
        'probability = [[0.9, 0.5], [0.8, 0.4]]\nindependent = "sides"\n'
    )
    formula = 'title = "a"\ntarget_m = 0.5\npixels_for_half = 2.0\nfound_at_best = 0.9\nhidden_from_above = 0.2\n'
    texts: dict[str, tuple[str, Callable[[Path], None], list[str]]] = {
        "geo_txt": ("geo.txt", try_list(read_geo_txt), [
            "EPSG:4326\na.jpg -98.1 33.2 345.5 1 2 3 0.5 0.9\nb.jpg -98.1 33.3 346\n",
            "WGS84 UTM 14N\na.jpg 581000.5 3676000.25 345.5\n",
            "+proj=utm +zone=14 +datum=WGS84 +units=m\na.jpg 581000.5 3676000.25 345.5\n",
        ]),
        "images_json": ("images.json", try_list(read_images_json), [json.dumps([row, {"filename": "b.jpg"}])]),
        "mrk": ("a.MRK", try_list(read_mrk), [mrk * 2]),
        "picture_table": ("a.csv", try_list(read_table), [table, table.replace(";", ",")]),
        "curve": ("a.toml", try_curve, [own, formula]),
    }  # fmt: skip
    refusals = (UavcoverError,)
    return {
        **{
            name: Target(_in_file(file, read), [seed.encode() for seed in seeds], refusals, _one_line)
            for name, (file, read, seeds) in texts.items()
        },
        "picture": Target(_in_file("a.jpg", try_photo), _photos(), refusals, _one_line),
    }


def try_codec(text: str) -> None:
    """Bytes off a link, as one datagram and as a stream in pieces; the text is the bytes as Latin-1."""
    data = text.encode("latin-1")
    whole, pieces = Framer(), Framer()
    frames = [*whole.feed(data), *whole.end()]
    step = 1 + len(data) % 37
    found = [frame for at in range(0, len(data), step) for frame in pieces.feed(data[at : at + step])]
    check(pieces.unfinished_bytes < LARGEST_FRAME, "little is kept")
    check([*found, *pieces.end()] == frames, "the frames do not depend on the pieces")
    counted = whole.counts.garbage_bytes + sum(len(frame.data) for frame in frames)
    check(counted == len(data), "every byte is in a frame or garbage")
    ground, sender = Codec(system_id=255, component_id=190), Codec(system_id=1, component_id=1)
    for received in ground.decode(data):
        again = sender.encode(received.message)
        back = Codec(system_id=255, component_id=190).decode(again)
        check(len(back) == 1 and repr(back[0].message) == repr(received.message), "a message survives sending")
        _try_message(received.message)


def _try_message(message: wire.Message) -> None:
    """A message of the wire in the hands of what reads it further."""
    if isinstance(message, wire.FileTransfer):
        FtpMessage.answer(message.payload)
    if isinstance(message, wire.MissionItemInt | wire.MissionItemFloat):
        try:
            item = item_from_message(message)
        except FormatError:
            return
        if isinstance(message, wire.MissionItemInt):
            again = message_from_item(item, 1, mission_type=MissionType.MISSION, target_system=1, target_component=1)
            check((again.x, again.y) == (message.x, message.y), "a place survives")


def _wire_seeds() -> list[str]:
    ground = Codec(system_id=255, component_id=190)
    old = Codec(system_id=1, component_id=1)
    old.version = 1
    item = wire.MissionItemInt(1, 1, 3, 6, 16, (1.0, 0.0, 0.0, float("nan")), 332191234, -981240001, 60.25)
    sent = [
        wire.Heartbeat(3, 2, system_status=4), wire.MissionCount(1, 1, 40), item, wire.MissionRequestInt(255, 190, 3),
        wire.MissionAck(255, 190, 0), wire.ParamValue("RTL_ALT", 1500.0, 9, 1200, 7), wire.StatusText(6, "a line"),
        wire.FileTransfer(1, 1, bytes(251)), wire.LogData(1, 90, 90, (7,) * 90), wire.CommandLong(1, 1, 400, (1.0,) * 7),
    ]  # fmt: skip
    frames = [ground.encode(message) for message in sent]
    frames += [old.encode(message) for message in (sent[0], sent[5], sent[9])]
    return [b"".join(frames).decode("latin-1"), *(frame.decode("latin-1") for frame in frames)]


def targets() -> dict[str, Target]:
    """By name."""
    return {**_route_targets(), **_photo_targets(), "codec": of_latin(try_codec, _wire_seeds())}
