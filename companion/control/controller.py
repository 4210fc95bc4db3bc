"""Interface of a control law: its inputs, its output, and the methods that the flight loop calls."""

from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from companion.core.paper_vehicle import ATTITUDE_BANDWIDTH_RADPS, GRAVITY_MPS2, MASS_KG
from companion.core.types import Array, Reference, Scalar

Begun_co = TypeVar("Begun_co", covariant=True)
Memory = TypeVar("Memory")
Decided = TypeVar("Decided")
"""Memory of a law from one cycle to the next, and between the halves of a cycle: values that the law alone reads."""


@dataclass(frozen=True, kw_only=True)
class VehicleModel:
    """Model of the vehicle for control laws; measured in a hover, stored in the vehicle's configuration."""

    mass_kg: float = MASS_KG
    gravity_mps2: float = GRAVITY_MPS2
    attitude_bandwidth_radps: float = ATTITUDE_BANDWIDTH_RADPS
    """Natural frequency of the closed attitude loop, second order."""
    attitude_damping: float = 0.8
    thrust_lag_s: float = 0.05
    setpoint_delay_s: float = 0.04
    """Time from sending a setpoint to the first movement of the attitude."""
    thrust_delay_s: float = 0.01
    """Time from sending a setpoint to the first change of the thrust, which has no attitude loop."""
    mocap_age_s: float = 0.01
    """Usual age of the newest frame when the law runs."""


@dataclass(frozen=True, kw_only=True)
class ControlInput:
    """Inputs of a law in one cycle; vectors (..., 3) in W."""

    position_w_m: Array
    velocity_w_mps: Array
    q_w_flu_wxyz: Array
    rate_flu_radps: Array
    age_s: Scalar
    """Age of that state; (..., 1) where vehicles differ."""
    reference: Reference
    """Reference at `Controller.preview_s` from now."""
    sent_accel_w_mps2: Array
    """u of the setpoint really sent last, after the limits, without the part that compensates the arms."""
    dt_s: float
    known_accel_w_mps2: Array = field(default_factory=lambda: np.zeros(3))
    """Part of Delta that is known in advance: the acceleration that the commanded motion of the arms gives the vehicle
    when a command sent now begins to act (-F_m/m_t, eq. mod). A law subtracts it from its command."""


@dataclass(frozen=True)
class ControlOutput:
    """Output of a law; `event` (..., 1) is 1 where it is to be sent, `signals` are internal values for the record."""

    accel_w_mps2: Array
    """u = U_c/m_t - g e_3."""
    event: Array
    signals: dict[str, Array]
    yaw_rad: Scalar | None = None
    """Commanded heading; None: that of the reference."""
    age_s: float = 0.0
    """Time since the law last confirmed the command; 0 for a law in this process."""

    def heading_rad(self, reference: Reference) -> Scalar:
        """Return the heading to fly: the law's own, else that of the reference."""
        return reference.yaw_rad if self.yaw_rad is None else self.yaw_rad


class Law(Protocol[Memory]):
    """Control law: a pure step from memory to memory. To fly your own, name it in a TOML file (docs/own-law.md)."""

    @property
    def preview_s(self) -> float:
        """Time ahead of now at which the law needs its reference, s."""

    def initial(self, first: ControlInput) -> Memory:
        """Return the memory at lift-off, from the first input."""

    def step(self, memory: Memory, now: ControlInput) -> tuple[Memory, ControlOutput]:
        """Run one control cycle; return the next memory and the output."""


Controller = Law[Any]
"""Control law whose memory only the law itself reads."""


@runtime_checkable
class SeededLaw(Protocol[Begun_co]):
    """Law that can take control in the air with a known disturbance, so that it need not estimate the wind again."""

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> Begun_co:
        """Return the memory for a vehicle in flight.

        `known_disturbance_w_mps2` (..., 3) is the acceleration not caused by rotors and arms, which the previous law
        has compensated."""


@runtime_checkable
class TwoHalves(Protocol[Memory, Decided]):
    """Law whose cycle has two halves, so that the setpoint is sent before the internal states are updated.

    `step` must be `decide` followed by `settle`.
    """

    def decide(self, memory: Memory, now: ControlInput) -> tuple[Decided, ControlOutput]:
        """Return the input of `settle`, and the output to be sent."""

    def settle(self, decided: Decided) -> tuple[Memory, dict[str, Array]]:
        """Return the memory for the next cycle, and further internal values for the record."""


Halves = TwoHalves[Any, Any]
"""Law in two halves, whose memory only the law itself reads."""
