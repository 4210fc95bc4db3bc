"""An integral sliding-mode law with a boundary layer, on a predicted state, that sends only what differs enough."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import Field

from companion.law_api import (
    Array,
    ControlInput,
    ControlOutput,
    Gains,
    Positive,
    Predictor,
    PredictorMemory,
    VehicleModel,
)


class SlidingModeGains(Gains):
    """Its numbers; the defaults fly."""

    bandwidth_radps: Positive = Field(1.6, description="how quickly an error dies out on the sliding surface, rad/s")
    reach_mps2: Positive = Field(2.0, description="acceleration with which the surface is reached, m/s^2")
    layer_mps: Positive = Field(0.6, description="distance from the surface below which sgn is linear, m/s")
    send_from_mps2: Positive = Field(0.25, description="a change of the command that is worth sending, m/s^2")
    lead_s: Positive = Field(0.07, description="how far beyond the known delays the state is predicted, s")


@dataclass(frozen=True)
class SlidingModeMemory:
    """Integral of the error (m s) and the command sent last (m/s^2), (..., 3); the predictor's own memory."""

    integral_m_s: Array
    sent_mps2: Array
    predictor: PredictorMemory


@dataclass(frozen=True)
class SlidingMode:
    """With e = p - p_d: s = e' + 2 w e + w^2 int e, and u = p_d'' - 2 w e' - w^2 e - K sat(s / layer)."""

    gains: SlidingModeGains
    vehicle: VehicleModel
    period_s: float

    @cached_property
    def predictor(self) -> Predictor:
        """Carries the state over its age, the setpoint's delay and `lead_s`."""
        return Predictor(self.vehicle, self.period_s, self.gains.lead_s, self.gains.lead_s)

    @property
    def preview_s(self) -> float:
        """The reference is wanted at the instant the state is predicted for."""
        return float(self.predictor.preview_s)

    def initial(self, first: ControlInput) -> SlidingModeMemory:
        """Nothing integrated, and nothing sent: the first command differs from infinity."""
        nothing = np.zeros_like(first.position_w_m)
        return SlidingModeMemory(nothing, nothing + np.inf, self.predictor.initial(first))

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> SlidingModeMemory:
        """Taking over in the air: the integral that counters a known disturbance, inside the layer."""
        g, start = self.gains, self.initial(now)
        gain = g.reach_mps2 / g.layer_mps * g.bandwidth_radps**2
        integral = np.clip(known_disturbance_w_mps2, -0.8 * g.reach_mps2, 0.8 * g.reach_mps2) / gain
        return SlidingModeMemory(start.integral_m_s + integral, start.sent_mps2, start.predictor)

    def step(self, memory: SlidingModeMemory, now: ControlInput) -> tuple[SlidingModeMemory, ControlOutput]:
        """One cycle; the integral stands still outside the layer, where it would only wind up."""
        g, reference, w = self.gains, now.reference, self.gains.bandwidth_radps
        state, predictor = self.predictor.step(memory.predictor, now)
        error = state.position_w_m - reference.position_w_m
        rate = state.velocity_w_mps - reference.velocity_w_mps
        surface = rate + 2.0 * w * error + w * w * memory.integral_m_s
        reach = g.reach_mps2 * np.clip(surface / g.layer_mps, -1.0, 1.0)
        wanted = reference.acceleration_w_mps2 - 2.0 * w * rate - w * w * error - reach - now.known_accel_w_mps2
        event = np.max(np.abs(wanted - memory.sent_mps2), axis=-1, keepdims=True) > g.send_from_mps2
        sent = np.where(event, wanted, memory.sent_mps2)
        integral = memory.integral_m_s + np.where(np.abs(surface) < g.layer_mps, error * now.dt_s, 0.0)
        output = ControlOutput(sent, event.astype(float), {"error": error, "surface": surface, "wanted": wanted})
        return SlidingModeMemory(integral, sent, predictor), output
