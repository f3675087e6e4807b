"""Watch in flight the checks before arming: home, parameters, fence, rally points, identities.

A change is an alarm that says what comes of it, in metres where it has any; ``--on-breach`` acts on it.
"""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence

import shapely

from mission_io.autopilots.comparison import compare_items, fault_text
from mission_io.autopilots.mission_lists import items_of, mission_type_of
from mission_io.client.peers import two_in_one
from mission_io.errors import CommandRefusedError, FormatError, MissionIoError
from mission_io.model.enums import LandedState
from mission_io.model.items import FramedPoint, Mission, MissionItem, MissionType, fence_from_items, rally_from_items
from mission_io.wire import messages as m
from uavcover.flight.limits import limit_table, numbers
from uavcover.flight.mission_guard import ListReading
from uavcover.flight.orders import PREPARATION, FlightPlan
from uavcover.flight.parameter_rules import Limit, Weight, parameter_table
from uavcover.flight.position_watch import HomeWatch, rest_of_legs
from uavcover.flight.session import Session, Timer
from uavcover.kernels.arrays import FloatArray
from uavcover.model.track import Ending, EventKind, FlightFaultError
from uavcover.terrain.frames import LocalFrame

_FENCE_BIT = 0x100000
_ORDER = (Weight.NONE, Weight.NOTE, Weight.WARNING, Weight.REFUSED)

ReturnsChanged = Callable[[Mapping[str, float]], None]
"""Receives all known parameters after a change of the rally points or of a parameter of the autopilot's return."""


class Preconditions:
    """The checks before arming, watched until the landing.

    Made before arming: it reads the fence and the rally points, and asks for home and the origin now and then.
    """

    def __init__(
        self,
        session: Session,  # with the vehicle
        plan: FlightPlan,  # what it is to fly
        values: Mapping[str, float],  # the vehicle's parameters of the table, in their own units, as they were judged
        *,
        returns_changed: ReturnsChanged = lambda _: None,  # judges the autopilot's own return anew
    ) -> None:
        self._session, self._plan = session, plan
        self._px4 = session.is_px4
        for kind in (m.HomePosition, m.GpsGlobalOrigin):
            with contextlib.suppress(CommandRefusedError):  # both autopilots send them by themselves when they change
                session.client.request_message_interval(kind, PREPARATION.position_each_s)
        self._home = HomeWatch(session, plan, px4=self._px4)
        self._settings = _SettingsWatch(session, plan, values, px4=self._px4, returns_changed=returns_changed)
        self._lists = [
            _ListWatch(session, plan, kind, lambda: returns_changed(self._settings.values)) for kind in _LISTS
        ]
        self._was_in_force = self._is_off = False
        self._reported: set[str] = set()
        self._moved_before_m = 0.0

    @property
    def rally(self) -> Sequence[FramedPoint] | None:
        """The rally points that the vehicle holds; None if they could not be read."""
        held = self._lists[_LISTS.index(MissionType.RALLY)].held
        with contextlib.suppress(FormatError):
            return None if held is None else rally_from_items(held).points
        return None

    def look(self, meanwhile: Callable[[], None]) -> None:
        """Look at everything once; called while the vehicle is in the air.

        Args:
            meanwhile: what has to be done all the time, also while a list is read.
        """
        self._home.look()
        self._settings.look()
        self._look_at_ids()
        for one in self._lists:
            one.look(meanwhile)
        self._tell_lists()

    def go_home(self, sent: Mission) -> FlightPlan:
        """Watch a return from here on, whose heights make up for the home that was moved; returns its plan.

        What was changed before and still lasts is judged by the return.
        """
        watch = self._session.watch
        self._moved_before_m += self._home.moved_up_m
        plan = self._plan.return_plan(sent, home_up_m=self._moved_before_m)
        watch.close(Ending.MISSION_CHANGED, "the vehicle contains the uploaded return")
        watch.close(Ending.HOME_MOVED, "the return compensates for the moved home")
        self._home = HomeWatch(self._session, plan, px4=self._px4)
        self._settings.go_home(plan)
        for one in self._lists:
            one.go_home(plan)
        return plan

    def home_moved_up_m(self) -> float:
        """Rise of home since its check; heights above home in later commands are off by it."""
        with contextlib.suppress(MissionIoError):  # the vehicle tells a move by itself, too
            self._session.client.request_message(m.HomePosition)
        self._home.look()
        return self._moved_before_m + self._home.moved_up_m

    def look_once_more(self) -> None:
        """After the landing: a list that was changed in the last minute is one, too."""
        for one in self._lists:
            if not self._session.watch.is_open(one.kind):
                one.look_once_more()
        self._tell_lists()

    def _tell_lists(self) -> None:
        off = self._fence_off_text()
        for one in self._lists:
            text = (off if one.kind is Ending.FENCE_CHANGED else "") or one.text
            if text:
                self._session.watch.open(one.kind, text)
            else:
                self._session.watch.close(one.kind, f"the vehicle's {one.name} again as before")

    def _fence_off_text(self) -> str:
        """Text when the fence is out of force, by ArduPilot's SYS_STATUS: a command can switch it without a parameter."""
        status, state = self._session.monitor.latest(m.SysStatus), self._session.monitor.latest(m.ExtendedSysState)
        lands = state is not None and state.landed_state == LandedState.LANDING  # which ends the least height
        if not self._px4 and status is not None and not lands:
            in_force = bool(status.sensors_enabled & _FENCE_BIT)
            self._was_in_force |= in_force
            self._is_off = self._was_in_force and not in_force
        return "the vehicle's fence was disabled in flight and is no longer enforced" if self._is_off else ""

    def _look_at_ids(self) -> None:
        client = self._session.client
        if client.impostor is not None:
            self._tell_once(
                f"{two_in_one(client.vehicle, client.impostor)}: messages and commands may belong to either"
            )
        for address in client.peers.same_ids:
            self._tell_once(
                f"another ground station (component {address.component_id}) uses uavcover's system ID, "
                f"{address.system_id}, so the vehicle cannot detect a lost link; specify another ID with --own-system"
            )

    def _tell_once(self, text: str) -> None:
        if text not in self._reported:
            self._reported.add(text)
            self._session.alarm(text)


