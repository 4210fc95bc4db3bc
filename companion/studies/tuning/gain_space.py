"""Search space of `companion tune`: gains of the ET-NN law, and points of it as one batch of laws. Pure."""

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from companion.config.controller_config import PredictionConfig
from companion.control.controller import Controller, VehicleModel
from companion.control.delay_predictor import Predictor
from companion.control.etnn import Etnn
from companion.control.gains import EtnnGains
from companion.control.switching import steepest_secant
from companion.core.types import Array


@dataclass(frozen=True)
class Knob:
    """One number that is searched, on a logarithmic scale unless `linear`."""

    name: str
    low: float
    high: float
    linear: bool = False

    def value(self, share: Array) -> Array:
        """Convert a share 0..1 into a value of the gain."""
        if self.linear:
            return np.asarray(self.low + share * (self.high - self.low))
        return np.asarray(self.low * (self.high / self.low) ** share)

    def share(self, value: float) -> float:
        """Convert a value of the gain into a share 0..1."""
        if self.linear:
            return (value - self.low) / (self.high - self.low)
        return math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)


class GainSpace(Protocol):
    """Gains of a law that a search varies, and batches of them as one law."""

    @property
    def knobs(self) -> tuple[Knob, ...]:
        """The numbers to search."""

    def law_of(self, values: dict[str, Array], vehicle: VehicleModel, period_s: float) -> Controller:
        """Return the laws of a batch of points (B,) as one law that flies (B,) vehicles."""

    def previews_s(self, law: Any) -> Array:
        """Return the preview of each law of such a batch, (B,), or one for all, (1,)."""

    def penalty(self, points: Array) -> Array:
        """Return what is added to the cost of points (P, knobs) that would be refused, or nearly, (P,)."""

    def stable(self, values: dict[str, float]) -> bool:
        """Return False for a point that the loader refuses."""

    def toml(self, values: dict[str, float], command: str) -> str:
        """Return a controller file with a point's values; `command` found them."""


_OUTER = ("c1", "k1", "beta1", "gamma1", "k")
_INNER = ("c2", "k2", "beta2", "gamma2")
KNOBS = (
    *(Knob(name, 0.03, 8.0) for name in (*_OUTER, *_INNER)),
    Knob("z_outer", 0.6, 2.0),
    Knob("z_inner", 0.6, 2.0),
    Knob("filter_eps", 0.03, 0.2),
    Knob("zeta", 0.3, 3.0),
    Knob("rho", 0.3, 3.0),
    Knob("sigma", 0.015, 0.15),
    Knob("delta", 0.04, 0.9),
    Knob("gamma_v", 0.1, 20.0),
    Knob("power_regularisation", 0.003, 0.1),
    Knob("boundary_layer_mps", 0.05, 6.0),
    Knob("lead_s", 0.01, 0.22, linear=True),
    Knob("thrust_lead_s", 0.0, 0.12, linear=True),
    Knob("observer_radps", 0.5, 10.0),
    Knob("push_share", 0.0, 1.0, linear=True),
    Knob("past_filter", 0.0, 1.0, linear=True),
    Knob("observer_trend", 0.0, 1.0, linear=True),
)
"""Gains of z are those of x and y times `z_outer` (first step) or `z_inner` (second), as the paper's are times 1.2."""

START = {
    "c1": 2.1, "k1": 1.0, "beta1": 1.7, "gamma1": 2.0, "k": 1.7, "c2": 0.066, "k2": 1.8, "beta2": 0.31, "gamma2": 0.44,
    "z_outer": 0.89, "z_inner": 1.33, "filter_eps": 0.148, "zeta": 2.2, "rho": 0.91, "sigma": 0.09, "delta": 0.16,
    "gamma_v": 4.2, "power_regularisation": 0.016, "boundary_layer_mps": 1.3, "lead_s": 0.19, "thrust_lead_s": 0.115,
    "observer_radps": 7.9, "push_share": 0.82, "past_filter": 0.7, "observer_trend": 0.2,
}  # fmt: skip
"""Default centre of a search: the middle of an earlier search, in round numbers."""

