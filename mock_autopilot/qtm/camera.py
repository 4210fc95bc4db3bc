"""The simulated cameras: times of capture, measurement errors, and delays until frames leave the server.

Pure: all times are the truth's. Room frame: right-handed, z up, x north, so (x, -y, -z) of NED; body FLU likewise.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.physics.truth import Truth
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.packets import BodyPose, Frame

FLIP_YZ = np.array([1.0, -1.0, -1.0])
"""NED to room, and FRD to FLU: half a turn about x."""
LOST = BodyPose(np.full(3, np.nan), np.full((3, 3), np.nan), float("nan"))
_TICK_S = 1e-6
"""Stamps count microseconds: a truth this close before a capture counts as reaching it."""


@dataclass
class Camera:
    """The cameras; takes the truths in order, returns the frames that are due. Same seed, same frames."""

    config: QualisysConfig
    seed: int
    _rng: np.random.Generator = field(init=False)
    _others_rng: list[np.random.Generator] = field(default_factory=list, init=False)
    _next: int | None = field(default=None, init=False)
    _on_the_way: deque[tuple[float, Frame]] = field(default_factory=deque, init=False)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)

    def look(self, truth: Truth, others: Sequence[Truth] = ()) -> list[Frame]:
        """Capture what became due up to this truth; return the frames that leave the server by now.

        `others` are the truths of more vehicles, in the order of the bodies behind the first.
        """
        if self._next is None:
            self._next = int(np.ceil((truth.time_s - _TICK_S) * self.config.rate_hz))
        while self._next / self.config.rate_hz <= truth.time_s + _TICK_S:
            at_s = self._next / self.config.rate_hz
            self._capture(self._next, _moved_to(truth, at_s), [_moved_to(other, at_s) for other in others])
            self._next += 1
        due = []  # in the order of capture: a late frame holds up those behind it
        while self._on_the_way and self._on_the_way[0][0] <= truth.time_s + _TICK_S:
            due.append(self._on_the_way.popleft()[1])
        return due

    def _capture(self, number: int, truth: Truth, others: list[Truth]) -> None:
        """Draw the same random numbers for every frame, so that one fault does not change the noise after it."""
        position_noise, angle_noise = self._rng.normal(size=3), self._rng.normal(size=3)
        jitter, drop = self._rng.random(2)
        cfg = self.config
        if drop < cfg.drop_probability or any(silence.contains(truth.time_s) for silence in cfg.silences):
            return
        pose = _seen(truth, cfg.noise_m * position_noise, cfg.noise_rad * angle_noise, cfg.residual_m)
        if any(outage.contains(truth.time_s) for outage in cfg.outages):
            pose = LOST
        leaves_s = truth.time_s + cfg.delay_s + cfg.jitter_s * jitter
        standing = range(len(cfg.extra_bodies) - len(others))
        bodies = (pose, *self._see(others), *(_standing(place, cfg.residual_m) for place in standing))
        self._on_the_way.append((leaves_s, Frame(number, round(truth.time_s * 1e6), bodies)))

    def _see(self, others: list[Truth]) -> list[BodyPose]:
        """Return the poses of more vehicles; each has noise of its own, which changes nobody else's."""
        cfg = self.config
        while len(self._others_rng) < len(others):
            self._others_rng.append(np.random.default_rng([self.seed, len(self._others_rng) + 2]))
        poses = []
        for truth, rng in zip(others, self._others_rng, strict=False):
            offset, turn = rng.normal(size=3), rng.normal(size=3)
            poses.append(_seen(truth, cfg.noise_m * offset, cfg.noise_rad * turn, cfg.residual_m))
        return poses


def _moved_to(truth: Truth, time_s: float) -> Truth:
    """Return the truth at the capture, extrapolated back by less than one step along velocity and body rate."""
    back_s = time_s - truth.time_s
    if abs(back_s) <= _TICK_S:
        return truth._replace(time_s=time_s)
    turn = quat.from_rotation_vector(truth.rate_frd_radps * back_s)
    return truth._replace(
        time_s=time_s,
        position_ned_m=truth.position_ned_m + truth.velocity_ned_mps * back_s,
        q_ned_frd_wxyz=quat.multiply(truth.q_ned_frd_wxyz, turn),
    )


def _seen(truth: Truth, offset_m: Array, turn_rad: Array, residual_m: float) -> BodyPose:
    rotation_ned_frd = quat.to_matrix(quat.multiply(truth.q_ned_frd_wxyz, quat.from_rotation_vector(turn_rad)))
    rotation_room_flu = FLIP_YZ[:, None] * rotation_ned_frd * FLIP_YZ
    return BodyPose(truth.position_ned_m * FLIP_YZ + offset_m, rotation_room_flu, residual_m)


def _standing(place: int, residual_m: float) -> BodyPose:
    """Return the pose of a body on the floor, level, half a metre from the next."""
    return BodyPose(np.array([1.0 + 0.5 * place, 2.0, 0.0]), np.eye(3), residual_m)
