"""Logs of one made-up flight, each written by pymavlink, by pyulog or by hand as its format says."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from uavcover.terrain.frames import LocalFrame

FRAME = LocalFrame(36.5, -84.2, 400.0)
COUNT = 40


def flight() -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 4) every 0.2 s and attitudes (n, 4) 0.1 s later: time, then lat, lon, alt, or roll, pitch, yaw in degrees."""
    time_s = 20.0 + 0.2 * np.arange(COUNT)
    enu = np.column_stack([2.0 * np.arange(COUNT), 5.0 * np.sin(time_s), 80.0 + 0.5 * np.arange(COUNT)])
    positions = np.column_stack([time_s, *FRAME.geodetic_from_enu(enu)])
    yaw = (350.0 + np.arange(COUNT)) % 360.0
    attitudes = np.column_stack([time_s + 0.1, 10.0 * np.sin(time_s), -5.0 + 0.0 * time_s, yaw])
    return positions, attitudes


def velocity_ned_m_s(time_s: np.ndarray) -> np.ndarray:
    """(n, 3) the velocity of the made-up flight."""
    return np.column_stack([5.0 * np.cos(time_s), np.full(len(time_s), 10.0), np.full(len(time_s), -2.5)])


@dataclass(frozen=True)
class Photo:
    """A picture of a log: when, where if it names a place, its number, whether it was taken, and which message tells of it."""

    time_s: float
    lat_deg: float = 0.0
    lon_deg: float = 0.0
    number: int = 0
    taken: bool = True
    kind: str = "picture"


def photos_at(samples: list[int]) -> list[Photo]:
    """A picture at each of these samples of the flight, 0.05 s before its time, where the vehicle was."""
    positions, _ = flight()
    at = [positions[k].tolist() for k in samples]
    return [Photo(t - 0.05, lat, lon, number) for number, (t, lat, lon, _) in enumerate(at)]


GROUND_M = 412.5
"""Above sea level: what a rangefinder sees in the made-up flight, whose land is level."""


def distances_m() -> np.ndarray:
    """(n,) to level ground along the down axis of the leaning vehicle, at the times of the attitudes."""
    positions, attitudes = flight()
    alt = np.interp(attitudes[:, 0], positions[:, 0], positions[:, 3])
    return (alt - GROUND_M) / np.prod(np.cos(np.radians(attitudes[:, 1:3])), axis=1)


def _camera_messages(packer: mavlink.MAVLink, photos: Sequence[Photo]) -> list[object]:
    made: list[object] = []
    for each in photos:
        lat, lon = round(each.lat_deg * 1e7), round(each.lon_deg * 1e7)
        if each.kind == "picture":
            flags = mavlink.CAMERA_FEEDBACK_PHOTO if each.taken else mavlink.CAMERA_FEEDBACK_BADEXPOSURE
            made.append(
                packer.camera_feedback_encode(0, 0, 0, each.number, lat, lon, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, flags)
            )
        else:
            made.append(
                packer.camera_image_captured_encode(
                    0, 0, 0, lat, lon, 0, 0, [1.0, 0.0, 0.0, 0.0], each.number, int(each.taken), b""
                )
            )
    return made


