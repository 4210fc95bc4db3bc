"""Faults of motion capture, applied to its frames; pure, for the server and for flights in simulated time."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from mock_autopilot.faults.catalogue import Kind, Part
from mock_autopilot.faults.fault import Fault
from mock_autopilot.faults.schedule import ActiveFault, FaultSchedule
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.qtm.packets import HEADER, Body, BodyPose, Frame

CORNER_M = np.array([3.0, 3.0, 0.0])
"""Position of the other body of a swap, in the room's frame."""
_NOISE_M = 0.0003
_FAR_M = 10.0
_FLIP_YZ, _FLIP_Y = np.diag([1.0, -1.0, -1.0]), np.diag([1.0, -1.0, 1.0])
_SWAP_XY = np.eye(3)[[1, 0, 2]]
_SLACK_S = 1e-6


class FrameFaults(Protocol):
    """The faults between cameras and clients."""

    def pass_on(self, frames: list[Frame], now_s: float) -> list[Frame]:
        """Return the frames that leave at `now_s`."""

    @property
    def breaks_packets(self) -> bool:
        """Return whether packets that leave now have broken contents."""

    def packet(self, packet: bytes) -> bytes:
        """Return a data packet as it leaves."""

    def when_bodies_change(self, tell: Callable[[], None]) -> None:
        """Have `tell` called whenever QTM's list of rigid bodies has been changed."""

    def listed(self, bodies: tuple[Body, ...]) -> tuple[Body, ...]:
        """Return QTM's list of rigid bodies, changed as the active faults say."""


