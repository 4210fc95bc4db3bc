"""Where the vehicle will be when a command sent now begins to act (a departure from the paper, off by default).

The state is as old as the mocap frame, a command acts only after the setpoint's delay, and the attitude follows with
its lag. The commands already sent are known, and so is the attitude now: so the near future is, too. Position and
velocity are carried forward through a second-order model of the attitude loop (horizontal) and a first-order one of
the rotors (vertical). The model is linear, so the whole replay is one weighted sum of the commands sent.

What the rotors do not explain of the motion so far, an observer takes for a push that goes on: without it the
prediction is wrong by half the push times the horizon squared, and the law holds that for an error of the vehicle.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from companion.control.components import all_by_axis, joined, maths, parts
from companion.control.controller import ControlInput, VehicleModel
from companion.control.frames import up_axis_parts
from companion.control.push_observer import Observed, nothing_observed, observe
from companion.control.switching import Scalar
from companion.control.values import value
from companion.types import Array


@value
class PredictorMemory:
    """Accelerations asked for lately (m/s^2), newest last, (..., n, 3); modelled specific thrust (m/s^2), (..., 1)."""

    sent: Array
    thrust_mps2: Array
    observed: Observed


@value
class Prediction:
    """Position (m) and velocity (m/s) then, and the push (m/s^2) that is taken to go on; (..., 3) in W."""

    position_w_m: Array
    velocity_w_mps: Array
    push_w_mps2: Array


@dataclass(frozen=True)
class Predictor:
    """Carries a state forward by age + setpoint delay + `lead_s`.

    The newest command is taken to go on, after it begins to act, for `lead_s` (horizontal) and `thrust_lead_s`
    (vertical): longer for the slow attitude, shorter for the quick rotors, whose next command corrects it sooner.
    Both are floats, or arrays (..., 1) when a batch of vehicles has a batch of them.
    """

    vehicle: VehicleModel
    period_s: float
    lead_s: Scalar
    thrust_lead_s: Scalar
    observer_radps: Scalar = 0.0
    """Poles of the push's observer; 0 takes the push for 0."""

    def __post_init__(self) -> None:
        """Work out the weights now, not in the first cycle in the air."""
        _ = self._weights

    @property
    def preview_s(self) -> Scalar:
        """From now to the instant predicted for."""
        return self.vehicle.setpoint_delay_s + self.lead_s

    def initial(self, first: ControlInput) -> PredictorMemory:
        """As if the last command had been held for long."""
        sent = np.repeat(first.sent_accel_w_mps2[..., None, :], self._weights.commands.shape[-3], axis=-2)
        thrust = first.sent_accel_w_mps2[..., 2:3] + self.vehicle.gravity_mps2
        return PredictorMemory(sent, thrust, nothing_observed(first.velocity_w_mps, first.age_s))

    def step(self, memory: PredictorMemory, now: ControlInput) -> tuple[Prediction, PredictorMemory]:
        """The state then, and the memory with the newest command."""
        sent = np.concatenate((memory.sent[..., 1:, :], now.sent_accel_w_mps2[..., None, :]), axis=-2)
        thrust = self._thrust(memory.thrust_mps2, sent)
        x, y, z = up_axis_parts(now.q_w_flu_wxyz)
        (push_up,) = parts(thrust)
        accel = joined(push_up * x, push_up * y, push_up * z - self.vehicle.gravity_mps2)
        observed = observe(memory.observed, now.velocity_w_mps, accel, now.age_s, now.dt_s, self.observer_radps)
        return self._propagate(now, sent, thrust, accel, observed.push), PredictorMemory(sent, thrust, observed)

    def _thrust(self, thrust_mps2: Array, sent: Array) -> Array:
        """Specific thrust at capture time: the oldest kept command is the one that acted then."""
        (x, y, z), (before,) = parts(sent[..., 0, :]), parts(thrust_mps2)
        up = z + self.vehicle.gravity_mps2
        size = maths(x).sqrt(x * x + y * y + up * up)
        return joined(before + (size - before) * self._thrust_share)

    def _propagate(self, now: ControlInput, sent: Array, thrust: Array, accel: Array, push: Array) -> Prediction:
        w = self._weights
        up_rate = _up_axis_rate(now.q_w_flu_wxyz, now.rate_flu_radps)
        late = now.age_s - self.vehicle.mocap_age_s  # the part of the age the weights do not know
        ahead = w.horizon_s + late
        forced = np.einsum("...ni,...nki->...ki", sent, w.commands)
        specific_thrust = thrust if thrust.ndim > 1 else thrust.item()

        def at_horizon(
            p: Any, v: Any, a: Any, up_rate: Any, push: Any, forced_p: Any, forced_v: Any, *weights: Any
        ) -> Any:
            a_p, a_v, j_p, j_v = weights
            j = specific_thrust * up_rate
            position = p + ahead * v + a_p * a + j_p * j + forced_p + (0.5 * ahead * ahead) * push
            return position, v + a_v * a + j_v * j + forced_v + ahead * push

        known = now.position_w_m, now.velocity_w_mps, accel, up_rate, push, forced[..., 0, :], forced[..., 1, :]
        position, velocity = all_by_axis(at_horizon, *known, *w.accel, *w.jerk)
        return Prediction(position, velocity, push)

    @cached_property
    def _thrust_share(self) -> float:
        """How much of a change of thrust happens in one period."""
        return -math.expm1(-self.period_s / self.vehicle.thrust_lag_s)

    @cached_property
    def _weights(self) -> "_Weights":
        leads = np.broadcast_arrays(self.lead_s, self.thrust_lead_s)
        if not leads[0].shape:
            return _weights(self.vehicle, self.period_s, float(leads[0]), float(leads[1]))
        pairs = zip(*(lead[..., 0].ravel().tolist() for lead in leads), strict=True)
        return _stacked([_weights(self.vehicle, self.period_s, *pair) for pair in pairs], leads[0].shape[:-1])


