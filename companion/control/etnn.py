"""ET-NN, the paper's control law: its equations in the paper's symbols, then one cycle in the paper's order.

Wang et al., "Neural Network-Based Adaptive Event-Triggered Control for Dual-Arm Unmanned Aerial Manipulator Systems";
equations by the paper's labels. Vectors are (..., 3) in W, and `g.beta1` is the diagonal of the paper's matrix beta_1.
Scalars are floats for one vehicle, (..., 1) for a batch. The same lines are compiled (docs/decisions/0014).
"""

from dataclasses import dataclass, replace

import numpy as np

from companion.control import network as nn
from companion.control.controller import ControlInput, ControlOutput
from companion.control.delay_predictor import Prediction, Predictor, PredictorMemory
from companion.control.gains import EtnnGains
from companion.control.switching import atan, fractional_factor, sgn, squared, switch_factor
from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import as_column, columns, maximum, minimum, where

_NOTHING = np.zeros(3)
_ROUNDS = 20
"""Iterations of the fixed point at which the compensation is at rest."""


@value
class FilterState:
    """States chi (m/s), xi (m/s^2) of eq. cmd-filter and iota_1 (m), iota_2 (m/s) of eq. iota-dyn."""

    chi: Array
    xi: Array
    iota1: Array
    iota2: Array


@value
class TriggerState:
    """State of the trigger: u held since the last event (m/s^2), (..., 3); kappa, and 1 after the first, (..., 1)."""

    held: Array
    kappa: Array
    started: Array


def virtual_control_1(v_d: Array, y1: Array, iota1: Array, g: EtnnGains) -> Array:
    """Return alpha_1 (m/s), the velocity wanted: eq. alpha1."""
    size, theta = _theta(y1, g)
    return np.asarray(v_d - _damping_1(iota1, g) * iota1 - (g.beta1 * size + g.gamma1 * theta) * y1)


def virtual_control_2(chi_dot: Array, x1: Array, y2: Array, iota2: Array, g: EtnnGains) -> Array:
    """Return alpha_2 (m/s^2), the acceleration wanted: step 2."""
    size, power = _power(y2, g)
    return np.asarray(chi_dot - x1 - _damping_2(iota2, g) * iota2 - (g.beta2 * size + g.gamma2 * power) * y2)


def continuous_control(alpha2: Array, y2: Array, kappa: Array, g: EtnnGains) -> Array:
    """Return u_bar = alpha_2 - (sigma + kappa/delta) sgn(y_2) (m/s^2): eq. ETC-law."""
    (kappa_now,) = columns(kappa)
    return np.asarray(alpha2 - g.switching * (g.sigma + kappa_now / g.delta) * sgn(y2, g.boundary_layer_mps))


def trigger_step(s: TriggerState, u_bar: Array, g: EtnnGains, dt_s: float) -> tuple[TriggerState, Array, Array]:
    """Decide on an event and advance kappa, eq. ETC-law; return the state, u, and the event (..., 1), 0 or 1.

    The event takes effect before kappa is advanced, so |e_j| <= sigma + kappa/delta holds at every instant and kappa
    cannot become negative (for dt_s < delta / (1 + delta)).
    """
    e1, e2, e3 = columns(np.abs(s.held - u_bar))
    (kappa,), (started,) = columns(s.kappa), columns(s.started)
    worst, least = maximum(maximum(e1, e2), e3), minimum(minimum(e1, e2), e3)
    quiet = (kappa + g.delta * (g.sigma - worst) >= 0.0) & (started > 0.0) & (g.every_cycle ^ True)
    slack = g.sigma - where(quiet, least, 0.0)  # the largest sigma - |e_j|
    kappa = kappa + dt_s * (slack - kappa)
    u = where(quiet, s.held, u_bar)
    return TriggerState(u, as_column(kappa), as_column(maximum(started, 1.0))), u, as_column(where(quiet, 0.0, 1.0))