class _SettingsWatch:
    """The parameters of the table: those that are broadcast when they change, and each one read again now and then."""

    def __init__(
        self,
        session: Session,
        plan: FlightPlan,
        values: Mapping[str, float],
        *,
        px4: bool,
        returns_changed: ReturnsChanged,
    ) -> None:
        self._session, self._plan, self._px4, self._returns_changed = session, plan, px4, returns_changed
        self.values = dict(values)
        self._before = dict(values)
        self._rows_before = self._rows()
        self._names = list(values)
        self._next = Timer(session, PREPARATION.parameter_each_s)
        self._worse = ""
        self._unanswered = 0
        session.monitor.parameters.clear()

    def look(self) -> None:
        session = self._session
        if self._names and self._next.over:
            self._ask_next()
        heard = session.monitor.parameters
        if heard:
            self._unanswered, session.watch.unanswered = 0, ""
            values = numbers(heard, px4=self._px4)
            heard.clear()
            changed = {
                name: value
                for name, value in values.items()
                if name in self.values and not _same(value, self.values[name])
            }
            by_mission = {
                name for name, value in changed.items() if any(_same(value, own) for own in self._own_values(name))
            }
            self.values.update((name, changed.pop(name)) for name in by_mission)
            if changed:
                self._take(changed)
        if self._worse or session.watch.is_open(Ending.SETTINGS_CHANGED):
            session.watch.measure(
                Ending.SETTINGS_CHANGED,
                0.0 if self._worse else None,
                self._worse,
                "the parameters on which the mission depends were restored",
            )

    def go_home(self, plan: FlightPlan) -> None:
        """Judge by a return what is changed from here on; the autopilot's own returns were judged for the route."""
        self._plan, self._returns_changed = plan, lambda _: None
        self._rows_before = self._rows()

    def _ask_next(self) -> None:
        session, vehicle = self._session, self._session.client.vehicle
        self._next.restart()
        self._names.append(name := self._names.pop(0))
        if self._unanswered == PREPARATION.most_unanswered and not session.watch.is_open(Ending.LINK_LOST):
            many = PREPARATION.most_unanswered
            text = f"vehicle {vehicle.system_id} sends messages but did not answer {many} consecutive requests"
            session.watch.unanswered = text
            session.alarm(f"{text}; the link may be lost, or the vehicle accepts only another ground station")
        self._unanswered += 1
        session.client.send(m.ParamRequestRead(*vehicle.address, name))

    def _rows(self) -> dict[str, Limit]:
        rows = limit_table(
            self.values,
            self._plan,
            px4=self._px4,
            home_alt_amsl_m=None,
            own_system=self._session.client.local.system_id,
        )
        return {row.parameter: row for row in rows if row.parameter}

    def _own_values(self, name: str) -> list[float]:
        """Values of a parameter that the mission itself sets."""
        row = parameter_table(px4=self._px4).row_of(name)
        return [] if row is None else [i.params[0] for i in self._plan.mission.items if i.command == row.set_by]

    def _take(self, changed: Mapping[str, float]) -> None:
        table, session = parameter_table(px4=self._px4), self._session
        was, was_rows = dict(self.values), self._rows()
        self.values.update(changed)
        rows = self._rows()
        worse = [row for name, row in rows.items() if _grew(row, was_rows.get(name))]
        what = ", ".join(f"{name} was changed in flight from {was[name]:g} to {now:g}" for name, now in changed.items())
        flown = [
            row.flown
            for name in changed
            if (row := table.row_of(name)) is not None
            and row.flown
            and name in rows
            and rows[name].weight is not Weight.NONE
        ]
        flown += [f"the mission sets it to {max(own):g}" for name in changed if (own := self._own_values(name))]
        reasons = flown + [row.sentence for row in worse]
        flight = "return" if self._plan.is_return else "mission"
        text = f"{what}: {'; '.join(reasons)}" if reasons else f"{what}; this does not affect the {flight}"
        # A vehicle that is set so would not have been armed, and was.
        refused = [row for row in rows.values() if row.weight is Weight.REFUSED]
        breaches = [row for row in refused if _grew(row, self._rows_before.get(row.parameter))]
        if breaches:
            self._worse = text if any(row in breaches for row in worse) else self._worse or text
        else:
            self._worse = ""
        if not any(row in breaches for row in worse):
            session.tell(
                EventKind.WARNING, text, alarm=bool(flown) or any(row.weight is Weight.WARNING for row in worse)
            )
        if any((row := table.row_of(name)) is not None and row.returns for name in changed):
            self._returns_changed(self.values)


