"""Parameters against a vehicle that encodes them by itself, on links that lose datagrams."""

import struct
from typing import ClassVar

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.client.commands import VehicleParameters
from mission_io.errors import MisuseError, VehicleSilentError, WaitCancelledError
from mission_io.links.simulated import Conditions
from mission_io.model.enums import ParamType
from mission_io.protocol.parameters import bytes_of_value, float_of_value, same_value, value_of_bytes, value_of_float
from mission_io.wire import messages as m
from tests.mission_io.vehicle import VehiclePeer, connected

NAMES = [f"P{n:03d}_WHOLE" if n % 2 else f"P{n:03d}_REAL" for n in range(300)]


class HasParameters(VehiclePeer):
    """300 parameters: whole ones with odd numbers. ``deaf_to`` are never answered; P299 is limited to 7."""

    def __init__(self, autopilot: Autopilot = ARDUPILOT) -> None:
        super().__init__(autopilot)
        self.values: dict[str, float] = {name: n - 150 if n % 2 else n + 0.25 for n, name in enumerate(NAMES)}
        self.deaf_to: set[str] = set()
        self.errors = False
        self.sets = 0

    def value(self, name: str) -> m.ParamValue:
        number = NAMES.index(name)
        value = self.values[name]
        if number % 2 and self.autopilot is PX4:
            (value,) = struct.unpack("<f", struct.pack("<i", int(value)))
        return m.ParamValue(name, float(value), 6 if number % 2 else 9, len(NAMES), number)

    def on_message(self, received: m.Received, *_: object) -> None:
        match received.message:
            case m.ParamRequestList():
                self.outbox += [self.value(name) for name in NAMES if name not in self.deaf_to]
            case m.ParamRequestRead(_, _, name, index):
                name = NAMES[index] if index >= 0 else name
                if name in self.values and name not in self.deaf_to:
                    self.outbox.append(self.value(name))
                elif self.errors:
                    self.outbox.append(m.ParamError(255, 190, name, index, 1))
            case m.ParamSet(_, _, name, wire, _):
                self.sets += 1
                if NAMES.index(name) % 2 and self.autopilot is PX4:
                    (wire,) = struct.unpack("<i", struct.pack("<f", wire))
                self.values[name] = min(wire, 7) if name == "P299_WHOLE" else wire
                self.outbox.append(self.value(name))


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda autopilot: autopilot.name)
def test_all_parameters_come_whatever_gets_lost(autopilot: Autopilot, loss: float) -> None:
    peer = HasParameters(autopilot)
    client = connected(peer, conditions=Conditions(loss=loss))
    reported: list[tuple[int, int]] = []
    found = VehicleParameters(client).all(progress=lambda done, total: reported.append((done, total)))
    assert list(found) == NAMES
    assert {name: one.value for name, one in found.items()} == peer.values
    assert all(isinstance(found[name].value, int) for name in NAMES[1::2])
    assert reported[-1] == (300, 300)
    requested = sum(isinstance(r.message, m.ParamRequestRead) for r in peer.heard)
    assert requested <= 300 * loss * 4


def test_a_group_is_what_begins_so() -> None:
    assert list(VehicleParameters(connected(HasParameters())).all(prefix="P29")) == NAMES[290:]


def test_what_never_comes_is_said_by_its_number() -> None:
    peer = HasParameters()
    peer.deaf_to = {NAMES[17]}
    with pytest.raises(
        VehicleSilentError, match="vehicle 1, component 1 sent 299 of 300 parameters; number 17 is missing"
    ):
        VehicleParameters(connected(peer)).all(silent_s=3.0)
    with pytest.raises(VehicleSilentError, match="sent no parameter"):
        VehicleParameters(connected(VehiclePeer())).all(silent_s=3.0)
    with pytest.raises(WaitCancelledError, match="stopped after 0 of an unknown number"):
        VehicleParameters(connected(VehiclePeer())).all(stop=lambda: True)


def test_a_list_that_shrinks_on_the_way_is_followed() -> None:
    class Shrinks(HasParameters):
        def value(self, name: str) -> m.ParamValue:
            number = NAMES.index(name)
            return m.ParamValue(name, 1.0, 9, 120 if number > 140 else 300, number)

    found = VehicleParameters(connected(Shrinks())).all()
    assert list(found) == NAMES[:120]


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda autopilot: autopilot.name)
def test_some_by_name_and_none_of_those_that_do_not_exist(autopilot: Autopilot) -> None:
    peer = HasParameters(autopilot)
    client = connected(peer, conditions=Conditions(loss=0.2))
    found = VehicleParameters(client).read(["P003_WHOLE", "NO_SUCH", "P004_REAL"], timeout_s=5.0)
    assert {name: one.value for name, one in found.items()} == {"P003_WHOLE": -147, "P004_REAL": 4.25}


