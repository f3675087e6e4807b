"""Who the vehicle is and whom we believe: foreign types, a companion that lies, a disarm that another station forces."""

from mission_io.autopilots.mission_lists import mission_from_wire, wire_items
from mission_io.errors import CommandRefusedError
from mission_io.model.items import Command, MissionType
from mission_io.wire import messages as m
from mission_io.wire.codec import Framer
from sitl_tests.capabilities.demonstration import SCENARIO
from sitl_tests.case import Case, Finding
from sitl_tests.errors import CheckFailedError, require
from sitl_tests.flying import fly_mission, plan_of, require_flown, waypoints_held
from sitl_tests.matrix import WORKS
from sitl_tests.meddler import Meddler
from sitl_tests.missions import route_mission
from sitl_tests.relay import Relay
from uavcover.errors import VehicleError
from uavcover.flight import connect as session
from uavcover.flight.fly import fly
from uavcover.flight.orders import OnBreach, Orders, Precautions
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightFailedError
from uavcover.scenario.site import load_site

_HEARTBEAT = 0
_FORCED = 21196.0
_LISTEN_S = 3.0
_HOSTILE = ("\x1b[2J\x1b[HPWNED", "\x1b]0;PWNED\x07", "PWNED\nwarning: forged", "\rPWNED\x08\x7f", "\x00PWNED")
"""Clears the screen, sets its title, forges a line, overwrites one; a zero ends a text."""


def foreign_type(case: Case) -> Finding:
    """Other vehicles than multirotors are refused; checks what is sent to one that holds a mission, and what it holds then."""
    with case.station() as station:
        autopilot = station.client.vehicle.autopilot
        station.client.upload(MissionType.MISSION, wire_items(route_mission(case.vehicle.home), autopilot))
    before = _state(case)
    with Relay(case.vehicle.url, seed=case.seed) as relay:
        try:
            with session.connect(session.VehicleLink(url=relay.url, timeout_s=60.0), load_site(SCENARIO)):
                raise CheckFailedError("`plan-upload` would go on with it")
        except VehicleError as error:
            said = str(error)
        with case.station(relay.url) as station:
            mission = route_mission(case.vehicle.home)
            try:
                fly(
                    station.client,
                    station.monitor,
                    plan_of(mission, case.vehicle.home),
                    Orders(
                        on_sample=lambda _: None,
                        on_event=case.take_event,
                        confirmed=True,
                        precautions=Precautions(on_breach=OnBreach.TELL),
                    ),
                    plan_return=lambda *_: mission,
                )
                raise CheckFailedError("`fly` flew it")
            except FlightFailedError as error:
                require(error.outcome.ending is Ending.NOT_ARMED, f"it ended with {error.outcome.ending.key}: {error}")
    sent = _messages_in(relay.sent)
    require(bool(sent) and set(sent) == {_HEARTBEAT}, f"messages {sorted(set(sent))} were sent to it")
    after = _state(case)
    require(after[:2] == before[:2], f"it was {before[:2]} (armed, mode), and is {after[:2]}")
    require(after[2] == before[2], f"its {len(before[2])} items became {len(after[2])} others")
    return Finding(
        "refused", f"{len(sent)} heartbeats sent to it, nothing else; its {len(after[2])} items as before: {said}"
    )


def meddling_companion(case: Case) -> Finding:
    """A companion computer lies all the time; the flight is flown to its end, and nothing is reported."""
    with case.station() as station:
        system_id = station.client.vehicle.system_id
    meddler = Meddler(system_id=system_id, seed=case.seed)
    with Relay(case.vehicle.url, seed=case.seed, meddler=meddler) as relay:
        with case.station(relay.url) as station:
            outcome, path = fly_mission(case, station, route_mission(case.vehicle.home))
        require(outcome.ending is Ending.LANDED, f"it ended with {outcome.ending.key}: {case.events[-1]}")
        require(outcome.incidents == (), f"incidents: {[incident.text for incident in outcome.incidents]}")
    worst_m = require_flown(path, waypoints_held(case))
    rate_hz = outcome.sample_count / outcome.duration_s
    return Finding(WORKS, f"{rate_hz:.1f} samples a second, waypoints passed within {worst_m:.1f} m, no incident")


def hostile_text(case: Case) -> Finding:
    """The autopilot's component sends texts that steer a terminal; none of that is in what the pilot is told."""
    with case.station() as station:
        address = station.client.vehicle.address
    texts = [m.StatusText(6, f"{number}{text}") for number, text in enumerate(_HOSTILE)]
    meddler = Meddler(
        system_id=address.system_id, component_id=address.component_id, seed=case.seed, lies=[lambda rng: rng.choice(texts)]
    )  # fmt: skip
    with (
        Relay(case.vehicle.url, seed=case.seed, meddler=meddler) as relay,
        case.station(relay.url) as station,
    ):
        outcome, _ = fly_mission(case, station, route_mission(case.vehicle.home))
    require(outcome.ending is Ending.LANDED, f"it ended with {outcome.ending.key}: {case.events[-1]}")
    shown = [event for event in case.events if "PWNED" in event]
    hostile = [event for event in case.events if not event.isprintable()]
    require(bool(shown), "none of the texts was told")
    require(not hostile, f"control characters were told: {hostile[:1]!r}")
    return Finding(WORKS, f"{len(shown)} hostile texts told, none with a control character")


def force_disarm(case: Case) -> Finding:
    """Another station disarms it by force on the way to the second waypoint."""
    answers: list[str] = []
    with case.station() as station, case.second_station() as second:

        def disarm(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 1 and not answers:
                answers.append("accepted")
                try:
                    second.client.command(Command.COMPONENT_ARM_DISARM, 0.0, _FORCED)
                except CommandRefusedError as error:
                    answers[0] = error.result_name

        outcome, path = fly_mission(case, station, route_mission(case.vehicle.home), on_event=disarm)
    require(answers == ["accepted"], f"the forced disarm was answered {answers}")
    highest_m, lowest_m = max(up for _, _, up in path.enu_m), path.last_m[2]
    reported = next((line for line in reversed(case.events) if "fly ended with" in line), "")
    if outcome.ending is Ending.CRASHED:
        require("m above home" in reported or "m above the ground" in reported, f"the height is missing: {reported}")
    return Finding(outcome.ending.key, f"flown at {highest_m:.0f} m, last told at {lowest_m:.0f} m; {reported}")


def _state(case: Case) -> tuple[bool, int, tuple[str, ...]]:
    """Whether it is armed, its mode, and the items it holds (without home), for a station that asks it directly."""
    with case.station() as station:
        station.client.poll(_LISTEN_S)
        vehicle = station.client.vehicle
        held = mission_from_wire(station.client.download(MissionType.MISSION), vehicle.autopilot)
        return vehicle.armed, vehicle.custom_mode, tuple(map(repr, held.items))  # NaN equals itself


def _messages_in(datagrams: list[bytes]) -> list[int]:
    framer = Framer()
    return [frame.message_id for data in datagrams for frame in [*framer.feed(data), *framer.end()]]