def write_tlog(
    path: Path, *, systems: tuple[int, ...] = (1,), component: int = 1, photos: Sequence[Photo] = (),
    began_unix_s: float | None = None, speed: float = 1.0, ranging: bool = False, stations: tuple[tuple[int, int, int], ...] = (),
    velocity: bool = False, fixes: Sequence[tuple[int, ...]] = (), receiver_off_deg: float | None = None,
) -> None:  # fmt: skip
    """As a ground station writes it: eight bytes of microseconds, then the packet.

    ``stations`` are (system, MAV_TYPE, autopilot) of others that send a position of their own, as ground stations do. ``fixes``
    are what the receivers, one or two, report after each position.
    """
    positions, attitudes = flight()
    with path.open("wb") as file:
        for system, kind, autopilot in stations:
            packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
            for t in positions[:, 0]:
                position = packer.global_position_int_encode(round(t * 1e3), 470000000, 80000000, 500000, 0, 0, 0, 0, 0)
                for message in (packer.heartbeat_encode(kind, autopilot, 0, 0, 0), position):
                    file.write(struct.pack(">Q", int((1.7e9 + t) * 1e6)) + message.pack(packer))
        for system in systems:
            packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
            for k, ((t, lat, lon, alt), (ta, roll, pitch, yaw)) in enumerate(zip(positions, attitudes, strict=True)):
                messages = [
                    packer.heartbeat_encode(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 0),
                    packer.global_position_int_encode(
                        round(t * 1e3),
                        round(lat * 1e7),
                        round(lon * 1e7),
                        round(alt * 1e3),
                        0,
                        *(100.0 * velocity * velocity_ned_m_s(np.array([t]))[0]).round().astype(int).tolist(),
                        0,
                    ),
                    packer.attitude_encode(
                        round(ta * 1e3), *(math.radians(math.remainder(x, 360.0)) for x in (roll, pitch, yaw)), 0, 0, 0
                    ),
                ]
                if began_unix_s is not None:
                    messages.append(packer.system_time_encode(round((began_unix_s + t / speed) * 1e6), round(t * 1e3)))
                received = (
                    [0, 0] if receiver_off_deg is None else [round((x + receiver_off_deg) * 1e7) for x in (lat, lon)]
                )
                rest = (*received, 0, 0, 0, 0, 0, 0)
                for receiver, fix in enumerate(fixes[k] if fixes else ()):
                    if receiver == 0:
                        messages.append(packer.gps_raw_int_encode(0, fix, *rest))
                    else:
                        messages.append(packer.gps2_raw_encode(0, fix, *rest, 0, 0))
                if ranging:
                    # A packet's time is that of the position before it; one looks ahead, one is out of range.
                    level = (alt - GROUND_M) / np.prod(np.cos(np.radians([_lean_at(t, 1), _lean_at(t, 2)])))
                    for distance, turned in ((level, 25), (3.0, 0), (200.0, 25)):
                        messages.append(
                            packer.distance_sensor_encode(0, 20, 15000, round(distance * 100), 0, 0, turned, 0)
                        )
                    messages.append(
                        packer.terrain_report_encode(
                            round(lat * 1e7), round(lon * 1e7), 100 if k else 0, 409.0, 80.0, 0, 9
                        )
                    )
                messages += _camera_messages(packer, [each for each in photos if t - 0.2 < each.time_s <= t])
                for message in messages:
                    file.write(struct.pack(">Q", int((1.7e9 + t) * 1e6)) + message.pack(packer))


def _lean_at(time_s: float, vertical: int) -> float:
    _, attitudes = flight()
    return float(np.interp(time_s, attitudes[:, 0], attitudes[:, vertical]))


_CODES = {
    "Q": "Q",
    "L": "i",
    "I": "I",
    "H": "H",
    "f": "f",
    "c": "h",
    "C": "H",
    "B": "B",
    "N": "16s",
    "Z": "64s",
    "n": "4s",
}