class MocapFaults:
    """The faults of motion capture; takes the server's frames in order, returns those that leave.

    `place` is our body's in the frames. A vehicle of a fleet is stuck alone, a single one with all other bodies.
    """

    def __init__(
        self, schedule: FaultSchedule, rng: np.random.Generator, rate_hz: float, place: int = 0, alone: bool = False
    ) -> None:
        self._schedule, self._rng, self._rate_hz = schedule, rng, rate_hz
        self._place, self._alone = place, alone
        self._queue: list[tuple[float, float, Frame]] = []
        self._stuck: tuple[BodyPose, ...] | None = None
        self._frozen: BodyPose | None = None

    def pass_on(self, frames: list[Frame], now_s: float) -> list[Frame]:
        """Return the frames that leave at `now_s` (s, simulated) when the cameras would send `frames`.

        Call it often, also without frames: delayed ones leave later.
        """
        held = self._schedule.active(Part.MOCAP)
        if not held:
            self._stuck = self._frozen = None
            if not self._queue:
                return frames
        for frame in frames:
            self._take(frame, held, now_s)
        delay_s = sum(one.fault.magnitude for one in held if one.fault.kind is Kind.DELAYED)
        due = [entry for entry in self._queue if entry[0] + entry[1] + delay_s <= now_s + _SLACK_S]
        self._queue = [entry for entry in self._queue if entry[0] + entry[1] + delay_s > now_s + _SLACK_S]
        due.sort(key=lambda entry: entry[0] + entry[1])  # stable: equal ones in the order of capture
        return [frame for _, _, frame in due]

    @property
    def breaks_packets(self) -> bool:
        """Return whether packets that leave now have broken contents."""
        return any((h.fault.kind, h.fault.how) == (Kind.GARBAGE, "packets") for h in self._schedule.active(Part.MOCAP))

    def packet(self, packet: bytes) -> bytes:
        """Return a data packet as it leaves: unchanged, or with a right header and broken contents."""
        return broken(packet, self._rng) if self.breaks_packets else packet

    def _take(self, frame: Frame, held: tuple[ActiveFault, ...], now_s: float) -> None:
        late_s = 0.0
        for one in held:
            if self._lost(frame, one):
                return
            if one.fault.how == "out of order" and frame.number % 2:
                late_s += 2.0 / self._rate_hz
            frame = self._changed(frame, one, now_s)
        self._queue.append((now_s, late_s, replace(frame, bodies=self._in_the_list(frame.bodies, held))))

    def _lost(self, frame: Frame, held: ActiveFault) -> bool:
        kind, magnitude = held.fault.kind, held.fault.magnitude
        if kind is Kind.SLOW:
            share = min(magnitude / self._rate_hz, 1.0)
            return int(frame.number * share + 1e-9) == int((frame.number - 1) * share + 1e-9)
        return kind is Kind.OFF or (kind is Kind.INTERMITTENT and float(self._rng.random()) < magnitude)

    def _changed(self, frame: Frame, held: ActiveFault, now_s: float) -> Frame:
        fault, place = held.fault, self._place
        if place >= len(frame.bodies):
            return frame  # a fault of another vehicle has deleted it
        ours = frame.bodies[place]
        if fault.kind is Kind.STUCK:
            self._stuck = self._stuck or frame.bodies
            if not self._alone:
                return replace(frame, bodies=self._stuck)
            ours = self._stuck[place]
        if fault.how == "clock jump":
            return replace(frame, stamp_us=frame.stamp_us + round(fault.magnitude * 1e6))
        if fault.kind is Kind.GARBAGE and not fault.how:
            ours = BodyPose(
                self._rng.uniform(-_FAR_M, _FAR_M, 3), self._rng.uniform(-1.0, 1.0, (3, 3)), ours.residual_m
            )
        elif fault.how in {"swapped", "swapped and frozen"}:
            ours = self._other_body(ours, frozen=fault.how != "swapped")
        elif fault.kind is Kind.WRONG and fault.how in _POSES:
            ours = _POSES[fault.how](ours, fault.magnitude, now_s - held.since_s)
        return replace(frame, bodies=(*frame.bodies[:place], ours, *frame.bodies[place + 1 :]))

    def when_bodies_change(self, tell: Callable[[], None]) -> None:
        """Have `tell` called whenever QTM's list of rigid bodies has been changed."""
        self._schedule.observers.append(lambda turn: tell() if is_of_the_list(turn.fault) else None)

    def listed(self, bodies: tuple[Body, ...]) -> tuple[Body, ...]:
        """Return QTM's list of rigid bodies, changed as the active faults say; our body is in its place."""
        for held in self._schedule.active(Part.MOCAP):
            if is_of_the_list(held.fault):
                before, rest = bodies[: self._place], bodies[self._place :]
                bodies = _IN_SETTINGS[held.fault.how](before, rest)
        return bodies

    def _in_the_list(self, poses: tuple[BodyPose, ...], held: tuple[ActiveFault, ...]) -> tuple[BodyPose, ...]:
        """Return the bodies of a frame in the order of the present list; our body is in its place."""
        for one in held:
            if is_of_the_list(one.fault):
                before, rest = poses[: self._place], poses[self._place :]
                poses = _IN_FRAMES[one.fault.how](before, rest, self._box(poses))
        return poses

    def _box(self, poses: tuple[BodyPose, ...]) -> BodyPose:
        residual_m = poses[0].residual_m if poses else 0.0
        return BodyPose(CORNER_M + self._rng.normal(0.0, _NOISE_M, 3), np.eye(3), residual_m)

    def _other_body(self, ours: BodyPose, frozen: bool) -> BodyPose:
        if frozen and self._frozen is not None:
            return self._frozen
        self._frozen = self._box((ours,))
        return self._frozen


def _moved(pose: BodyPose, along_x_m: float) -> BodyPose:
    return replace(pose, position_room_m=pose.position_room_m + np.array([along_x_m, 0.0, 0.0]))


def _defined(pose: BodyPose, turn: Array) -> BodyPose:
    """Return a pose with its body axes turned by `turn`, (3, 3)."""
    return replace(pose, rotation_room_flu=pose.rotation_room_flu @ turn)


def _reflected(pose: BodyPose, axes: Array) -> BodyPose:
    """Return a pose in reflected room and body axes: its matrix is still a rotation."""
    return replace(
        pose, position_room_m=axes @ pose.position_room_m, rotation_room_flu=axes @ pose.rotation_room_flu @ axes
    )