def filter_step(
    s: FilterState, alpha1: Array, f_hat: Array, g: EtnnGains, dt_s: float, past: Array = _NOTHING
) -> FilterState:
    """Advance eqs. cmd-filter and iota-dyn with alpha_1 and f_hat held; `past` of alpha_1' goes past the filter.

    Semi-implicit Euler for the filter (xi before chi): explicit Euler pumps energy into one as fast as a few control
    periods. The compensation is slower and damped by itself: explicit Euler, of the share `g.compensation`.
    """
    late, eps, share_s = s.chi - alpha1, g.filter_eps, dt_s * g.compensation
    xi = s.xi - dt_s / (eps * eps) * (g.zeta * atan(late) + g.rho * atan(eps * s.xi))
    iota1_rate = s.iota2 + late - _damping_1(s.iota1, g) * s.iota1
    iota2_rate = f_hat - s.iota1 - _damping_2(s.iota2, g) * s.iota2
    return FilterState(s.chi + dt_s * (xi + past), xi, s.iota1 + share_s * iota1_rate, s.iota2 + share_s * iota2_rate)


def _damping_1(iota1: Array, g: EtnnGains) -> Array:
    """Return c_1 |iota_1|^2 + k + k_1 Theta(iota_1)/iota_1, eq. iota-dyn."""
    size, theta = _theta(iota1, g)
    return np.asarray(g.c1 * size + g.k + g.k1 * theta)


def _damping_2(iota2: Array, g: EtnnGains) -> Array:
    """Return c_2 |iota_2|^2 + k_2 |iota_2|^(2p - 2), eq. iota-dyn."""
    size, power = _power(iota2, g)
    return np.asarray(g.c2 * size + g.k2 * power)


def _theta(s: Array, g: EtnnGains) -> tuple[Scalar, Scalar]:
    """Return |s|^2, and the factor of s in Theta(s), Lemma 1."""
    size = squared(s)
    return size, switch_factor(size, g.p, g.epsilon, g.power_regularisation)


def _power(s: Array, g: EtnnGains) -> tuple[Scalar, Scalar]:
    """Return |s|^2, and the factor of s in s/(s's)^(1-p)."""
    size = squared(s)
    return size, fractional_factor(size, g.p, g.power_regularisation)


@value
class EtnnMemory:
    """Memory of the law from one cycle to the next."""

    filter: FilterState
    network: nn.NetworkState
    trigger: TriggerState
    predictor: PredictorMemory | None


@value
class Decided:
    """Cycle whose command is computed and whose internal states are still to be advanced."""

    before: EtnnMemory
    trigger: TriggerState
    predictor: PredictorMemory | None
    now: ControlInput
    alpha1: Array
    y2: Array


