"""Prediction of the state at which a command sent now begins to act (a departure from the paper, off by default).

The state is as old as the mocap frame, a command acts only after the setpoint's delay, and the attitude follows with
its lag. The commands already sent and the present attitude are known, and with them the near future. Position and
velocity are carried forward through a second-order model of the attitude loop (horizontal) and a first-order one of
the rotors (vertical). The model is linear, so the prediction is one weighted sum of the commands sent.

An observer attributes motion that the rotors do not explain to a constant disturbance. Without it the prediction would
be wrong by half the disturbance times the horizon squared, which the law would take for an error of the vehicle.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from companion.control.controller import ControlInput, VehicleModel
from companion.control.disturbance_observer import DisturbanceEstimate, Poles, nothing_observed, observe
from companion.control.lag_models import exponential, first_order, second_order
from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import dots, math_module, stack, unstack
from companion.geometry.frames import up_axis_parts


@value
class PredictorMemory:
    """Memory of the predictor: `drives` (..., 3, n + 2) in W, and the modelled specific thrust (..., 1)."""

    drives: Array
    """Accelerations commanded lately (m/s^2), oldest first, then acceleration and jerk (m/s^3) at the last capture."""
    thrust_mps2: Array
    observed: DisturbanceEstimate


@value
class Prediction:
    """Predicted position (m), velocity (m/s) and disturbance (m/s^2); (..., 3) in W."""

    position_w_m: Array
    velocity_w_mps: Array
    disturbance_w_mps2: Array


@dataclass(frozen=True)
class Predictor:
    """Predictor of a state by age + setpoint delay + `lead_s`.

    The newest command is assumed to continue, after it begins to act, for `lead_s` (horizontal) and `thrust_lead_s`
    (vertical): longer for the slow attitude, shorter for the quick rotors, whose next command corrects it sooner.
    Both are floats, or arrays (..., 1) when a batch of vehicles has a batch of them.
    """

    vehicle: VehicleModel
    period_s: float
    lead_s: Scalar
    thrust_lead_s: Scalar
    observer_radps: Scalar = 0.0
    """Poles of the disturbance observer, rad/s; 0 assumes no disturbance."""
    observer_trend: Scalar = 0.0
    """Third pole of the observer, as a share of the others; 0 takes the disturbance as constant."""

    def __post_init__(self) -> None:
        """Compute the weights now, not in the first cycle in the air."""
        _ = self.weights

    @property
    def preview_s(self) -> Scalar:
        """Time from now to the predicted instant, s."""
        return self.vehicle.setpoint_delay_s + self.lead_s

    def initial(self, first: ControlInput) -> PredictorMemory:
        """Return the memory at lift-off, as if the last command had been held for a long time."""
        drives = np.repeat(first.sent_accel_w_mps2[..., None], self.weights.drives.shape[-1], axis=-1)
        thrust = first.sent_accel_w_mps2[..., 2:3] + self.vehicle.gravity_mps2
        return PredictorMemory(drives, thrust, nothing_observed(first.velocity_w_mps, first.age_s))

    def with_disturbance(self, memory: PredictorMemory, disturbance_w_mps2: Array) -> PredictorMemory:
        """Return the memory with a known disturbance (m/s^2), (..., 3) in W; unchanged without an observer."""
        if not np.any(self.observer_radps):
            return memory
        return replace(memory, observed=replace(memory.observed, disturbance=disturbance_w_mps2))

    def step(self, memory: PredictorMemory, now: ControlInput) -> tuple[Prediction, PredictorMemory]:
        """Return the predicted state, and the memory with the newest command."""
        drives = np.empty_like(memory.drives)
        drives[..., :-3] = memory.drives[..., 1:-2]
        drives[..., -3] = now.sent_accel_w_mps2
        thrust = self._thrust(memory.thrust_mps2, self._oldest(drives))
        x, y, z = up_axis_parts(now.q_w_flu_wxyz)
        accel = stack(thrust * x, thrust * y, thrust * z - self.vehicle.gravity_mps2)
        drives[..., -2] = accel
        drives[..., -1] = _jerk(thrust, now.q_w_flu_wxyz, now.rate_flu_radps)
        poles = Poles(self.observer_radps, self.observer_trend)
        observed = observe(memory.observed, now.velocity_w_mps, accel, now.age_s, now.dt_s, poles)
        return self._propagate(now, drives, observed), PredictorMemory(drives, stack(thrust), observed)

    def _oldest(self, drives: Array) -> Array:
        """Return the command that acts at capture time, (..., 3)."""
        return drives[..., 0]

    def _thrust(self, thrust_mps2: Array, oldest_sent: Array) -> Scalar:
        """Return the specific thrust at capture time, when the oldest kept command acted."""
        (x, y, z), (before,) = unstack(oldest_sent), unstack(thrust_mps2)
        up = z + self.vehicle.gravity_mps2
        size = math_module(x).sqrt(x * x + y * y + up * up)
        return before + (size - before) * self.thrust_share

    def _propagate(self, now: ControlInput, drives: Array, observed: DisturbanceEstimate) -> Prediction:
        w, velocity = self.weights, now.velocity_w_mps
        late = now.age_s - self.vehicle.mocap_age_s  # the part of the age the weights do not know
        ahead = w.horizon_s + late
        moved, faster = dots(w.drives[..., 0, :, :], drives), dots(w.drives[..., 1, :, :], drives)
        disturbance, rate = observed.disturbance, observed.rate
        middle, end = disturbance + (ahead / 3.0) * rate, disturbance + ahead * rate
        position = now.position_w_m + ahead * velocity + (0.5 * ahead * ahead) * middle + moved
        return Prediction(position, velocity + ahead * (disturbance + 0.5 * ahead * rate) + faster, end)

    @cached_property
    def thrust_share(self) -> float:
        """Share of a change of thrust that happens in one period."""
        return -math.expm1(-self.period_s / self.vehicle.thrust_lag_s)

    @cached_property
    def weights(self) -> "Weights":
        """Response at the horizon to every command."""
        leads = np.broadcast_arrays(self.lead_s, self.thrust_lead_s)
        if not leads[0].shape:
            return _weights(self.vehicle, self.period_s, float(leads[0]), float(leads[1]))
        pairs = zip(*(lead[..., 0].ravel().tolist() for lead in leads), strict=True)
        return _stacked([_weights(self.vehicle, self.period_s, *pair) for pair in pairs], leads[0].shape[:-1])


@dataclass(frozen=True)
class Weights:
    """Response of (position, velocity) at the horizon to the drives, per axis: (..., 2, 3, n + 2)."""

    horizon_s: Scalar
    drives: Array


def _stacked(weights: list[Weights], lead: tuple[int, ...]) -> Weights:
    """Return the weights of all vehicles of a batch of shape `lead`."""
    horizon_s, drives = np.array([w.horizon_s for w in weights]), np.stack([w.drives for w in weights])
    return Weights(horizon_s.reshape(*lead, 1), drives.reshape(*lead, *drives.shape[1:]))


def _jerk(thrust_mps2: Scalar, q: Array, rate_flu_radps: Array) -> Array:
    """Return the jerk of a constant thrust that turns: its size times R (omega x e3), shape (..., 3)."""
    (w, x, y, z), (roll, pitch, _) = unstack(q), unstack(rate_flu_radps)
    roll, pitch = thrust_mps2 * roll, thrust_mps2 * pitch
    return stack(
        pitch * (1 - 2 * (y * y + z * z)) - roll * (2 * (x * y - w * z)),
        pitch * (2 * (x * y + w * z)) - roll * (1 - 2 * (x * x + z * z)),
        pitch * (2 * (x * z - w * y)) - roll * (2 * (y * z + w * x)),
    )


@lru_cache(maxsize=1024)
def _weights(vehicle: VehicleModel, period_s: float, lead_s: float, thrust_lead_s: float) -> Weights:
    horizon = vehicle.mocap_age_s + vehicle.setpoint_delay_s + lead_s
    lag = second_order(vehicle.attitude_bandwidth_radps, vehicle.attitude_damping)
    systems = (lag, lag, first_order(vehicle.thrust_lag_s))
    count = int(np.ceil((vehicle.mocap_age_s + vehicle.setpoint_delay_s) / period_s - 1e-9)) + 1
    across = _command_spans(vehicle.mocap_age_s + vehicle.setpoint_delay_s, lead_s, period_s, count)
    upward = _command_spans(vehicle.mocap_age_s + vehicle.thrust_delay_s, thrust_lead_s, period_s, count)

    def of_axis(row: int, system: Array, spans: list[tuple[float, float]]) -> list[float]:
        end = exponential(system * horizon)
        return [*(_span(system, horizon, row, *span) for span in spans), end[row, 2], end[row, 3]]

    axes = list(zip(systems, (across, across, upward), strict=True))
    return Weights(horizon, np.array([[of_axis(row, *axis) for axis in axes] for row in (0, 1)]))


def _command_spans(known_s: float, lead_s: float, period_s: float, count: int) -> list[tuple[float, float]]:
    """Return the start and end (s after the capture) of the action of each of `count` commands, oldest first.

    A command sent k cycles ago begins to act k periods before `known_s`, the sum of age and delay; the newest one
    continues for `lead_s` after that.
    """
    starts = [known_s - k * period_s for k in range(count, 0, -1)]
    return [(max(0.0, a), max(0.0, b)) for a, b in zip(starts, [*starts[1:], known_s + lead_s], strict=True)]


def _span(system: Array, horizon_s: float, row: int, start_s: float, end_s: float) -> float:
    """Return the response at the horizon to a unit command from `start_s` to `end_s`; none after the horizon."""
    begun = exponential(system * max(0.0, horizon_s - start_s))[row, 4]
    ended = exponential(system * max(0.0, horizon_s - end_s))[row, 4]
    return float(begun - ended)