def _same(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=1e-5, abs_tol=1e-6)


def _grew(row: Limit, before: Limit | None) -> bool:
    return _ORDER.index(row.weight) > (0 if before is None else _ORDER.index(before.weight))


_LISTS = (MissionType.FENCE, MissionType.RALLY)


class _ListWatch:
    """The fence or the rally points of the vehicle, read again at each sign of a change, and periodically."""

    def __init__(
        self, session: Session, plan: FlightPlan, mission_type: MissionType, returns_changed: Callable[[], None]
    ) -> None:
        self._session, self._plan, self._type, self._returns_changed = session, plan, mission_type, returns_changed
        fence = mission_type is MissionType.FENCE
        self.kind = Ending.FENCE_CHANGED if fence else Ending.RALLY_CHANGED
        self.name = "fence is" if fence else "rally points are"
        self.text = ""
        try:
            self._before: tuple[MissionItem, ...] | None = session.client.download(mission_type)
        except (MissionIoError, FormatError) as error:
            self._before = None
            session.warn(f"the vehicle's {self.name} not monitored, because reading failed: {error}")
        self._reading: ListReading | None = None
        self._signs = self._signs_now
        for planned in plan.lists:
            if mission_type_of(planned) is mission_type and self._before is not None:
                wanted = items_of(planned, session.autopilot)
                wrong = fault_text(compare_items(wanted, self._before, session.autopilot, mission_type))
                if wrong is not None:
                    what = self._consequence(self._before)
                    session.warn(f"the vehicle's {self.name} not as planned: {wrong}; {what}; repeat plan-upload")

    @property
    def held(self) -> tuple[MissionItem, ...] | None:
        """The list at the last reading; None if it could not be read."""
        return self._before if self._reading is None else self._reading.held

    @property
    def _signs_now(self) -> tuple[int, int]:
        current = self._session.monitor.latest(m.MissionCurrent)
        ids = (0, 0) if current is None else (current.fence_id, current.rally_points_id)
        return ids[0 if self._type is MissionType.FENCE else 1], self._session.monitor.lists_taken[self._type]

    def look(self, meanwhile: Callable[[], None]) -> None:
        if self._before is None:
            return
        session = self._session
        if self._reading is None:
            self._reading = ListReading(
                session, self._before, meanwhile, mission_type=self._type, every_s=PREPARATION.list_each_s
            )
        signs = self._signs_now
        if signs != self._signs:
            self._signs = signs
            self._reading.ask()
        if self._reading.due:
            self._read(self._reading)

    def go_home(self, plan: FlightPlan) -> None:
        """Judge it by a return from here on."""
        self._plan, self._returns_changed = plan, lambda: None
        if self.text and self._reading is not None and self._type is MissionType.FENCE:
            problem = self._consequence(self._reading.held)
            self._session.alarm(f"the fence was changed in flight: {problem}")

    def look_once_more(self) -> None:
        """Read it after the landing; a vehicle that is switched off by then is not asked."""
        if self._reading is not None:
            with contextlib.suppress(FlightFaultError):
                self._read(self._reading)

    def _read(self, reading: ListReading) -> None:
        difference = reading.difference()
        if reading.requested:  # it could not be read
            return
        text = "" if difference is None else self._reported(difference, reading.held)
        if text != self.text:
            self.text = text
            self._returns_changed()

    def _reported(self, difference: str, held: tuple[MissionItem, ...]) -> str:
        what = "fence" if self._type is MissionType.FENCE else "rally points"
        return f"another station changed the vehicle's {what} in flight: {difference}; {self._consequence(held)}"

    def _consequence(self, held: tuple[MissionItem, ...]) -> str:
        """Consequence of another list for the rest of the flight."""
        if self._type is MissionType.RALLY:
            return "the autopilot's own return may lead there along an unchecked path"
        if not held:
            return "the vehicle has no fence"
        flight = "return" if self._plan.is_return else "mission"
        outside_m = _outside_m(held, self._plan.frame, rest_of_legs(self._plan, self._session))
        if outside_m > 0.0:
            return (
                f"the remaining {flight} leads {outside_m:.0f} m outside this fence; an active fence would "
                "interrupt the flight there"
            )
        return f"the remaining {flight} stays inside this fence"


