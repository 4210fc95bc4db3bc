"""Numbers of the paper's theorem: l, m, n of eq. Vdot_ft, V_bound, T_bound, and whether they apply.

As printed the proof does not give what it says; the constants here are those it does give (docs/control.md):

- |c|_2 of a diagonal matrix is its largest entry. Where a term has to pull V down, only the smallest counts.
- h of eq. V-iota is k.
- n is printed without sigma_5^2/beta_1 and sigma_6^2/c_1, and with a sigma_s2 that is nowhere else: it is sigma_7.
- Nothing in V' pulls the weights' parts of V down, so eq. Vdot_ft holds for V less those parts, Z = V - W; with W
  bounded by the projection, V ends below the bound on Z plus the largest W, in the same time.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from companion.control.gains import EtnnGains
from companion.studies.theory.lyapunov import Bounds

_DIAGONALS = ("c1", "k1", "beta1", "gamma1", "c2", "k2", "beta2", "gamma2", "k")


@dataclass(frozen=True)
class Condition:
    """One thing that the theorem asks for: `value` must exceed `limit`, or reach it where that is `enough`."""

    name: str
    value: float
    limit: float
    enough: bool = False
    otherwise: str = ""
    """Sentence for a condition that is not met, if the numbers do not explain it."""

    @property
    def holds(self) -> bool:
        """True if the condition holds."""
        return self.value > self.limit or (self.enough and self.value == self.limit)

    def __str__(self) -> str:
        if self.otherwise and not self.holds:
            return self.otherwise
        return f"{self.name}: {self.value:.3g}, needs {'at least' if self.enough else 'more than'} {self.limit:.3g}"


@dataclass(frozen=True)
class Free:
    """Open constants of the proof, all positive: eta_1 .. eta_4 of eq. y2S-Young1, a of eq. NB-bound, and two more."""

    eta: tuple[float, float, float, float]
    a: float
    b: float
    """|N_B3| <= b/2 |y_2|^2 + varepsilon_0^2/(2 b); the paper takes 1."""
    tangent: float
    """Point where the line of eq. theta-bound touches |s|^(2p-1)."""


@dataclass(frozen=True, kw_only=True)
class FixedTimeBound:
    """V' <= -l Z^p - m Z^2 + n with Z = V - W, eq. Vdot_ft, and what follows.

    `v_bound` bounds V of eq. V-comp from `settling_time_s` (s) on, whatever V(0) was: eqs. V_bound and T_bound. Both
    are infinite where the theorem does not apply; the conditions say why.
    """

    l: float  # noqa: E741 - the paper's name
    m: float
    n: float
    v_bound: float
    settling_time_s: float
    conditions: tuple[Condition, ...]
    free: Free
    """The choice that n was computed with."""

    @property
    def applies(self) -> bool:
        """True if every condition of the theorem holds."""
        return all(condition.holds for condition in self.conditions)

    @property
    def position_m(self) -> float:
        """The largest |p - p_d| then: |x_1| <= |y_1| + |iota_1| <= 2 sqrt(V)."""
        return 2.0 * math.sqrt(self.v_bound)


def fixed_time_bound(gains: EtnnGains, bounds: Bounds, omega: float = 0.5, predicts: bool = False) -> FixedTimeBound:
    """The theorem for these gains and bounds; `omega` in (0, 1) trades the size of the ball for the time to it.

    It speaks of the state itself, so it does not apply to a law that `predicts`: a predicted velocity jumps with every
    new command, and what stands for Delta then holds that command's rate of change, which nothing bounds.

    What the paper leaves free is chosen here: nu_3 of Lemma 2 for the largest m, and eta_1 .. eta_4, a of eq. NB-bound,
    the 1 in its |N_B3| and the tangent of eq. theta-bound for the smallest n. The departures that the proof still
    covers (boundary layer, regularised power) enter n. Raises ValueError unless 0 < omega < 1.
    """
    if not 0.0 < omega < 1.0:
        raise ValueError(f"omega = {omega}: eq. T_bound needs a number between 0 and 1")
    least = {name: float(np.min(getattr(gains, name))) for name in _DIAGONALS}
    sigma = _quartic_shares(gains, bounds.lipschitz_per_s, least)
    l_ = 2.0**gains.p * min(least["k1"], least["gamma1"], least["k2"], least["gamma2"])
    m = min(
        0.75 * least["c1"] - sigma[2],
        0.75 * least["beta1"] - sigma[1],
        0.25 * least["c2"],
        0.5 * least["beta2"] - sigma[0],
    )
    free = _best(lambda free: offset(gains, bounds, least, free))
    n = offset(gains, bounds, least, free)
    conditions = (*_conditions(gains, least, sigma), _of_the_state(predicts))
    if not all(condition.holds for condition in conditions):
        return FixedTimeBound(
            l=l_, m=m, n=n, v_bound=math.inf, settling_time_s=math.inf, conditions=conditions, free=free
        )
    ball = min((n / ((1.0 - omega) * l_)) ** (1.0 / gains.p), math.sqrt(n / ((1.0 - omega) * m)))
    time_s = 1.0 / (l_ * omega * (1.0 - gains.p)) + 1.0 / (omega * m)
    v_bound = ball + _largest_weight_part(gains, bounds)
    return FixedTimeBound(l=l_, m=m, n=n, v_bound=v_bound, settling_time_s=time_s, conditions=conditions, free=free)


def _of_the_state(predicts: bool) -> Condition:
    """That x_1 and x_2 are errors of the state, as eq. mod has it."""
    otherwise = "the law controls a predicted state (docs/departures.md)"
    return Condition("the state itself is controlled", float(not predicts), 1.0, enough=True, otherwise=otherwise)


def _conditions(
    gains: EtnnGains, least: Mapping[str, float], sigma: tuple[float, float, float]
) -> tuple[Condition, ...]:
    """The theorem's three; the loop without which Property 1 has no bar xi; and what eqs. key-ineq, V-iota rest on."""
    damping, needed = gains.filter_loop()
    return (
        Condition("smallest c_1 against 4/3 sigma_3", least["c1"], 4.0 / 3.0 * sigma[2]),
        Condition("smallest beta_1 against 4/3 sigma_2", least["beta1"], 4.0 / 3.0 * sigma[1]),
        Condition("smallest beta_2 against 2 sigma_1", least["beta2"], 2.0 * sigma[0]),
        Condition("rho/filter_eps against k + s", damping, needed),
        Condition("share of the sgn term", gains.switching, 1.0, enough=True),
        Condition("share of the compensation", gains.compensation, 1.0, enough=True),
    )


