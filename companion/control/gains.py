"""Gains of the laws, with the paper's values as defaults, and the stability measures of the filter loop."""

from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, PlainValidator, model_validator

from companion.control.switching import steepest_secant
from companion.core.types import Array

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]


def _diagonal(value: object) -> Array:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"must be a list of numbers, not {value!r}") from error
    array.setflags(write=False)
    return array


def _plain(value: Array) -> list[float]:
    return [float(number) for number in value]


Diagonal = Annotated[Array, PlainValidator(_diagonal), PlainSerializer(_plain)]
"""The diagonal of a gain matrix: a list of numbers in TOML, an array in the law."""


def diagonal(*values: float, note: str) -> Array:
    """Return a field for one gain an axis with these defaults."""
    field: Array = Field(default_factory=lambda: _diagonal(values), description=note)  # a plain default is writable
    return field


class Gains(BaseModel):
    """Base of all gains, strict and frozen: an unknown key is an error."""

    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, arbitrary_types_allowed=True, allow_inf_nan=False
    )


class EtnnGains(Gains):
    """Gains of the ET-NN law. Defaults are the paper's experiment (section 5.1); departures from it are named so."""

    c1: Diagonal = diagonal(1.0, 1.0, 1.2, note="compensation, cubic, iota_1 (eq. iota-dyn)")
    k1: Diagonal = diagonal(1.0, 1.0, 1.2, note="compensation, Theta, iota_1 (eq. iota-dyn)")
    beta1: Diagonal = diagonal(1.0, 1.0, 1.2, note="cubic feedback of y_1 (eq. alpha1)")
    gamma1: Diagonal = diagonal(1.0, 1.0, 1.2, note="Theta feedback of y_1 (eq. alpha1)")
    c2: Diagonal = diagonal(1.0, 1.0, 1.2, note="compensation, cubic, iota_2 (eq. iota-dyn)")
    k2: Diagonal = diagonal(0.8, 0.8, 1.2, note="compensation, fractional, iota_2 (eq. iota-dyn)")
    beta2: Diagonal = diagonal(0.6, 0.6, 0.7, note="cubic feedback of y_2 (alpha_2)")
    gamma2: Diagonal = diagonal(1.0, 1.0, 1.2, note="fractional feedback of y_2 (alpha_2)")
    k: Diagonal = diagonal(3.0, 3.0, 4.0, note="compensation, linear, iota_1 (eq. iota-dyn), 1/s")
    p: float = Field(0.75, gt=0.5, lt=1.0, description="exponent of the fractional powers")
    epsilon: Positive = Field(1e-4, description="square of s below which Theta fades out")
    filter_eps: Positive = Field(0.3, description="time constant varepsilon of the command filter, s")
    zeta: Positive = Field(0.5, description="stiffness of the command filter")
    rho: Positive = Field(0.1, description="damping of the command filter")
    sigma: Positive = Field(0.05, description="trigger threshold, m/s^2")
    delta: Positive = Field(0.1, description="trigger slope")
    kappa_initial: NotNegative = Field(0.0, description="start of kappa, m/s^2; the paper asks for >= 0")
    inputs: int = Field(3, ge=3, le=3, description="number N_0 of the network's inputs: the reference velocity")
    hidden: int = Field(4, ge=1, le=64, description="number N_1 of hidden neurons")
    gamma_v0: Diagonal = diagonal(100.0, 100.0, 100.0, 100.0, note="learning gains Gamma_0, N_0 + 1 of them")
    gamma_v1: Diagonal = diagonal(100.0, 100.0, 100.0, 100.0, 100.0, note="learning gains Gamma_1, N_1 + 1 of them")

    v0_max: Positive = Field(10.0, description="radius of the ball of V_0 (Frobenius); the paper gives none")
    v1_max: Positive = Field(10.0, description="radius of the ball of V_1 (Frobenius), m/s^2; the paper gives none")
    projection_band: Positive = Field(0.1, description="share of the squared radius in which the projection sets in")
    network_seed: int = Field(0, description="seed of V_0(0); the paper does not give its start")
    network_spread: NotNegative = Field(1.0, description="half width of the uniform V_0(0)")

    power_regularisation: NotNegative = Field(
        0.0, description="departure: e in s/(s's + e)^(1-p), bounds the slope of the fractional powers; 0: as printed"
    )
    boundary_layer_mps: NotNegative = Field(
        0.0, description="departure: |y_2| below which sgn becomes linear, m/s; 0 = as printed"
    )
    switching: float = Field(1.0, ge=0.0, le=1.0, description="departure: share of the switching term; 1 = as printed")
    compensation: float = Field(
        1.0, ge=0.0, le=1.0, description="departure: share of iota_1' and iota_2'; 0 leaves both 0; 1 = as printed"
    )
    push_share: float = Field(
        0.0, ge=0.0, le=1.0, description="departure: share of the observed push that is taken off u_bar; 0 = as printed"
    )
    past_filter: float = Field(
        0.0, ge=0.0, le=1.0, description="departure: share of p_d'' that goes past the command filter; 0 = as printed"
    )
    every_cycle: bool = Field(False, description="departure: send every cycle, trigger off; false = as printed")

    @model_validator(mode="after")
    def _shapes_and_signs(self) -> Self:
        for name in ("c1", "k1", "beta1", "gamma1", "c2", "k2", "beta2", "gamma2", "k"):
            _require_diagonal(name, getattr(self, name), 3)
        _require_diagonal("gamma_v0", self.gamma_v0, self.inputs + 1, zero_ok=True)
        _require_diagonal("gamma_v1", self.gamma_v1, self.hidden + 1, zero_ok=True)
        return self

    def filter_loop(self) -> tuple[float, float]:
        """Return rho/filter_eps and the largest k + s over the axes, both 1/s: stable iff the first is larger.

        Linearised per axis the loop is l^3 + (rho/eps) l^2 + (zeta/eps^2) l + (k + s) zeta/eps^2 = 0 with s the slope
        of k_1 Theta (docs/control.md). Theta bends, so s is its steepest secant: what a describing function can meet.
        """
        slope = self.k1 * steepest_secant(self.p, self.epsilon, self.power_regularisation)
        return self.rho / self.filter_eps, float(np.max(self.k + slope))

    def filter_step_load(self, period_s: float) -> float:
        """Return the load of one control period on the command filter; its steps are stable iff it is below 4.

        Small signals step by z^2 - (2 - a - w) z + (1 - a), a = rho dt/eps, w = zeta dt^2/eps^2: inside the unit circle
        iff 2 a + w < 4.
        """
        share = period_s / self.filter_eps
        return 2.0 * self.rho * share + self.zeta * share**2


