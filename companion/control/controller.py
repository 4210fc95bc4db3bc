"""What the flight loop asks of a control law, and what it gives it."""

from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from companion.core.types import Array, Reference


@dataclass(frozen=True)
class VehicleModel:
    """What a law may know of its vehicle; measured in a hover, kept in the vehicle's configuration."""

    mass_kg: float = 4.85
    gravity_mps2: float = 9.8
    attitude_bandwidth_radps: float = 7.7
    """Natural frequency of the closed attitude loop, second order."""
    attitude_damping: float = 0.8
    thrust_lag_s: float = 0.05
    setpoint_delay_s: float = 0.04
    """From sending a setpoint to the first movement of the attitude."""
    thrust_delay_s: float = 0.01
    """From sending a setpoint to the first change of the thrust: no attitude loop is in the way."""
    mocap_age_s: float = 0.01
    """Usual age of the newest frame when the law runs."""


@dataclass(frozen=True)
class ControlInput:
    """All a law sees in one cycle; vectors (..., 3) in W."""

    position_w_m: Array
    velocity_w_mps: Array
    q_w_flu_wxyz: Array
    rate_flu_radps: Array
    age_s: float | Array
    """How long ago that state was true; (..., 1) where vehicles differ."""
    reference: Reference
    """What is asked for `Controller.preview_s` from now."""
    sent_accel_w_mps2: Array
    """u of what was really sent last, after the limits, without the part that counters the arms."""
    dt_s: float
    known_accel_w_mps2: Array = field(default_factory=lambda: np.zeros(3))
    """The part of Delta that is known beforehand: what the commanded motion of the arms will do to the vehicle when a
    command sent now begins to act (-F_m/m_t, eq. mod). A law subtracts it from its command."""


@dataclass(frozen=True)
class ControlOutput:
    """What a law wants; `event` (..., 1) is 1 where it is worth sending, `signals` its inner values for the record."""

    accel_w_mps2: Array
    """u = U_c/m_t - g e_3."""
    event: Array
    signals: dict[str, Array]


class Controller(Protocol):
    """A control law: a pure step from memory to memory. Write one, name it in a TOML file, and fly it."""

    @property
    def preview_s(self) -> float:
        """How far ahead the law wants its reference."""

    def initial(self, first: ControlInput) -> Any:
        """Memory at lift-off, from the first input."""

    def step(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:
        """One control cycle."""


@runtime_checkable
class SeededLaw(Protocol):
    """A law that can take over in the air with what is known, so that it need not learn the wind anew."""

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> Any:
        """Memory for a vehicle that flies: `known_disturbance_w_mps2` (..., 3) is what pushes it besides its rotors and
        its arms, and what the law that flew until now has countered."""


@runtime_checkable
class TwoHalves(Protocol):
    """A law whose cycle can be cut in two, so that the setpoint need not wait for the book-keeping.

    `step` must be `decide` followed by `settle`.
    """

    def decide(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:
        """What is to be sent, and what `settle` needs."""

    def settle(self, decided: Any) -> tuple[Any, dict[str, Array]]:
        """The memory for the next cycle, and the inner values for the record that only now are known."""