def _outside_m(items: tuple[MissionItem, ...], frame: LocalFrame, legs_m: list[FloatArray]) -> float:
    """Largest distance of the legs outside a fence, or length inside its exclusions."""
    fence = fence_from_items(items)

    def east_north(lat_deg: float, lon_deg: float) -> tuple[float, float]:
        east, north, _ = frame.enu_from_geodetic(lat_deg, lon_deg, frame.alt_amsl_m)[0].tolist()
        return east, north

    kept = [shapely.Polygon([east_north(v.lat_deg, v.lon_deg) for v in one.vertices]) for one in fence.polygons]
    kept += [shapely.Point(east_north(c.center.lat_deg, c.center.lon_deg)).buffer(c.radius_m) for c in fence.circles]
    inclusions = [one.inclusion for one in fence.polygons] + [one.inclusion for one in fence.circles]
    shapes = [(shape.buffer(0.0), inclusion) for shape, inclusion in zip(kept, inclusions, strict=True)]
    inside = shapely.union_all([shape for shape, inclusion in shapes if inclusion])
    outside = shapely.union_all([shape for shape, inclusion in shapes if not inclusion])
    distances_m = [0.0]
    for leg in legs_m:
        ends = [shapely.Point(position) for position in leg[:, :2].tolist()]
        distances_m += [] if inside.is_empty else [float(inside.distance(end)) for end in ends]
        distances_m.append(float(shapely.LineString(ends).intersection(outside).length))
    return max(distances_m)
