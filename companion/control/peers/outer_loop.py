"""Shared parts of the peers' laws: the state they see, feedback with feed-forward, and a trigger.

PX4 turns and lifts the vehicle, so of each law its outer loop remains: an acceleration, which is converted to attitude
and thrust as for any law. All get the prediction over the known delays that ours has (`delay_predictor`), so that laws
are compared and not delays; each predicts with its own estimate of the disturbance.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Self

import numpy as np
from pydantic import Field

from companion.control.controller import ControlInput, ControlOutput, Memory, VehicleModel
from companion.control.delay_predictor import Prediction, Predictor, PredictorMemory
from companion.control.gains import Diagonal, Gains, NotNegative, diagonal
from companion.core.types import Array, Reference, Scalar
from companion.core.values import value
from companion.geometry.array_math import maximum, minimum

_LONGEST_S = 0.05
"""Longest gap in the frames that an estimate is advanced by."""


class PeerGains(Gains):
    """Gain that every peer has: that of the trigger."""

    send_from_mps2: NotNegative = Field(
        0.2, description="change of the command along any axis that is worth sending, m/s^2; 0: every cycle sends"
    )


class FeedbackGains(PeerGains):
    """Gains of a law with linear feedback of position and velocity, on a predicted state."""

    kp_per_s2: Diagonal = diagonal(4.0, 4.0, 4.0, note="acceleration per position error, 1/s^2")
    kd_per_s: Diagonal = diagonal(3.2, 3.2, 3.2, note="acceleration per velocity error, 1/s")
    predict: bool = Field(True, description="predict the state; false: the law sees the state as it is")
    lead_s: NotNegative = Field(0.1, le=0.4, description="time to predict beyond the known delays, s")
    thrust_lead_s: NotNegative = Field(0.05, le=0.4, description="time for which the newest thrust goes on, s")


@value
class LoopMemory:
    """Memory of the shared parts; vectors (..., 3) in W, m/s^2."""

    predictor: PredictorMemory
    held: Array
    """Command of the last event; infinite before the first."""
    age_s: Scalar
    """Age of the state in the last cycle."""


@value
class Sight:
    """View that a law has in one cycle; vectors (..., 3) in W."""

    predicted: Prediction
    """Position and velocity ahead, without the disturbance that the law estimates."""
    acting_w_mps2: Array
    """Acceleration by the rotors at the capture; the rest of the measured one is the disturbance."""
    ahead_s: Scalar
    """Time from the capture to the predicted instant."""
    elapsed_s: Scalar
    """Time between the last two captures; 0 without a new frame."""

    def errors(self, reference: Reference, disturbance: Array) -> tuple[Array, Array]:
        """Return the errors of position and velocity, with a disturbance (m/s^2) that goes on until then."""
        ahead_s, seen = self.ahead_s, self.predicted
        position = seen.position_w_m + (0.5 * ahead_s * ahead_s) * disturbance
        velocity = seen.velocity_w_mps + ahead_s * disturbance
        return position - reference.position_w_m, velocity - reference.velocity_w_mps


@dataclass(frozen=True)
class PeerLaw(ABC, Generic[Memory]):
    """Base of the peers' laws: the shared parts of a cycle, and the methods that each law adds."""

    gains: PeerGains
    vehicle: VehicleModel
    period_s: float

    def initial(self, first: ControlInput) -> Memory:
        """Return the memory at lift-off: no disturbance."""
        return self.initial_with(first, np.zeros_like(first.position_w_m))

    @abstractmethod
    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> Memory:
        """Return the memory for a vehicle in flight, as `SeededLaw`."""

    @abstractmethod
    def step(self, memory: Memory, now: ControlInput) -> tuple[Memory, ControlOutput]:
        """Run one cycle, as `Controller`."""

    @property
    @abstractmethod
    def preview_s(self) -> float:
        """Time ahead of now at which the law needs its reference, s."""

    def without_trigger(self) -> Self:
        """Return the law that sends in every cycle."""
        return replace(self, gains=self.gains.model_copy(update={"send_from_mps2": 0.0}))

    @cached_property
    def predictor(self) -> Predictor:
        """The predictor, without its observer; by itself it says how the rotors accelerate the vehicle."""
        return Predictor(self.vehicle, self.period_s, 0.0, 0.0)

    def begin(self, first: ControlInput) -> LoopMemory:
        """Return the memory at lift-off: nothing sent."""
        return LoopMemory(self.predictor.initial(first), np.full_like(first.position_w_m, np.inf), first.age_s)

    def look(self, memory: LoopMemory, now: ControlInput) -> tuple[Sight, LoopMemory]:
        """Return what the law sees, and the memory after this cycle but for the command held."""
        seen, predictor = self.predictor.step(memory.predictor, now)
        elapsed_s = minimum(maximum(now.dt_s + memory.age_s - now.age_s, 0.0), _LONGEST_S)
        ahead_s = now.age_s + self.predictor.preview_s
        return Sight(seen, predictor.observed.accel, ahead_s, elapsed_s), LoopMemory(predictor, memory.held, now.age_s)

    def send(
        self, memory: LoopMemory, wanted: Array, now: ControlInput, signals: dict[str, Array]
    ) -> tuple[LoopMemory, ControlOutput]:
        """Return the memory with the command that is held, and the output, for a wanted acceleration (m/s^2)."""
        wanted = wanted - now.known_accel_w_mps2
        held, event = send_on_change(memory.held, wanted, self.gains.send_from_mps2)
        return replace(memory, held=held), ControlOutput(held, event, {**signals, "wanted": wanted})


@dataclass(frozen=True)
class FeedbackLaw(PeerLaw[Memory]):
    """Peer with linear feedback of the predicted errors."""

    gains: FeedbackGains

    @cached_property
    def predictor(self) -> Predictor:
        """The predictor with the law's own leads."""
        return Predictor(self.vehicle, self.period_s, self.gains.lead_s, self.gains.thrust_lead_s)

    @property
    def preview_s(self) -> float:
        """Time ahead to which the state is predicted; 0 without a prediction."""
        return self.predictor.preview_s if self.gains.predict else 0.0  # type: ignore[return-value]

    def look(self, memory: LoopMemory, now: ControlInput) -> tuple[Sight, LoopMemory]:
        """Return what the law sees: a predicted state, or the measured one."""
        sight, after = super().look(memory, now)
        if self.gains.predict:
            return sight, after
        here = Prediction(now.position_w_m, now.velocity_w_mps, 0.0 * now.velocity_w_mps)
        return replace(sight, predicted=here, ahead_s=0.0 * sight.ahead_s), after

    def feedback(self, errors: tuple[Array, Array], reference: Reference) -> Array:
        """Return p_d'' - K_p e - K_d e' (m/s^2): Lee et al. 2010, eq. 15, per kilogram and without gravity."""
        position, velocity = errors
        return np.asarray(
            reference.acceleration_w_mps2 - self.gains.kp_per_s2 * position - self.gains.kd_per_s * velocity
        )


def send_on_change(held: Array, wanted: Array, from_mps2: Scalar) -> tuple[Array, Array]:
    """Return the command in force and the event, 0 or 1 (..., 1), of a trigger on a change along any axis.

    Send-on-delta: Miskowicz, "Send-on-delta concept: an event-based data reporting strategy", Sensors 6, 2006.
    """
    event = np.abs(wanted - held).max(axis=-1, keepdims=True) >= from_mps2
    return np.where(event, wanted, held), event.astype(float)
