"""Bodies of a virtual world between delayed setpoints and frames: one in plain floats, a batch in arrays."""

from collections import deque
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array, AttitudeThrust
from companion.geometry.frames import flip_quat, flip_yz, quat_multiply
from mock_autopilot.physics import plant, plant_one, quaternion_one
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.arm_bodies import Moving
from mock_autopilot.physics.arms import Coupling
from mock_autopilot.physics.plant import Actuation, PlantParams, PlantState, Wrench
from mock_autopilot.physics.plant_one import OneActuation
from mock_autopilot.physics.quaternion_one import Four
from mock_autopilot.px4.attitude_error import SAMPLE_HZ, turn_of, turns_of

Value = TypeVar("Value")


class DelayLine(Generic[Value]):
    """Delay line of one vehicle, or of a batch with one delay; filled with the first value."""

    def __init__(self, delay_steps: int, first: Value) -> None:
        self._line = deque([first] * delay_steps)

    def put(self, value: Value) -> Value:
        """Enter the present value, a step after the last; return the delayed one."""
        self._line.append(value)
        return self._line.popleft()


class EachDelayLine:
    """Delay line of a batch in which each vehicle has its own delay (...,); filled with the first value."""

    def __init__(self, delay_steps: NDArray[np.int64], first: Array) -> None:
        self._delay = delay_steps
        self._each = np.arange(self._delay.size).reshape(self._delay.shape)
        self._size = int(self._delay.max()) + 1
        self._ring = np.repeat(first[None], self._size, axis=0)
        self._now = 0

    def put(self, value: Array) -> Array:
        """Enter the present value, a step after the last; return the delayed one."""
        self._now = (self._now + 1) % self._size
        self._ring[self._now] = value
        return np.asarray(self._ring[(self._now - self._delay) % self._size, self._each])


@dataclass(frozen=True, kw_only=True)
class Begin:
    """Parameters and initial state of a body; delays are whole steps of `step_s`, () or (...,)."""

    params: PlantParams
    state: PlantState
    signal: Array
    """Motor signal until the first setpoint arrives, (...,)."""
    mocap_delay: NDArray[np.int64]
    attitude_delay: NDArray[np.int64]
    thrust_delay: NDArray[np.int64]
    report_delay: NDArray[np.int64]
    attitude_error_rad: Array | None
    """Believed less true roll and pitch, (samples, ..., 2) at SAMPLE_HZ; None: a perfect horizon."""
    coupling: Coupling | None
    step_s: float


class Body(Protocol):
    """True state of one vehicle or a batch, and its delayed measurements."""

    @property
    def state(self) -> PlantState:
        """True state now."""

    @property
    def moving_ned(self) -> tuple[Any, Any]:
        """True position (m) and velocity (m/s), NED: arrays (..., 3), or three floats each."""

    def hear(self, setpoint: AttitudeThrust) -> None:
        """Use this setpoint from now on, until the next one."""

    def step(self, force_ned_n: Array, moving: Moving | None) -> None:
        """Advance by a step with an external force (..., 3) and the motion of the arms, if there are any."""

    def seen(self, offset_w_m: Array, turn: Array) -> tuple[Array, Array]:
        """Return position (..., 3) and attitude (..., 4) in W as motion capture measures them now, errors included."""

    def reported(self) -> Array:
        """Return the attitude that the autopilot believed and that has arrived now, (..., 4) in W."""


class OneBody:
    """Body of one vehicle, computed in plain floats."""

    def __init__(self, begin: Begin) -> None:
        self._fixed, self._step_s = plant_one.fixed_of(begin.params, begin.step_s), begin.step_s
        self._coupling = begin.coupling
        self._state = self._seen = plant_one.in_floats(begin.state)
        self._sent_q, self._sent_signal = self._state.q_ned_frd_wxyz, float(begin.signal)
        self._frames = DelayLine(int(begin.mocap_delay), self._state)
        self._q = DelayLine(int(begin.attitude_delay), self._sent_q)
        self._signal = DelayLine(int(begin.thrust_delay), self._sent_signal)
        error = begin.attitude_error_rad
        self._errors_rad = None if error is None else error.tolist()
        self._steps, self._turn = 0, self._turn_at(0)
        self._reports = DelayLine(int(begin.report_delay), (self._sent_q, self._turn))
        self._report = self._sent_q, self._turn

    def _turn_at(self, step: int) -> Four:
        if self._errors_rad is None:
            return _NO_TURN
        first, share = _between_samples(step, self._step_s)
        (a, b), (c, d) = self._errors_rad[first], self._errors_rad[first + 1]
        return turn_of(a + share * (c - a), b + share * (d - b))

    @property
    def state(self) -> PlantState:
        """True state now; see Body."""
        return plant_one.in_arrays(self._state)

    @property
    def moving_ned(self) -> tuple[Any, Any]:
        """True position (m) and velocity (m/s), NED; see Body."""
        return self._state.position_ned_m, self._state.velocity_ned_mps

    def hear(self, setpoint: AttitudeThrust) -> None:
        """Use this setpoint from now on; see Body."""
        w, x, y, z = setpoint.q_w_flu_wxyz.tolist()
        self._sent_q, self._sent_signal = (w, x, -y, -z), float(setpoint.thrust)

    def step(self, force_ned_n: Array, moving: Moving | None) -> None:
        """Advance by a step; see Body."""
        before, push = self._state, _NOTHING
        x, y, z = force_ned_n.tolist()
        if self._coupling is not None and moving is not None:
            rate, q = before.rate_frd_radps, before.q_ned_frd_wxyz
            (i, j, k), push = self._coupling.pushed(rate, q, before.thrust_n, before.on_ground, moving, self._step_s)
            x, y, z = x + i, y + j, z + k
        actuation = OneActuation(self._truly(self._q.put(self._sent_q)), self._signal.put(self._sent_signal))
        self._state = plant_one.moved(before, actuation, (x, y, z), push, self._fixed)
        self._seen = self._frames.put(self._state)
        self._steps += 1
        self._turn = self._turn_at(self._steps)
        self._report = self._reports.put((self._state.q_ned_frd_wxyz, self._turn))

    def _truly(self, q: Four) -> Four:
        if self._errors_rad is None:
            return q
        w, x, y, z = self._turn
        return quaternion_one.multiply(q, (w, -x, -y, -z))

    def seen(self, offset_w_m: Array, turn: Array) -> tuple[Array, Array]:
        """Return the pose that motion capture measures now; see Body."""
        (x, y, z), (w, i, j, k) = self._seen.position_ned_m, self._seen.q_ned_frd_wxyz
        a, b, c = offset_w_m.tolist()
        return np.array((x + a, b - y, c - z)), quat_multiply(np.array((w, i, -j, -k)), turn)

    def reported(self) -> Array:
        """Return the attitude that the autopilot reports now; see Body."""
        w, x, y, z = self._report[0] if self._errors_rad is None else quaternion_one.multiply(*self._report)
        return np.array((w, x, -y, -z))