def test_a_vehicle_that_says_what_it_does_not_have_is_not_waited_for() -> None:
    peer = HasParameters()
    peer.errors = True
    client = connected(peer)
    start = client.clock.now()
    assert VehicleParameters(client).read(["NO_SUCH"], timeout_s=5.0) == {}
    assert client.clock.now() - start < 0.5


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda autopilot: autopilot.name)
def test_what_is_set_is_confirmed(autopilot: Autopilot, loss: float) -> None:
    peer = HasParameters(autopilot)
    client = connected(peer, conditions=Conditions(loss=loss))
    wanted = {"P003_WHOLE": -5, "P004_REAL": 0.1, "P005_WHOLE": 1_000_001}
    confirmed = VehicleParameters(client).set(wanted, timeout_s=20.0)
    assert confirmed["P004_REAL"].value == pytest.approx(0.1)
    assert {peer.values["P003_WHOLE"], peer.values["P005_WHOLE"]} == {-5, 1_000_001}


def test_what_is_limited_refused_or_unknown_is_said() -> None:
    peer = HasParameters()
    parameters = VehicleParameters(connected(peer))
    with pytest.raises(MisuseError, match=r"refused or limited: P299_WHOLE stays 7 \(set: P004_REAL\)"):
        parameters.set({"P004_REAL": 1.0, "P299_WHOLE": 9})
    sets = peer.sets
    for name, value, why in [
        ("P003_WHOLE", 1.5, "not a whole number"),
        ("P003_WHOLE", 2**31, "does not fit in INT32"),
        ("P003_WHOLE", 2**24 + 1, "does not fit in a 32-bit float"),
        ("P004_REAL", 1e300, "beyond the range"),
        ("NO_SUCH", 1, "did not report NO_SUCH, so no parameter was set"),
    ]:
        with pytest.raises(MisuseError, match=why):
            parameters.set({"P001_WHOLE": 1, name: value})
    assert peer.sets == sets


def test_a_vehicle_that_does_not_confirm_is_silent() -> None:
    class Deaf(HasParameters):
        def on_message(self, received: m.Received, now: float) -> None:
            if not isinstance(received.message, m.ParamSet):
                super().on_message(received, now)

    with pytest.raises(VehicleSilentError, match=r"did not confirm P003_WHOLE within 2 s \(set: none\)"):
        VehicleParameters(connected(Deaf())).set({"P003_WHOLE": 1}, timeout_s=2.0)


def test_a_flood_of_values_makes_us_ask_no_more() -> None:
    class Floods(HasParameters):
        flood_at = 1.5

        def datagrams_to_send(self, now: float) -> list[bytes]:
            if now >= self.flood_at:
                self.flood_at = now + 0.02
                self.outbox += [self.value(NAMES[0])] * 20
            return super().datagrams_to_send(now)

        def next_timer(self) -> float | None:
            return min(self.flood_at, super().next_timer() or self.flood_at)

    peer = Floods()
    peer.deaf_to = {NAMES[5]}
    client = connected(peer)
    with pytest.raises(VehicleSilentError):
        VehicleParameters(client).all(silent_s=5.0)
    assert sum(isinstance(r.message, m.ParamRequestRead) for r in peer.heard) <= 5


class Camera(VehiclePeer):
    """Component 100 of system 1 with extended parameters; CAM_MODE takes a while, CAM_NO is refused."""

    values: ClassVar = {
        "CAM_MODE": (2, b"\xff"),
        "CAM_NAME": (11, b"front"),
        "CAM_BIG": (7, bytes(range(8))),
        "CAM_NO": (1, b"\1"),
    }
    tries = 0

    def say(self, name: str) -> m.ParamExtValue:
        kind, raw = self.values[name]
        return m.ParamExtValue(name, raw, kind, len(self.values), list(self.values).index(name))

    def on_message(self, received: m.Received, *_: object) -> None:
        names = list(self.values)
        match received.message:
            case m.ParamExtRequestList(_, 100):
                self.outbox += [self.say(name) for name in names]
            case m.ParamExtRequestRead(_, 100, name, index):
                self.outbox.append(self.say(names[index] if index >= 0 else name))
            case m.ParamExtSet(_, 100, name, raw, kind):
                self.tries += 1
                if name == "CAM_NO":
                    self.outbox.append(m.ParamExtAck(name, self.values[name][1], kind, 1))
                    return
                if name == "CAM_MODE" and self.tries == 1:
                    self.outbox.append(m.ParamExtAck(name, self.values[name][1], kind, 3))
                    return
                self.values[name] = (kind, raw)
                self.outbox.append(m.ParamExtAck(name, raw, kind, 0))

    def datagrams_to_send(self, now: float) -> list[bytes]:
        mine = [one for one in self.outbox if isinstance(one, m.ParamExtValue | m.ParamExtAck)]
        self.outbox = [one for one in self.outbox if one not in mine]
        camera = type(self.codec)(system_id=1, component_id=100)
        return [*super().datagrams_to_send(now), *(camera.encode(one) for one in mine)]


