"""Readers of what tells of pictures: their own metadata, lists of them, and curves of detection."""

import functools
import io
import json
import math
import tempfile
from collections.abc import Callable
from pathlib import Path

from PIL import Image

from scripts.fuzzing.target import Target, check
from uavcover.cli.ending import _one_line
from uavcover.errors import UavcoverError
from uavcover.intake.detection import curve_named
from uavcover.judging.photos.exif import read_picture
from uavcover.judging.photos.lists import read_geo_txt, read_images_json, read_mrk, read_table
from uavcover.judging.photos.picture import Picture

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


def _check_picture(one: Picture) -> None:
    """What was read of a picture can be reckoned with."""
    for name in ("lat_deg", "lon_deg", "alt_m", "time_s", "yaw_deg", "pitch_deg", "roll_deg", "exposure_s",
                 "horizontal_error_m", "vertical_error_m"):  # fmt: skip
        value = getattr(one, name)
        check(value is None or math.isfinite(value), f"{name} is a number or not known")
    check(one.lacks() is None or bool(one.lacks()), "what a picture lacks has a name")


def try_list(read: Callable[[Path], list[Picture]]) -> Callable[[Path], None]:
    """A list of pictures."""

    def attempt(path: Path) -> None:
        for one in read(path):
            _check_picture(one)

    return attempt


def try_picture(path: Path) -> None:
    """A picture."""
    _check_picture(read_picture(path))


def try_curve(path: Path) -> None:
    """A curve of detection."""
    table = curve_named(str(path)).table
    check(bool((table.probability >= 0.0).all() and (table.probability <= 1.0).all()), "a probability is one")


def _pictures() -> list[bytes]:
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


def targets() -> dict[str, Target]:
    """By name."""
    row = {
        "filename": "a.jpg", "latitude": 33.2, "longitude": -98.1, "altitude": 345.5, "utc_time": 1.7e12, "yaw": 12.0,
        "pitch": 0.5, "roll": -0.5, "width": 4000, "height": 3000, "camera_make": "DJI",
        "camera_model": "FC6310", "exposure_time": 0.001,
    }  # fmt: skip
    place = "33.21912340,Lat\t-98.12400010,Lon\t345.678,Ellh"
    mrk = f"1\t303505.678\t[2312]\t   1,N\t  -2,E\t 193,V\t{place}\t0.011, 0.012, 0.033\t50,Q\n"
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
        "picture": Target(_in_file("a.jpg", try_picture), _pictures(), refusals, _one_line),
    }
