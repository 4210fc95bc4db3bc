"""A session played to the mock in simulated time, through the frames of its two links."""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.config import LinkConfig, MockConfig
from mock_autopilot.faults.fault import Fault
from mock_autopilot.mavlink.frames import messages_in
from mock_autopilot.mavlink.link import MavlinkLink
from mock_autopilot.mavlink.streams import DEFAULTS, TICK_S
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.world import World
from tests.mock_autopilot.bench import SIH_PLANT
from tests.mock_autopilot.reenact.events import FAILSAFE_OVER, READERS, Event, EventReader
from tests.mock_autopilot.reenact.flyer import Flyer
from tests.mock_autopilot.reenact.session import GCS, ONBOARD, Cut, Pose, SentFrame, Session, Setpoint, Sticks
from tests.mock_autopilot.reenact.tolerances import tolerance_of

COMPANION, PILOT, COMPONENT = 245, 255, 190
MOCAP_NOISE_M, MOCAP_NOISE_RAD = 3e-4, 2e-3
"""The recorded motion capture's."""
WEIGHT_N = 9.80665
"""Weight of the recorded vehicle, 1 kg."""
GRACE_S = 0.02
"""Tolerance of the times of answers against the recording."""
REPEATED_S = 1.0
REPEATS = 6
TAIL_S = 0.3
DRAIN_STEP_S = 0.1
ARM_DISARM = 400

Input = SentFrame | Setpoint | Pose | Sticks | Cut


@dataclass(frozen=True, kw_only=True)
class Shift:
    """The mock's delay against the recording, from one recorded disarming on."""

    disarmed_s: float
    by_s: float

    @property
    def from_s(self) -> float:
        """Return the begin of the events that belong to the disarming, s."""
        return self.disarmed_s - GRACE_S


@dataclass(frozen=True, kw_only=True)
class Played:
    """The mock's events, and the shifts of its clock against the recording's."""

    events: list[Event]
    shifts: list[Shift]
    handed: list[tuple[float, float]]
    """Times at which each frame was recorded and delivered to the mock, s."""
    ends_at_s: float
    """End of the recording, s."""
    marks: Callable[[Event], bool]
    """Predicate of events that report a disarming."""

    def expected_s(self, recorded_s: float) -> float:
        """Return when the mock is to tell what was recorded then."""
        return recorded_s + next((one.by_s for one in reversed(self.shifts) if recorded_s >= one.from_s), 0.0)

    def disarming_expected_s(self, recorded_s: float) -> float:
        """Return when it is to disarm, by the clock as it ran before."""
        before = [one for one in self.shifts if one.disarmed_s < recorded_s - GRACE_S]
        return recorded_s + (before[-1].by_s if before else 0.0)

    def skips(self, event: Event) -> bool:
        """Return whether the mock had disarmed already, and its battery was being charged."""
        if event.channel != "battery":
            return False
        late_s = tolerance_of(event).late_s
        return any(one.disarmed_s + one.by_s - late_s <= event.at_s < one.disarmed_s for one in self.shifts)

    def is_disarming(self, event: Event) -> bool:
        """Return whether this is the event that the clock was set by."""
        return event.link == ONBOARD and any(event.at_s == one.disarmed_s for one in self.shifts) and self.marks(event)

    def answer_expected_s(self, recorded_s: float) -> float:
        """Return when it is to answer what was asked just before then."""
        before = bisect_right(self.handed, (recorded_s, math.inf))
        asked_s, handed_s = self.handed[before - 1] if before else (0.0, 0.0)
        return recorded_s + handed_s - asked_s


def disarming_mark(session: Session) -> Callable[[Event], bool]:
    """Return what tells of a disarming: its text, or where none is told the end of the failsafe that landed it."""

    def by_text(event: Event) -> bool:
        return event.link == ONBOARD and "Disarmed by" in event.what

    def by_mode(event: Event) -> bool:
        return event.link == ONBOARD and event.what.endswith(FAILSAFE_OVER)

    return by_text if any(map(by_text, session.events)) else by_mode


def play(session: Session, seed: int = 1) -> Played:
    """Let the mock live through a session."""
    player = _Player(session, seed)
    player.run()
    events = sorted((event for link in player.links for event in link.reader.events), key=lambda event: event.at_s)
    return Played(
        events=events,
        shifts=player.shifts,
        handed=sorted(player.handed),
        ends_at_s=session.ends_at_s,
        marks=disarming_mark(session),
    )


