"""A multirotor with an autopilot that speaks MAVLink, without a socket or a clock of its own.

``now`` is vehicle time: seconds since the vehicle was switched on. Equal seeds and equal messages at equal times give
equal flights.
"""

import numpy as np

from mission_io.autopilots.autopilot import Autopilot
from mission_io.model.enums import Severity
from mission_io.model.items import GeoPoint
from mission_io.wire import messages as m
from uavcover.mock.body import Ground
from uavcover.mock.commands import handle
from uavcover.mock.failsafes import Failsafes
from uavcover.mock.fault_effects import apply_faults
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.positioning import OnTruth
from uavcover.mock.smart_return import SMART_RTL
from uavcover.mock.state import MockConfig, MockState
from uavcover.mock.telemetry import tell, truth_sample
from uavcover.mock.tuning import BODY, FLIGHT

__all__ = ["MockConfig", "MockVehicle"]


class MockVehicle(MockState):
    """The vehicle: feed it with ``receive`` and ``advance``, and send what ``outgoing`` returns.

    Args:
        autopilot: the autopilot to imitate: ``mission_io.autopilots.autopilot.ARDUPILOT`` or ``PX4``.
        home: where it stands.
        config: what kind of vehicle it is; None takes the defaults.
        ground: height of the ground above mean sea level by latitude and longitude; None is flat at home's height.
        rng: of gusts and errors; None is seed 0.
        on_truth: called with the true position each time the vehicle reports its position.

    Attributes:
        control: what the vehicle can be made to do.
        failsafes: what it does by itself.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        home: GeoPoint,
        config: MockConfig | None = None,
        *,
        ground: Ground | None = None,
        rng: np.random.Generator | None = None,
        on_truth: OnTruth | None = None,
    ) -> None:
        super().__init__(
            autopilot,
            home,
            config if config is not None else MockConfig(),
            ground=ground,
            rng=rng if rng is not None else np.random.default_rng(0),
        )
        self.control = FlightControl(self)
        self.failsafes = Failsafes(self.control)
        self._on_truth = on_truth
        self._texts_said = 0

    def receive(self, received: m.Received, now: float) -> None:
        """Handle a message that arrives at ``now``."""
        self.advance(now)
        local = self.address
        if self.ignores(received.system_id):
            return
        if self.cut_off or not m.is_for(received.message, system_id=local.system_id, component_id=local.component_id):
            return
        self.send_all(handle(self.control, self.failsafes, received))

    def advance(self, now: float) -> None:
        """Let vehicle time run to ``now``, counted from when it was first switched on; an earlier time does nothing."""
        last = int(now / BODY.step_s + 1e-6)
        while self.steps_done < last:
            self.steps_done += 1
            self._step()
        self.send_all(self.missions.messages_to_send(self.powered_s))
        self.control.apply_mission_changes()

    def outgoing(self) -> list[m.Message]:
        """Messages since the last call. A message with a target is for that ground station only."""
        self.send_all(self.missions.messages_to_send(self.powered_s))
        return self.take_queued()

    def _step(self) -> None:
        body = self.body
        if self.steps_done <= self.off_until_step:
            if body.falling:
                body.step(self.time_s)
            if self.steps_done == self.off_until_step:
                self._boot()
            return
        now = self.time_s
        apply_faults(self.control)
        if self.armed or body.falling:
            self._fly(now)
        body.believed.step()
        if self.steps_done % FLIGHT.check_every == 0:
            self._check()
        if now + 1e-9 >= self.streams.next_due_s:
            for kind in self.streams.due(now):
                tell(self, kind)
                if kind is m.GlobalPositionInt and self._on_truth is not None:
                    self._on_truth(truth_sample(self))
        texts = self.behaviour.start_texts
        while self._texts_said < len(texts) and now >= texts[self._texts_said].at_s:
            self.say(texts[self._texts_said].severity, texts[self._texts_said].text)
            self._texts_said += 1

    def _check(self) -> None:
        """Draw power, check the failsafes, send what mission transfers have due, and note what terrain is wanted."""
        self.body.draw_power(FLIGHT.check_every * BODY.step_s, motors=self.flying)
        self._note_trail()
        self.failsafes.check()
        self.send_all(self.missions.messages_to_send(self.powered_s))
        if self.terrain is not None and self.home_known:
            self.terrain.want_for(self.body.home, self.mission_items)

    def _note_trail(self) -> None:
        """Keep SmartRTL's positions, of which it flies one after the other."""
        if not (self.armed and self.is_ardupilot):
            return
        here = None if self.body.believed.lost else self.body.believed.position_m
        if self.custom_mode != SMART_RTL:
            if (words := self.trail.note(here, self.time_s)) is not None:
                self.say(Severity.WARNING, words)
        elif here is not None:
            self.trail.pop_near(here)

    def _boot(self) -> None:
        self._texts_said = 0
        self.control.boot()
        self.camera.reset()
        self.failsafes.reset()

    def _fly(self, now: float) -> None:
        body = self.body
        was_landed = body.on_ground
        body.step(now)
        if was_landed != body.on_ground:
            self._landing_changed(now)
        if not self.armed:
            return
        self.control.mission.go_on(now)
        self.send_all(self.camera.step(now))
        if body.on_ground and (body.crashed or now >= self.disarm_at_s):
            self.control.disarm()

    def _landing_changed(self, now: float) -> None:
        tell(self, m.ExtendedSysState)
        if not self.body.on_ground:
            if self.took_off_at_s is None:
                self.took_off_at_s = self.powered_s
            return
        self.disarm_at_s = now + FLIGHT.disarm_after_landing_s
        if self.body.crashed and not self.armed:
            return  # nothing detects a crash any more
        if self.body.crashed:
            self.say(Severity.CRITICAL, "Crash: Disarming: hit the ground")
            return
        self.say(Severity.INFO, "Landed")
        self.control.mission.landed(now)
        self.follow([])
