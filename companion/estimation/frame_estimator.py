"""Estimator of a flight: usual frames in compiled code where there is any, every other one in Python. Same numbers."""

from dataclasses import replace
from math import inf
from struct import Struct

import numpy as np

from companion.compiled.leaves import flat
from companion.compiled.library import pointers, quick_library
from companion.core.types import MocapFrame, VehicleState
from companion.estimation import estimator
from companion.estimation.attitude import Attitude
from companion.estimation.clock_sync import ClockSync
from companion.estimation.estimator import EstimatorParams, EstimatorState, Verdict
from companion.estimation.kalman import Covariance, Motion
from companion.estimation.others import OtherTrack
from companion.estimation.usual_frame import NOT_FOLLOWED, followed

_FRAME = Struct("14d")


class FrameEstimator:
    """Keeper of the estimate from motion capture's frames."""

    def __init__(self, params: EstimatorParams) -> None:
        self._params, self._code = params, quick_library()
        self._state, self._usual = EstimatorState(), 0
        self._vehicle: VehicleState | None = None
        self._loaded: EstimatorState | None = None
        """The estimate that the compiled code has."""
        sizes = (49, 14, 14)  # of usual_frame.Followed and Measured, and of a VehicleState
        self._memory, self._frame, self._out = (np.empty(size) for size in sizes)
        self._numbers = flat(params, params)[0]
        self._pointers = pointers((self._memory, self._frame, self._numbers, self._out))

    @property
    def vehicle(self) -> VehicleState | None:
        """State at the capture of the last accepted frame; None before the first one."""
        return self._vehicle

    @property
    def verdict(self) -> Verdict | None:
        """Verdict on the last frame."""
        return Verdict.ACCEPTED if self._usual else self._state.verdict

    @property
    def others(self) -> tuple[OtherTrack, ...]:
        """The other vehicles of [separation]."""
        return () if self._usual else self._state.others

    @property
    def others_s(self) -> float:
        """Stamp of the last frame that the others were taken from."""
        return -inf if self._usual else self._state.others_s

    @property
    def state(self) -> EstimatorState:
        """Return all that the estimator knows, which is put together when it is asked for."""
        if self._usual:
            self._state, self._usual = self._after_usual(), 0
            self._loaded = self._state
        return self._state

    def step(self, frame: MocapFrame) -> None:
        """Take one frame."""
        if not frame.others and self._load() and self._take(frame):
            return
        self._state = estimator.step(self.state, frame, self._params)
        self._vehicle = self._state.vehicle

    def _load(self) -> bool:
        """Give the compiled code the estimate, where it has none of it; return False where it can not take it."""
        if self._code is None:
            return False
        if self._loaded is not self._state:
            memory = followed(self._state)
            if memory is None:
                return False
            self._memory[:], self._loaded = flat(memory, NOT_FOLLOWED)[0], self._state
        return True

    def _take(self, frame: MocapFrame) -> bool:
        """Take a usual frame; return False, and do nothing, for another one."""
        assert self._code is not None
        pose = (*frame.position_w_m.tolist(), *frame.rotation_w_b.ravel().tolist())
        _FRAME.pack_into(self._frame.data, 0, *pose, frame.stamp_s, frame.received_s)
        if not self._code.take_frame(self._pointers):
            return False
        state, self._usual = self._out.copy(), self._usual + 1
        self._vehicle = VehicleState(state.item(0), state[1:4], state[4:7], state[7:11], state[11:14])
        return True

    def _after_usual(self) -> EstimatorState:
        before, m = self._state, self._memory.tolist()
        counts, run = before.counts, self._usual
        counts = replace(counts, accepted=counts.accepted + run)
        p, v, a = ((*m[i : i + 3],) for i in (0, 3, 6))
        q, rate, turn = (m[15], m[16], m[17], m[18]), (m[19], m[20], m[21]), (m[22], m[23], m[24])
        return EstimatorState(
            vehicle=self._vehicle,
            verdict=Verdict.ACCEPTED,
            run=before.run + run if before.verdict is Verdict.ACCEPTED else run,
            counts=counts,
            clock=ClockSync(*m[31:35]),
            motion=Motion(p, v, a, Covariance(*m[9:15])),
            attitude=Attitude(q, rate, turn, Covariance(*m[25:31])),
            stamp_s=m[35],
            received_s=m[36],
            pose=(*m[37:],),
        )