class _WireLink(MavlinkLink):
    """A link whose frames are read as a client reads them; what tells no event is not even packed."""

    def __init__(self, world: World, name: str) -> None:
        self.name = name
        self.reader = EventReader(name)
        self._clock = world
        self.heard: list[Event] = []
        super().__init__(LinkConfig.model_validate({}), world, faulty=name == ONBOARD)

    def _boot(self) -> None:
        """Stream only what tells events: the rest is not looked at."""
        super()._boot()
        for stream in DEFAULTS:
            if stream.id not in mavlink.mavlink_map or mavlink.mavlink_map[stream.id].msgname not in READERS:
                self.streams.set_interval(stream.id, -1.0, 0.0)

    def _packed(self, message: Any) -> Any:
        return super()._packed(message) if message.get_type() in READERS else b""

    def _transmit(self, frame: Any) -> None:
        for message in messages_in(frame, self._codec):
            if message.get_srcSystem() == 1:
                self.heard += self.reader.take(self._clock.time_s, message)

    def reboot(self) -> None:
        """Forget the reported states, as a client does that sees PX4 boot."""
        reader, self.reader = self.reader, EventReader(self.name)
        self.reader.events = reader.events


class _Player:
    def __init__(self, session: Session, seed: int) -> None:
        plant = {**SIH_PLANT, "max_thrust_n": WEIGHT_N / session.hover_thrust}
        start_ned_m = (0.0, 0.0, session.sunk_m)
        vehicle = {"start_yaw_rad": session.start_yaw_rad, "start_position_ned_m": start_ned_m}
        config = {"px4": {"params": session.params}, "plant": plant, "vehicle": vehicle}
        self.world = World(MockConfig.from_dict(config), seed, step_s=TICK_S)
        self.links = [_WireLink(self.world, ONBOARD), _WireLink(self.world, GCS)]
        self.shifts: list[Shift] = []
        self.handed: list[tuple[float, float]] = []
        self._given = set[int]()
        """Frames that were handed in, some of them again and again."""
        self._session = session
        self._flyer = Flyer(session.poses, session.hover_thrust)
        self._rng = np.random.default_rng([seed, 7])
        self._senders = {ONBOARD: _sender(COMPANION), GCS: _sender(PILOT)}
        streams: list[Input] = [*session.setpoints, *session.poses, *session.sticks, *session.cuts]
        self._inputs: list[Input] = sorted([*session.frames, *streams], key=lambda one: one.at_s)
        self._next = 0
        self._ticks = 0
        self._shift_s = 0.0
        self._marks = disarming_mark(session)
        self._disarms = [event.at_s for event in session.events if self._marks(event)]
        self._disarmed_s: list[float] = []
        self._repeats = 0
        self._rested: Setpoint | None = None
        self._deaths = list(session.silent_s)

    # -- time ------------------------------------------------------------------------------------

    def run(self) -> None:
        """Tick until the recording ends."""
        while self._now_s - self._shift_s < self._session.ends_at_s + TAIL_S:
            self._ticks += 1
            self._follow_disarming()
            self._die()
            self._hand_in()
            self._advance(self._now_s)
            texts = self.world.vehicle.pop_texts()
            for link in self.links:
                link.tell(texts)
                link.send_due()
            self._note_disarming()

    @property
    def _now_s(self) -> float:
        return self._ticks * TICK_S

    def _advance(self, to_s: float) -> None:
        boots = self.world.boots
        self.world.advance(to_s)
        if self.world.boots != boots:
            for link in self.links:
                link.reboot()

    def _die(self) -> None:
        """Switch PX4 off and on as recorded."""
        if self._deaths and self._now_s - self._shift_s >= self._deaths[0][0]:
            off_s, on_s = self._deaths.pop(0)
            dead = {"part": "autopilot", "kind": "off", "for_s": on_s - off_s}
            self.world.inject(Fault.model_validate(dead))

    # -- the recording's clock -------------------------------------------------------------------

    def _note_disarming(self) -> None:
        onboard = self.links[0]
        self._disarmed_s += [event.at_s for event in onboard.heard if self._marks(event)]
        onboard.heard = []

    def _follow_disarming(self) -> None:
        """PX4 disarms when it believes to have landed: what the others do then waits for that, or comes sooner.

        Until it happens the last second before it is repeated: poses, heartbeats, the question for disarming, and
        the last setpoint: it stands.
        """
        if not self._disarms:
            return
        at_s = self._disarms[0]
        if self._disarmed_s:
            self._jump(at_s, self._disarmed_s.pop(0))
        elif self._now_s - self._shift_s >= at_s + GRACE_S:
            self._wait(at_s)

    def _jump(self, recorded_s: float, happened_s: float) -> None:
        self._shift_s = happened_s - recorded_s
        self.shifts.append(Shift(disarmed_s=recorded_s, by_s=self._shift_s))
        self._disarms.pop(0)
        self._repeats = 0
        while self._next < len(self._inputs) and self._inputs[self._next].at_s < recorded_s:
            one = self._inputs[self._next]
            self._next += 1
            if isinstance(one, SentFrame) and id(one) not in self._given and not _asks_to_disarm(one):
                self._put(one)

    def _wait(self, at_s: float) -> None:
        if self._repeats >= REPEATS:  # it does not disarm: go on as recorded, and let the comparison say so
            self._disarms.pop(0)
            self._repeats = 0
            return
        self._repeats += 1
        before = [one for one in self._inputs[: self._next] if isinstance(one, Setpoint)]
        self._rested = before[-1] if before else None
        self._shift_s += REPEATED_S
        self._next = next(i for i, one in enumerate(self._inputs) if one.at_s >= at_s - REPEATED_S)

    # -- what is handed in -----------------------------------------------------------------------

    def _hand_in(self) -> None:
        """Everything up to now, at its own time; nothing of what follows a disarming that is still to come."""
        until_s = self._now_s - self._shift_s
        if self._disarms:
            until_s = min(until_s, self._disarms[0] - 1e-6)
        while self._next < len(self._inputs) and self._inputs[self._next].at_s <= until_s:
            one = self._inputs[self._next]
            self._next += 1
            self._advance(one.at_s + self._shift_s)
            if self._repeats == 0:
                self._put(one)
            elif not isinstance(one, SentFrame) or _goes_on(one):
                self._put(self._rested if isinstance(one, Setpoint) and self._rested else one)

    def _put(self, one: Input) -> None:
        if isinstance(one, SentFrame):
            if id(one) not in self._given:
                self.handed.append((one.at_s, self.world.time_s))
            self._given.add(id(one))
            self._give(one.link, one.raw)
        elif isinstance(one, Setpoint):
            self._send(ONBOARD, self._flyer.message(one, self.world.truth))
        elif isinstance(one, Pose):
            self._send(ONBOARD, self._pose())
        elif isinstance(one, Sticks):
            self._send(GCS, mavlink.MAVLink_manual_control_message(1, one.x, one.y, one.z, one.r, one.buttons))
        else:
            for _ in range(round(one.for_s / DRAIN_STEP_S)):
                self.world.vehicle.battery.step(self.world.vehicle.armed, DRAIN_STEP_S)
            self.links[0].reader.forget_charge()

    def _pose(self) -> Any:
        """Motion capture sees where the mock's vehicle is, not where the recorded one was."""
        truth = self.world.truth
        x, y, z = (truth.position_ned_m + MOCAP_NOISE_M * self._rng.standard_normal(3)).tolist()
        noise = (MOCAP_NOISE_RAD * self._rng.standard_normal(3)).tolist()
        roll, pitch, yaw = (a + b for a, b in zip(quat.to_euler(truth.q_ned_frd_wxyz), noise, strict=True))
        covariance = [float("nan")] * 21
        return mavlink.MAVLink_vision_position_estimate_message(0, x, y, z, roll, pitch, yaw, covariance)

    def _send(self, link: str, message: Any) -> None:
        self._give(link, bytes(message.pack(self._senders[link])))

    def _give(self, name: str, raw: bytes) -> None:
        link = self.links[0] if name == ONBOARD else self.links[1]
        other = self.links[1] if name == ONBOARD else self.links[0]
        for frame in link.handle(raw):
            other.forward(frame)


def _sender(system: int) -> Any:
    return mavlink.MAVLink(None, srcSystem=system, srcComponent=COMPONENT)


_CODEC = _sender(COMPANION)


def _decoded(frame: SentFrame) -> Any | None:
    return next(iter(messages_in(frame.raw, _CODEC)), None)


def _asks_to_disarm(frame: SentFrame) -> bool:
    m = _decoded(frame)
    if m is None or m.get_type() != "COMMAND_LONG":
        return False
    return bool(m.command == ARM_DISARM and m.param1 == 0.0 and not m.param2 > 0.0)


def _goes_on(frame: SentFrame) -> bool:
    """Sent again and again while the others wait for PX4."""
    m = _decoded(frame)
    return m is not None and (m.get_type() == "HEARTBEAT" or _asks_to_disarm(frame))