@dataclass(frozen=True)
class Etnn:
    """Event-triggered neural-network law of the paper, with an optional predictor in front of it."""

    gains: EtnnGains
    predictor: Predictor | None = None

    @property
    def preview_s(self) -> float:
        """Time ahead to which the state is predicted, at which the reference is needed; 0 as printed."""
        return float(self.predictor.preview_s) if self.predictor else 0.0

    def initial(self, first: ControlInput) -> EtnnMemory:
        """Return the memory at lift-off: chi(0) = alpha_1(0), network untrained, nothing sent."""
        lead = first.position_w_m.shape[:-1]
        x1 = first.position_w_m - first.reference.position_w_m
        zero = np.zeros_like(x1)
        alpha1 = virtual_control_1(first.reference.velocity_w_mps, x1, zero, self.gains)
        return EtnnMemory(
            FilterState(alpha1, zero, zero, zero),
            nn.initial_network(self.gains, lead),
            TriggerState(zero, np.full((*lead, 1), self.gains.kappa_initial), np.zeros((*lead, 1))),
            self.predictor.initial(first) if self.predictor else None,
        )

    def step(self, memory: EtnnMemory, now: ControlInput) -> tuple[EtnnMemory, ControlOutput]:
        """Run one cycle: errors, virtual controls, trigger, then every inner state advanced by dt_s."""
        decided, output = self.decide(memory, now)
        after, more = self.settle(decided)
        return after, replace(output, signals=output.signals | more)

    def decide(self, memory: EtnnMemory, now: ControlInput) -> tuple[Decided, ControlOutput]:
        """Run the first half of a cycle: everything that the command depends on."""
        g, f, kappa, r = self.gains, memory.filter, memory.trigger.kappa, now.reference
        state, predictor = self._state(memory, now)
        x1 = state.position_w_m - r.position_w_m  # eq. z-def
        y1 = x1 - f.iota1  # eq. v-def
        alpha1 = virtual_control_1(r.velocity_w_mps, y1, f.iota1, g)
        y2 = state.velocity_w_mps - f.chi - f.iota2
        alpha2 = virtual_control_2(f.xi + self._past(now), x1, y2, f.iota2, g)
        u_bar = continuous_control(alpha2, y2, kappa, g) - now.known_accel_w_mps2
        if self.predictor:
            u_bar = u_bar - g.push_share * state.disturbance_w_mps2
        trigger, u, event = trigger_step(memory.trigger, u_bar, g, now.dt_s)
        signals = {"x1": x1, "y1": y1, "y2": y2, "alpha1": alpha1, "alpha2": alpha2, "u_bar": u_bar}
        signals |= vars(f) | {"kappa": kappa, "push": state.disturbance_w_mps2}
        return Decided(memory, trigger, predictor, now, alpha1, y2), ControlOutput(u, event, signals)

    def settle(self, decided: Decided) -> tuple[EtnnMemory, dict[str, Array]]:
        """Advance network, filter and compensation by dt_s; return also f_hat and its weights for the record.

        The command of a cycle does not depend on them: f_hat enters iota_2' alone (eq. iota-dyn).
        """
        g, before, now = self.gains, decided.before, decided.now
        x_d, phi = nn.hidden_layer(before.network, now.reference.velocity_w_mps)
        f_hat = nn.output(before.network, phi)
        after = EtnnMemory(
            filter_step(before.filter, decided.alpha1, f_hat, g, now.dt_s, self._past(now)),
            nn.network_step(before.network, x_d, phi, decided.y2, g, now.dt_s),
            decided.trigger,
            decided.predictor,
        )
        return after, {"f_hat": f_hat} | vars(before.network)

    def _past(self, now: ControlInput) -> Array:
        """Return the part of alpha_1' (m/s^2) that goes past the filter: it is known, and would come late out of it."""
        return np.asarray(self.gains.past_filter * now.reference.acceleration_w_mps2)

    def _state(self, memory: EtnnMemory, now: ControlInput) -> tuple[Prediction, PredictorMemory | None]:
        if self.predictor is None or memory.predictor is None:
            return Prediction(now.position_w_m, now.velocity_w_mps, 0.0 * now.velocity_w_mps), None
        return self.predictor.step(memory.predictor, now)

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> EtnnMemory:
        """Return the memory of a law that has flown here for long: disturbance learnt, filter and compensation at rest.

        The observer holds the whole disturbance. The share that is not subtracted from the command is held by the bias
        of the network's output: f_hat, from which u -> -f_hat follows once iota_1 and iota_2 have settled.
        """
        g, start = self.gains, self.initial(now)
        known = known_disturbance_w_mps2 + np.zeros_like(now.position_w_m)
        left, predictor = known, start.predictor
        if self.predictor is not None and predictor is not None:
            predictor = self.predictor.with_disturbance(predictor, known)
            left = known * (1.0 - g.push_share) if np.any(self.predictor.observer_radps) else known
        state, _ = self._state(replace(start, predictor=predictor), now)
        iota1, iota2 = compensation_at_rest(left, g)
        y1 = state.position_w_m - now.reference.position_w_m - iota1
        alpha1 = virtual_control_1(now.reference.velocity_w_mps, y1, iota1, g)
        xi = now.reference.acceleration_w_mps2 - self._past(now) + np.zeros_like(alpha1)
        chi = alpha1 - g.rho * g.filter_eps / g.zeta * xi  # as late as the filter follows an alpha_1 that changes by xi
        network = nn.with_bias(start.network, left, g)
        return EtnnMemory(FilterState(chi, xi, iota1, iota2), network, start.trigger, predictor)


def compensation_at_rest(f_hat: Array, g: EtnnGains) -> tuple[Array, Array]:
    """Return iota_1 (m) and iota_2 (m/s) as eq. iota-dyn settles under a constant f_hat.

    chi = alpha_1, iota_2 = a_1 iota_1 and f_hat = iota_1 + a_2 iota_2; a_1 and a_2 depend on them, hence the iteration.
    """
    if g.compensation == 0.0:
        return np.zeros_like(f_hat), np.zeros_like(f_hat)
    iota1 = iota2 = 0.01 * f_hat
    for _ in range(_ROUNDS):
        a1 = _damping_1(iota1, g)
        iota1 = 0.5 * (iota1 + f_hat / (1.0 + a1 * _damping_2(iota2, g)))
        iota2 = a1 * iota1
    return iota1, iota2