class DataflashWriter:
    """Dataflash messages: two marks, the type, and its fields; FMT messages say what a type has."""

    def __init__(self) -> None:
        self.content = b""
        self._formats = {128: "BBnNZ"}
        self._write(128, 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")

    def define(self, number: int, name: str, types: str, columns: str) -> None:
        self._formats[number] = types
        length = 3 + struct.calcsize("<" + "".join(_CODES[t] for t in types))
        self._write(128, number, length, name.encode(), types.encode(), columns.encode())

    def write(self, number: int, *values: float) -> None:
        self._write(number, *values)

    def _write(self, number: int, *values: object) -> None:
        layout = "<" + "".join(_CODES[t] for t in self._formats[number])
        self.content += b"\xa3\x95" + bytes([number]) + struct.pack(layout, *values)


def write_dataflash(
    path: Path, *, estimated: bool = True, attitude: bool = True, photos: Sequence[Photo] = (),
    began_unix_s: float | None = None, ranging: bool = False, core: str | None = None, velocity: bool = False,
    fixes: Sequence[tuple[int, ...]] = (), receiver_off_deg: float = 0.0,
) -> None:  # fmt: skip
    """``core`` is the message of the estimator's velocities: XKF1 of two cores, the second one primary, or NKF1."""
    positions, attitudes = flight()
    log = DataflashWriter()
    log.define(8, "XKF1", "QBfff", "TimeUS,C,VN,VE,VD")
    log.define(9, "NKF1", "Qfff", "TimeUS,VN,VE,VD")
    log.define(10, "XKF4", "QBB", "TimeUS,C,PI")
    for t, v in zip(positions[:, 0] - 0.05, velocity_ned_m_s(positions[:, 0] - 0.05), strict=True):
        if core == "XKF1":
            log.write(10, round(t * 1e6), 0, 1)
            log.write(8, round(t * 1e6), 0, 9.0, 9.0, 9.0)
            log.write(8, round(t * 1e6), 1, *v)
        elif core == "NKF1":
            log.write(9, round(t * 1e6), *v)
    log.define(6, "RFND", "QBCBB", "TimeUS,Instance,Dist,Stat,Orient")
    log.define(7, "TERR", "QBLLff", "TimeUS,Status,Lat,Lng,TerrH,CHeight")
    if ranging:
        for (t, lat, lon, _), ta, distance in zip(positions, attitudes[:, 0], distances_m(), strict=True):
            for reading, status, turned in ((distance, 4, 25), (3.0, 4, 0), (0.5, 2, 25)):
                log.write(6, round(ta * 1e6), 0, round(reading * 100), status, turned)
            log.write(7, round(t * 1e6), 2, round(lat * 1e7), round(lon * 1e7), 409.0, 80.0)
            log.write(7, round(t * 1e6), 1, 0, 0, 0.0, 0.0)
    log.define(1, "POS", "QLLff", "TimeUS,Lat,Lng,Alt,RelHomeAlt")
    log.define(2, "GPS", "QBBIHLLffff", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt,Spd,GCrs,VZ")
    log.define(3, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw")
    log.define(4, "CAM", "QLL", "TimeUS,Lat,Lng")
    log.define(5, "TRIG", "QLL", "TimeUS,Lat,Lng")
    for k, ((t, lat, lon, alt), (ta, roll, pitch, yaw)) in enumerate(zip(positions, attitudes, strict=True)):
        first, second = fixes[k] if fixes else (3, 3)
        position = (round(lat * 1e7), round(lon * 1e7), alt)
        if estimated:
            log.write(1, round(t * 1e6), *position, 0.0)
        week, seconds = divmod(t + (began_unix_s + 18 - 315_964_800 if began_unix_s is not None else 0.0), 604_800)
        north, east, down = velocity * velocity_ned_m_s(np.array([t]))[0]
        over_ground = (math.hypot(north, east), math.degrees(math.atan2(east, north)) % 360.0, down)
        received = [round((x + receiver_off_deg) * 1e7) for x in (lat, lon)]
        log.write(2, round(t * 1e6), 0, first, round(seconds * 1e3), int(week), *received, alt, *over_ground)
        log.write(2, round(t * 1e6), 1, second, 0, 0, 0, 0, 0.0, 9.0, 9.0, 9.0)  # a second receiver, which is not asked
        if attitude:
            log.write(3, round(ta * 1e6), round(roll * 100), round(pitch * 100), round(yaw * 100))
    for each in photos:
        position = (round(each.lat_deg * 1e7), round(each.lon_deg * 1e7))
        log.write(4 if each.kind == "picture" else 5, round(each.time_s * 1e6), *position)
    path.write_bytes(log.content)


_POINT = '<trkpt lat="{lat!r}" lon="{lon!r}"><ele>{alt!r}</ele><time>{time}</time></trkpt>'


def write_gpx(path: Path, *, point: str = _POINT) -> None:
    positions, _ = flight()
    points = "".join(
        point.format(lat=lat, lon=lon, alt=alt, time=f"2026-11-21T10:00:{t:06.3f}Z")
        for t, lat, lon, alt in positions.tolist()
    )
    path.write_text(
        '<?xml version="1.0"?><gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<trk><trkseg>{points}</trkseg></trk></gpx>"
    )


_RANGE_FORMAT = (
    b"distance_sensor:uint64_t timestamp;float min_distance;float max_distance;float current_distance;"
    b"int8_t signal_quality;uint8_t orientation;"
)
_RECEIVER_VELOCITY = "float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;bool vel_ned_valid;"
_RECEIVER_FORMATS = {
    "vehicle_gps_position": (
        "int32_t lat;int32_t lon;int32_t alt;uint8_t fix_type;" + _RECEIVER_VELOCITY,
        "<HQiiiBfff?",
        (1e7, 1e3),
    ),
    "sensor_gps": (
        "double latitude_deg;double longitude_deg;double altitude_msl_m;uint8_t fix_type;" + _RECEIVER_VELOCITY,
        "<HQdddBfff?",
        (1.0, 1.0),
    ),
}


def write_ulog(
    path: Path, *, photos: Sequence[Photo] = (), began_unix_s: float | None = None, ranging: bool = False,
    receiver: str | None = None, velocity: bool = False, fixes: Sequence[tuple[int, ...]] = (),
) -> None:  # fmt: skip
    """Header, flags, formats, subscriptions and data as the ULog specification says."""
    positions, attitudes = flight()

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<H", len(body)) + kind + body

    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    content += message(b"B", bytes(40))
    content += message(
        b"F", b"vehicle_global_position:uint64_t timestamp;double lat;double lon;float alt;bool dead_reckoning;"
    )
    content += message(b"F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    if receiver is not None:
        fields, layout, (degrees, metres) = _RECEIVER_FORMATS[receiver]
        content += message(b"F", f"{receiver}:uint64_t timestamp;{fields}".encode())
    if ranging:
        content += message(b"F", _RANGE_FORMAT)
    if velocity:
        content += message(
            b"F",
            b"vehicle_local_position:uint64_t timestamp;float vx;float vy;float vz;bool v_xy_valid;bool v_z_valid;",
        )
    if began_unix_s is not None:
        content += message(b"F", b"sensor_gps:uint64_t timestamp;uint64_t time_utc_usec;")
    kinds = list(dict.fromkeys(each.kind for each in photos))
    for kind in kinds:
        content += message(b"F", b"".join(_CAMERA_TOPICS[kind]))
    for number, kind in enumerate(kinds, start=2):
        content += message(b"A", struct.pack("<BH", 0, number) + _CAMERA_TOPICS[kind][0])
    if receiver is None:
        content += message(b"A", struct.pack("<BH", 0, 0) + b"vehicle_global_position")
    content += message(b"A", struct.pack("<BH", 0, 1) + b"vehicle_attitude")
    if receiver is not None:
        fields, layout, (degrees, metres) = _RECEIVER_FORMATS[receiver]
        content += message(b"A", struct.pack("<BH", 0, 10) + receiver.encode())
        number = int if degrees > 1.0 else float
        for k, (t, lat, lon, alt) in enumerate(positions):
            position = [number(round(v * unit, 9)) for v, unit in ((lat, degrees), (lon, degrees), (alt, metres))]
            fix = (*(position if k else [0, 0, 0]), 3 if k else 0, *velocity_ned_m_s(np.array([t]))[0], velocity)
            content += message(b"D", struct.pack(layout, 10, round(t * 1e6), *fix))
    if velocity and receiver is None:
        content += message(b"A", struct.pack("<BH", 0, 12) + b"vehicle_local_position")
        for k, t in enumerate(positions[:, 0] + 0.1):
            v = velocity_ned_m_s(np.array([t]))[0] if k else (9.0, 9.0, 9.0)
            content += message(b"D", struct.pack("<HQfff??", 12, round(t * 1e6), *v, True, k > 0))
    if ranging:
        content += message(b"A", struct.pack("<BH", 0, 11) + b"distance_sensor")
        for t, distance in zip(attitudes[:, 0], distances_m(), strict=True):
            for reading, quality, turned in ((distance, 100, 25), (3.0, 100, 0), (distance, 0, 25), (200.0, 100, 25)):
                content += message(
                    b"D", struct.pack("<HQfffbB", 11, round(t * 1e6), 0.2, 150.0, reading, quality, turned)
                )
    if began_unix_s is not None:
        content += message(b"A", struct.pack("<BH", 0, 9) + b"sensor_gps")
        for t in positions[:, 0]:
            content += message(b"D", struct.pack("<HQQ", 9, round(t * 1e6), round((began_unix_s + t) * 1e6)))
    for k, ((t, lat, lon, alt), (ta, roll, pitch, yaw)) in enumerate(zip(positions, attitudes, strict=True)):
        if receiver is None:
            lost = bool(fixes) and max(fixes[k]) < 3
            content += message(b"D", struct.pack("<HQddf?", 0, round(t * 1e6), lat, lon, alt, lost))
        content += message(b"D", struct.pack("<HQ4f", 1, round(ta * 1e6), *quaternion(roll, pitch, yaw)))
    for each in photos:
        content += message(b"D", _of_camera(each, 2 + kinds.index(each.kind)))
    path.write_bytes(content)


_CAMERA_TOPICS = {
    "picture": (b"camera_capture", b":uint64_t timestamp;double lat;double lon;uint32_t seq;int8_t result;"),
    "other": (b"camera_trigger", b":uint64_t timestamp;uint32_t seq;"),
}


def _of_camera(photo: Photo, number: int) -> bytes:
    body = struct.pack("<HQ", number, round(photo.time_s * 1e6))
    if photo.kind == "picture":
        return body + struct.pack("<ddIb", photo.lat_deg, photo.lon_deg, photo.number, int(photo.taken))
    return body + struct.pack("<I", photo.number)


def quaternion(roll_deg: float, pitch_deg: float, yaw_deg: float) -> tuple[float, float, float, float]:
    """w, x, y, z of yaw, pitch, roll in this order, by half angles."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(math.radians(angle) / 2), math.sin(math.radians(angle) / 2))
        for angle in (roll_deg, pitch_deg, yaw_deg)
    )
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