class ManyBodies:
    """Bodies of a batch of vehicles, computed in arrays."""

    def __init__(self, begin: Begin) -> None:
        self._params, self._step_s, self._coupling = begin.params, begin.step_s, begin.coupling
        self._state, self._sent_q, self._sent_signal = begin.state, begin.state.q_ned_frd_wxyz, begin.signal
        self._known_p, self._known_q = self._state.position_ned_m, self._sent_q
        self._seen_p, self._seen_q = (_line(begin.mocap_delay, known) for known in (self._known_p, self._known_q))
        self._q = _line(begin.attitude_delay, self._sent_q)
        self._signal = _line(begin.thrust_delay, self._sent_signal)
        self._errors_rad, self._steps = begin.attitude_error_rad, 0
        self._turn = self._turn_at(0)
        self._report = self._believed()
        self._reports = _line(begin.report_delay, self._report)

    def _turn_at(self, step: int) -> Array | None:
        if self._errors_rad is None:
            return None
        first, share = _between_samples(step, self._step_s)
        before, after = self._errors_rad[first], self._errors_rad[first + 1]
        return turns_of(before + share * (after - before))

    def _believed(self) -> Array:
        q = self._state.q_ned_frd_wxyz
        return q if self._turn is None else quat.multiply(q, self._turn)

    @property
    def state(self) -> PlantState:
        """True state now; see Body."""
        return self._state

    @property
    def moving_ned(self) -> tuple[Any, Any]:
        """True position (m) and velocity (m/s), NED; see Body."""
        return self._state.position_ned_m, self._state.velocity_ned_mps

    def hear(self, setpoint: AttitudeThrust) -> None:
        """Use this setpoint from now on; see Body."""
        self._sent_q, self._sent_signal = flip_quat(setpoint.q_w_flu_wxyz), setpoint.thrust

    def step(self, force_ned_n: Array, moving: Moving | None) -> None:
        """Advance by a step; see Body."""
        actuation = Actuation(self._truly(self._q.put(self._sent_q)), self._signal.put(self._sent_signal))
        self._state = plant.step(self._state, actuation, self._wrench(force_ned_n, moving), self._params, self._step_s)
        self._known_p = self._seen_p.put(self._state.position_ned_m)
        self._known_q = self._seen_q.put(self._state.q_ned_frd_wxyz)
        self._steps += 1
        self._turn = self._turn_at(self._steps)
        self._report = self._reports.put(self._believed())

    def _truly(self, q: Array) -> Array:
        return q if self._turn is None else quat.multiply(q, quat.conjugate(self._turn))

    def _wrench(self, force_ned_n: Array, moving: Moving | None) -> Wrench:
        if self._coupling is None or moving is None:
            return Wrench(force_ned_n, np.zeros_like(force_ned_n))
        pushed = self._coupling.step(self._state, moving, self._step_s)
        return Wrench(force_ned_n + pushed.force_ned_n, pushed.angular_frd_radps2)

    def seen(self, offset_w_m: Array, turn: Array) -> tuple[Array, Array]:
        """Return the pose that motion capture measures now; see Body."""
        return flip_yz(self._known_p) + offset_w_m, quat_multiply(flip_quat(self._known_q), turn)

    def reported(self) -> Array:
        """Return the attitude that the autopilot reports now; see Body."""
        return flip_quat(self._report)


def _between_samples(step: int, step_s: float) -> tuple[int, float]:
    """Return the sample before a step, and the step's share of the way to the next one."""
    at = step * step_s * SAMPLE_HZ
    return int(at), at - int(at)


def _line(delay_steps: NDArray[np.int64], first: Array) -> "DelayLine[Array] | EachDelayLine":
    return EachDelayLine(delay_steps, first) if delay_steps.ndim else DelayLine(int(delay_steps), first)


_NOTHING = (0.0, 0.0, 0.0)
_NO_TURN = (1.0, 0.0, 0.0, 0.0)