def _require_diagonal(name: str, value: Array, size: int, zero_ok: bool = False) -> None:
    low_ok = np.all(value >= 0.0) if zero_ok else np.all(value > 0.0)
    if value.shape != (size,) or not np.all(np.isfinite(value)) or not low_ok:
        raise ValueError(f"{name} must be {size} positive numbers, not {value.tolist()}")


_OF_A_MASS = {"kp": "kp_per_s2", "ki": "ki_per_s3", "kd": "kd_per_s", "integral_max_n": "integral_max_mps2"}
"""Former keys of gains in newtons, and the present keys of gains per kilogram."""


class PidGains(Gains):
    """Gains of the paper's baseline PID, per kilogram: the printed ones divided by the 4.85 kg of its vehicle."""

    kp_per_s2: Diagonal = diagonal(1.6495, 1.6495, 2.0619, note="acceleration per position error, 1/s^2")
    ki_per_s3: Diagonal = diagonal(0.30928, 0.30928, 1.6495, note="acceleration per integrated position error, 1/s^3")
    kd_per_s: Diagonal = diagonal(2.0619, 2.0619, 2.6804, note="acceleration per velocity error, 1/s")
    integral_max_mps2: Positive = Field(3.0928, description="limit of the integral's acceleration per axis, m/s^2")

    @model_validator(mode="before")
    @classmethod
    def _no_gains_in_newtons(cls, data: object) -> object:
        old = [key for key in _OF_A_MASS if isinstance(data, dict) and key in data]
        if old:
            new = ", ".join(_OF_A_MASS[key] for key in old)
            raise ValueError(
                f"{', '.join(old)}: gains in newtons fly one mass only; divide them by the mass (kg) of the vehicle "
                f"they were chosen for and call them {new}"
            )
        return data