@dataclass(frozen=True)
class _Weights:
    """Response of (position, velocity) at the horizon, per axis: accel, jerk (2, ..., 3); commands (..., n, 2, 3)."""

    horizon_s: Scalar
    accel: Array
    jerk: Array
    commands: Array


def _stacked(weights: list[_Weights], lead: tuple[int, ...]) -> _Weights:
    """One set for each vehicle of a batch of shape `lead`."""
    one = weights[0]
    return _Weights(
        np.array([w.horizon_s for w in weights]).reshape(*lead, 1),
        np.stack([w.accel for w in weights], axis=1).reshape(2, *lead, 3),
        np.stack([w.jerk for w in weights], axis=1).reshape(2, *lead, 3),
        np.stack([w.commands for w in weights]).reshape(*lead, *one.commands.shape),
    )


def _up_axis_rate(q: Array, rate_flu_radps: Array) -> Array:
    """Rate of change of the body z axis in W (1/s): R (omega x e3), shape (..., 3)."""
    (w, x, y, z), (roll, pitch, _) = parts(q), parts(rate_flu_radps)
    return joined(
        pitch * (1 - 2 * (y * y + z * z)) - roll * (2 * (x * y - w * z)),
        pitch * (2 * (x * y + w * z)) - roll * (1 - 2 * (x * x + z * z)),
        pitch * (2 * (x * z - w * y)) - roll * (2 * (y * z + w * x)),
    )


@lru_cache(maxsize=1024)
def _weights(vehicle: VehicleModel, period_s: float, lead_s: float, thrust_lead_s: float) -> _Weights:
    horizon = vehicle.mocap_age_s + vehicle.setpoint_delay_s + lead_s
    lag = _second_order(vehicle.attitude_bandwidth_radps, vehicle.attitude_damping)
    systems = (lag, lag, _first_order(vehicle.thrust_lag_s))
    end = [_exponential(system * horizon) for system in systems]
    accel = np.array([[m[row, 2] for m in end] for row in (0, 1)])
    jerk = np.array([[m[row, 3] for m in end] for row in (0, 1)])
    count = int(np.ceil((vehicle.mocap_age_s + vehicle.setpoint_delay_s) / period_s - 1e-9)) + 1
    across = _command_spans(vehicle.mocap_age_s + vehicle.setpoint_delay_s, lead_s, period_s, count)
    upward = _command_spans(vehicle.mocap_age_s + vehicle.thrust_delay_s, thrust_lead_s, period_s, count)
    commands = np.array(
        [
            [
                [_span(system, horizon, row, *span) for system, span in zip(systems, (ab, ab, up), strict=True)]
                for row in (0, 1)
            ]
            for ab, up in zip(across, upward, strict=True)
        ]
    )
    return _Weights(horizon, accel, jerk, commands)


def _command_spans(known_s: float, lead_s: float, period_s: float, count: int) -> list[tuple[float, float]]:
    """When, counted from the capture, each of `count` commands acts; oldest first.

    A command sent k cycles ago begins to act k periods before `known_s`, age and delay together; the newest one goes on
    for `lead_s` after that.
    """
    starts = [known_s - k * period_s for k in range(count, 0, -1)]
    return [(max(0.0, a), max(0.0, b)) for a, b in zip(starts, [*starts[1:], known_s + lead_s], strict=True)]


def _span(system: Array, horizon_s: float, row: int, start_s: float, end_s: float) -> float:
    """Response at the horizon to a unit command from `start_s` to `end_s`; what comes after the horizon has none."""
    begun = _exponential(system * max(0.0, horizon_s - start_s))[row, 4]
    ended = _exponential(system * max(0.0, horizon_s - end_s))[row, 4]
    return float(begun - ended)


def _second_order(bandwidth_radps: float, damping: float) -> Array:
    """d/dt (p, v, a, j, u) with a following u by a second-order lag; u constant."""
    m = np.zeros((5, 5))
    m[0, 1] = m[1, 2] = m[2, 3] = 1.0
    m[3, 2:5] = -(bandwidth_radps**2), -2.0 * damping * bandwidth_radps, bandwidth_radps**2
    return m


def _first_order(lag_s: float) -> Array:
    """d/dt (p, v, a, -, u) with a following u by a first-order lag; u constant."""
    m = np.zeros((5, 5))
    m[0, 1] = m[1, 2] = 1.0
    m[2, 2], m[2, 4] = -1.0 / lag_s, 1.0 / lag_s
    return m


def _exponential(m: Array) -> Array:
    """Matrix exponential by scaling and squaring with 12 Taylor terms; exact to rounding for the sizes here."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(m).sum(axis=1).max(), 1e-9)))) + 3)
    x = m / 2.0**halvings
    result, term = np.eye(len(m)), np.eye(len(m))
    for n in range(1, 13):
        term = term @ x / n
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return np.asarray(result)