_SCALARS = (
    "filter_eps", "zeta", "rho", "sigma", "delta", "power_regularisation", "boundary_layer_mps", "push_share",
    "past_filter",
)  # fmt: skip
HIDDEN = 4


def values_of(shares: Array, knobs: tuple[Knob, ...] = KNOBS) -> dict[str, Array]:
    """Points (B, knobs) of the unit cube as values, each (B,)."""
    return {knob.name: knob.value(np.clip(shares[:, i], 0.0, 1.0)) for i, knob in enumerate(knobs)}


def rounded(shares: Array, knobs: tuple[Knob, ...] = KNOBS) -> dict[str, float]:
    """One point (knobs,) as it is written to a file: three significant digits."""
    return {name: float(f"{value[0]:.3g}") for name, value in values_of(shares[None], knobs).items()}


def shares_of(values: dict[str, float], knobs: tuple[Knob, ...] = KNOBS) -> Array:
    """The point of the unit cube of such values."""
    return np.array([knob.share(values[knob.name]) for knob in knobs])


def gains_of(values: dict[str, Array]) -> EtnnGains:
    """A batch of gains: diagonals (B, 3), scalars (B, 1)."""
    fields: dict[str, Any] = {name: values[name][:, None] for name in _SCALARS}
    for names, z in ((_OUTER, "z_outer"), (_INNER, "z_inner")):
        for name in names:
            fields[name] = values[name][:, None] * np.stack(
                (np.ones_like(values[z]), np.ones_like(values[z]), values[z]), axis=-1
            )
    fields["gamma_v0"] = np.repeat(values["gamma_v"][:, None], 4, axis=1)
    fields["gamma_v1"] = np.repeat(values["gamma_v"][:, None], HIDDEN + 1, axis=1)
    defaults = {name: getattr(EtnnGains(), name) for name in EtnnGains.model_fields}
    return EtnnGains.model_construct(**(defaults | fields))


def gain_fields(values: dict[str, float]) -> EtnnGains:
    """One point's gains, checked, with only those set that a file has to name."""
    fields: dict[str, Any] = {name: values[name] for name in _SCALARS}
    for names, z in ((_OUTER, "z_outer"), (_INNER, "z_inner")):
        fields |= {name: [values[name], values[name], float(f"{values[name] * values[z]:.3g}")] for name in names}
    fields |= {"gamma_v0": [values["gamma_v"]] * 4, "gamma_v1": [values["gamma_v"]] * (HIDDEN + 1)}
    return EtnnGains(**fields)


def law_of(values: dict[str, Array], vehicle: VehicleModel, period_s: float) -> Etnn:
    """The laws of a batch of points, as one law that flies (B,) vehicles."""
    lead_s, thrust_lead_s, observer_radps, trend = (
        values[name][:, None] for name in ("lead_s", "thrust_lead_s", "observer_radps", "observer_trend")
    )
    return Etnn(gains_of(values), Predictor(vehicle, period_s, lead_s, thrust_lead_s, observer_radps, trend))


def values_from(gains: EtnnGains, prediction: PredictionConfig) -> dict[str, float]:
    """The point of a law that was loaded from a file; the second step's z is taken from beta_2."""
    values = {name: float(getattr(gains, name)[0]) for name in (*_OUTER, *_INNER)}
    values |= {name: float(getattr(gains, name)) for name in _SCALARS}
    return values | {
        "z_outer": float(gains.k[2] / gains.k[0]),
        "z_inner": float(gains.beta2[2] / gains.beta2[0]),
        "gamma_v": float(gains.gamma_v1[0]),
        "lead_s": prediction.lead_s,
        "thrust_lead_s": prediction.thrust_lead_s,
        "observer_radps": prediction.observer_radps,
        "observer_trend": prediction.observer_trend,
    }


def damping_margin(shares: Array) -> Array:
    """(rho/eps) / (k + s) of each point (P, knobs): the filter loop is stable above 1 (docs/control.md)."""
    values = values_of(shares)
    secant = np.array([steepest_secant(EtnnGains().p, 1.0, float(e)) for e in values["power_regularisation"]])
    needed = (values["k"] + values["k1"] * secant) * np.maximum(values["z_outer"], 1.0)
    return np.asarray(values["rho"] / values["filter_eps"] / needed)