def _quartic_shares(gains: EtnnGains, lipschitz_per_s: float, least: Mapping[str, float]) -> tuple[float, float, float]:
    """sigma_1, sigma_2, sigma_3 of eq. y2S-final, by Lemma 2 with q_1 = |y_2|, nu_1 = 1, nu_2 = 3.

    L_f |c_1| |y_2| |iota_1|^3 <= L_f |c_1| (nu/4 |y_2|^4 + 3/4 nu^(-1/3) |iota_1|^4), and so for beta_1 and y_1. A
    larger nu helps iota_1 and y_1 and hurts y_2: the best are those that leave the same margin to all three.
    """
    if lipschitz_per_s == 0.0:
        return 0.0, 0.0, 0.0
    pairs = [(least[name], lipschitz_per_s * float(np.max(getattr(gains, name)))) for name in ("c1", "beta1")]

    def share(margin: float) -> float:
        return math.fsum(0.25 * most * (most / (few - margin / 0.75)) ** 3 for few, most in pairs)

    low, high = -share(0.0), 0.75 * min(few for few, _ in pairs)
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 0.5 * least["beta2"] - share(middle) > middle else (low, middle)
    return share(low), 0.75 * least["beta1"] - low, 0.75 * least["c1"] - low


def offset(gains: EtnnGains, bounds: Bounds, least: Mapping[str, float], free: Free) -> float:
    """n of eq. Vdot_ft for a choice, and what the departures add; `least` is each gain's smallest entry."""
    lip, p = bounds.lipschitz_per_s, gains.p
    q = 2.0 * p - 1.0
    k_theta, c_theta = q * free.tangent ** (q - 1.0), (1.0 - q) * free.tangent**q
    k1, gamma1 = float(np.max(gains.k1)), float(np.max(gains.gamma1))
    a_iota1, a_y1 = max((gains.k + gains.k1 * k_theta).tolist()), gamma1 * k_theta
    c_s1 = bounds.filter_error_mps + (k1 + gamma1) * c_theta
    eta1, eta2, eta3, eta4 = free.eta
    sigma4 = lip + 0.5 * (eta1 + eta2 + eta3 + eta4)
    sigma5, sigma6, sigma7 = (lip**2 * x / (2.0 * y) for x, y in ((a_y1**2, eta4), (a_iota1**2, eta3), (1.0, eta1)))
    c_s = lip**2 * c_s1**2 / (2.0 * eta2)
    slope = 0.25  # of the sigmoid, at most: |N_B1|, |N_B2| <= slope |V_1| |V~_0| |x_d| |y_2|, with V~_1 or its estimate
    l_squared = slope**2 * (bounds.v1_error**2 + bounds.v1_size**2)
    c_n1 = l_squared * bounds.x_d**2 / (2.0 * free.a) + 0.5 * free.b
    c_n0 = free.a * bounds.v0_error**2 + bounds.residual_mps2**2 / (2.0 * free.b)
    c_f = 0.75 * (2.0 * least["c2"]) ** (-1.0 / 3.0) * bounds.f_hat_mps2 ** (4.0 / 3.0)
    c_0 = 0.75 * least["beta2"] ** (-1.0 / 3.0) * bounds.delta_mps2 ** (4.0 / 3.0) + c_n0 + c_s
    return math.fsum(
        (
            bounds.filter_error_mps**2 / (4.0 * least["k"]),
            c_f,
            (c_n1 + sigma4) ** 2 / least["beta2"],
            sigma5**2 / least["beta1"],
            sigma6**2 / least["c1"],
            sigma7**2 / least["c2"],
            c_0,
            _switch_loss(gains, least),
        )
    )