def _about_z(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


_LOST = BodyPose(np.full(3, np.nan), np.full((3, 3), np.nan), float("nan"))
_POSES: dict[str, Callable[[BodyPose, float, float], BodyPose]] = {
    "jump": lambda pose, magnitude, _: _moved(pose, magnitude),
    "drift": lambda pose, magnitude, for_s: _moved(pose, magnitude * for_s),
    "upside down": lambda pose, _, __: _defined(pose, _FLIP_YZ),
    "mirrored": lambda pose, _, __: _reflected(pose, _FLIP_Y),
    "axes swapped": lambda pose, _, __: _reflected(pose, _SWAP_XY),
    "turned": lambda pose, magnitude, _: _defined(pose, _about_z(magnitude)),
    "tilted": lambda pose, magnitude, _: _defined(pose, _about_x(magnitude)),
    "lost": lambda _, __, ___: _LOST,
}

_BOX = Body("box")
_IN_SETTINGS: dict[str, Callable[[tuple[Body, ...], tuple[Body, ...]], tuple[Body, ...]]] = {
    "body added": lambda before, rest: (*before, _BOX, *rest),
    "body replaced": lambda before, rest: (*before, _BOX, *rest[1:]),
    "body deleted": lambda before, rest: (*before, *rest[1:]),
    "body renamed": lambda before, rest: (*before, _BOX, *rest[1:]),
    "body disabled": lambda before, rest: (*before, *(replace(ours, enabled=False) for ours in rest[:1]), *rest[1:]),
    "bodies reversed": lambda before, rest: (*rest[::-1], *before[::-1]),
    "no bodies": lambda before, rest: (*before, *rest),
}
"""The list after the fault: bodies before ours, then ours and the rest, as they were."""
_IN_FRAMES: dict[str, Callable[[tuple[BodyPose, ...], tuple[BodyPose, ...], BodyPose], tuple[BodyPose, ...]]] = {
    "body added": lambda before, rest, box: (*before, box, *rest),
    "body replaced": lambda before, rest, box: (*before, box, *rest[1:]),
    "body deleted": lambda before, rest, _: (*before, *rest[1:]),
    "body renamed": lambda before, rest, _: (*before, *rest),
    "body disabled": lambda before, rest, _: (*before, *(_LOST for _ in rest[:1]), *rest[1:]),
    "bodies reversed": lambda before, rest, _: (*rest[::-1], *before[::-1]),
    "no bodies": lambda *_: (),
}


class FleetMocapFaults:
    """The faults of all vehicles' motion capture, one after the other, the last vehicle's first.

    So a fault that adds or removes a body of the list moves only bodies whose own faults have had their turn.
    """

    def __init__(self, each: Sequence[MocapFaults]) -> None:
        self._each = list(reversed(each))

    def pass_on(self, frames: list[Frame], now_s: float) -> list[Frame]:
        """Return the frames that leave at `now_s`."""
        for one in self._each:
            frames = one.pass_on(frames, now_s)
        return frames

    @property
    def breaks_packets(self) -> bool:
        """Return whether packets that leave now have broken contents."""
        return any(one.breaks_packets for one in self._each)

    def packet(self, packet: bytes) -> bytes:
        """Return a data packet as it leaves: unchanged, or with a right header and broken contents."""
        breaking = [one for one in self._each if one.breaks_packets]
        return breaking[0].packet(packet) if breaking else packet

    def when_bodies_change(self, tell: Callable[[], None]) -> None:
        """Have `tell` called whenever QTM's list of rigid bodies has been changed."""
        for one in self._each:
            one.when_bodies_change(tell)

    def listed(self, bodies: tuple[Body, ...]) -> tuple[Body, ...]:
        """Return QTM's list of rigid bodies, changed as the active faults of all vehicles say."""
        for one in self._each:
            bodies = one.listed(bodies)
        return bodies


def is_of_the_list(fault: Fault) -> bool:
    """Return whether a fault is one of QTM's list of rigid bodies, and not of a pose."""
    return fault.part is Part.MOCAP and fault.how in _IN_SETTINGS


def broken(packet: bytes, rng: np.random.Generator) -> bytes:
    """Return a packet whose header is right and whose contents are cut off, random, or wrong in a few bytes."""
    _, kind = HEADER.unpack_from(packet)
    contents = bytearray(packet[HEADER.size :])
    what = int(rng.integers(3))
    if what == 0:
        contents = contents[: int(rng.integers(len(contents)))]
    elif what == 1:
        contents = bytearray(rng.bytes(len(contents)))
    else:
        for place in rng.integers(len(contents), size=4).tolist():
            contents[place] ^= int(rng.integers(1, 256))
    return HEADER.pack(HEADER.size + len(contents), kind) + bytes(contents)