def test_extended_parameters_of_a_camera() -> None:
    peer = Camera()
    camera = VehicleParameters(connected(peer), component_id=100, extended=True)
    values = {name: one.value for name, one in camera.all().items()}
    assert values == {"CAM_MODE": -1, "CAM_NAME": b"front", "CAM_BIG": 0x0706050403020100, "CAM_NO": 1}
    done = camera.set({"CAM_MODE": -3, "CAM_NAME": b"rear", "CAM_BIG": 2**64 - 1})
    assert {name: one.value for name, one in done.items()} == {
        "CAM_MODE": -3,
        "CAM_NAME": b"rear",
        "CAM_BIG": 2**64 - 1,
    }
    with pytest.raises(MisuseError, match=r"CAM_NO unsupported value \(set: none\)"):
        camera.set({"CAM_NO": 2})
    with pytest.raises(MisuseError, match="CAM_NAME: only parameters of type CUSTOM accept bytes"):
        camera.set({"CAM_NAME": 2})


@pytest.mark.parametrize(("capabilities", "value"), [(0x10, -147), (0x20000, None), (0, None)])
def test_an_unknown_autopilot_is_asked_how_it_encodes(capabilities: int, value: int | None) -> None:
    class Unknown(HasParameters):
        def on_message(self, received: m.Received, now: float) -> None:
            super().on_message(received, now)
            if isinstance(received.message, m.CommandLong):
                self.outbox.append(m.AutopilotVersion(capabilities))

    peer = Unknown(PX4)
    peer.autopilot_number = 0
    client = connected(peer)
    if not capabilities:
        with pytest.raises(
            MisuseError, match="does not report how its parameters encode whole numbers; specify bytewise"
        ):
            VehicleParameters(client)
        assert VehicleParameters(client, bytewise=True).read(["P003_WHOLE"])["P003_WHOLE"].value == -147
        return
    found = VehicleParameters(client).read(["P003_WHOLE"])["P003_WHOLE"].value
    assert found == value if value is not None else found != found  # the bits of -147 are no number


@pytest.mark.parametrize("kind", [one for one in ParamType if one < ParamType.UINT64])
@pytest.mark.parametrize("bytewise", [False, True])
def test_values_survive_the_wire(kind: ParamType, bytewise: bool) -> None:
    bits = {1: 8, 2: 8, 3: 16, 4: 16, 5: 32, 6: 32}[kind]
    low = 0 if kind % 2 else -(2 ** (bits - 1))
    high = min(2**bits + low - 1, 2**24)
    for value in (low if bytewise or bits < 32 else max(low, -(2**24)), 0, 1, 77, high):
        wire = float_of_value(value, kind, bytewise=bytewise, name="P")
        (sent,) = struct.unpack("<f", struct.pack("<f", wire))
        assert value_of_float(sent, kind, bytewise=bytewise) == value
        assert value_of_bytes(bytes_of_value(value, kind, name="P"), kind) == value


def test_bits_that_no_float_carries_are_refused_and_nan_is_no_number() -> None:
    with pytest.raises(MisuseError, match="signalling NaN"):
        float_of_value(-8388607, ParamType.INT32, bytewise=True, name="P")
    nan = value_of_float(float("nan"), ParamType.INT32, bytewise=False)
    assert same_value(nan, float("nan"), ParamType.INT32)
    assert not same_value(nan, 0, ParamType.INT32)
    assert same_value(0.1, struct.unpack("<f", struct.pack("<f", 0.1))[0], ParamType.REAL32)
    with pytest.raises(MisuseError, match="64 bits"):
        float_of_value(1, ParamType.INT64, bytewise=False, name="P")