def _switch_loss(gains: EtnnGains, least: Mapping[str, float]) -> float:
    """Case 2's (k_1 + gamma_1) epsilon^p; regularised, e^p of all four powers; and what a boundary layer costs."""
    e = gains.power_regularisation
    faded = (least["k1"] + least["gamma1"]) * (e or gains.epsilon) ** gains.p
    regularised = (least["k2"] + least["gamma2"]) * e**gains.p
    push = gains.sigma + max(gains.kappa_initial, gains.sigma) / gains.delta
    return float(faded + regularised + 0.75 * push * gains.boundary_layer_mps)


def _best(offset: Callable[[Free], float]) -> Free:
    """The choice with the least `offset`: along one number after the other (golden section over its logarithm).

    Every choice gives a valid bound, so where the search stops matters to its size alone.
    """
    logs, before = [0.0] * 7, math.inf

    def moved(axis: int, log: float) -> float:
        return offset(_free([*logs[:axis], log, *logs[axis + 1 :]]))

    while (now := moved(0, logs[0])) < before * (1.0 - 1e-6):
        before = now
        for axis in range(len(logs)):
            logs[axis] = _golden(partial(moved, axis))
    return _free(logs)


def _free(logs: Sequence[float]) -> Free:
    """Return the choice with these seven logarithms."""
    eta1, eta2, eta3, eta4, a, b, tangent = map(math.exp, logs)
    return Free((eta1, eta2, eta3, eta4), a, b, tangent)


def _golden(f: Callable[[float], float], low: float = -30.0, high: float = 30.0) -> float:
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(45):
        step = ratio * (high - low)
        low, high = (low, low + step) if f(high - step) < f(low + step) else (high - step, high)
    return 0.5 * (low + high)


def _largest_weight_part(gains: EtnnGains, bounds: Bounds) -> float:
    """The largest W: each squared error over twice the smallest gain that learns."""
    pairs = ((bounds.v0_error, gains.gamma_v0), (bounds.v1_error, gains.gamma_v1))
    return math.fsum(0.5 * error**2 / float(gamma[gamma > 0.0].min()) for error, gamma in pairs if np.any(gamma > 0.0))
