"""l, m, n, V_bound and T_bound: by hand, and against V' itself where every disturbance pulls the worst way."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from companion.control.gains import EtnnGains
from companion.core.types import Array
from companion.studies.theory.fixed_time import fixed_time_bound, offset
from companion.studies.theory.lyapunov import Bounds
from tests.control import by_hand

REPAIRED = EtnnGains(filter_eps=0.03, zeta=1.0, rho=1.0)

BOUNDS = Bounds(
    delta_mps2=0.4,
    lipschitz_per_s=0.2,
    filter_error_mps=0.2,
    residual_mps2=0.1,
    x_d=math.hypot(0.6, 1.0),
    v0_error=0.3,
    v1_error=0.2,
    v1_size=0.3,
    f_hat_mps2=0.3 * math.sqrt(5.0),
)
GAIN_NAMES = ("c1", "k1", "beta1", "gamma1", "c2", "k2", "beta2", "gamma2", "k")


def test_the_printed_gains_without_any_disturbance_by_hand() -> None:
    """l = 2^0.75 k_2 with the smallest 0.8; m = c_2/4; n = (k_1 + gamma_1) epsilon^0.75 = 2 * 0.001."""
    bound = fixed_time_bound(REPAIRED, Bounds(), omega=0.5)
    l_ = 0.8 * 2.0**0.75
    assert (bound.l, bound.m, bound.n) == pytest.approx((l_, 0.25, 0.002), rel=1e-6)
    assert bound.v_bound == pytest.approx((0.004 / l_) ** (4.0 / 3.0), rel=1e-6), "less than (0.004/0.25)^(1/2) = 0.13"
    assert bound.settling_time_s == pytest.approx(8.0 / l_ + 8.0, rel=1e-12)
    assert bound.position_m == pytest.approx(2.0 * (0.004 / l_) ** (2.0 / 3.0), rel=1e-6)
    assert bound.applies


def test_it_does_not_apply_to_a_predicted_state() -> None:
    bound = fixed_time_bound(REPAIRED, Bounds(), predicts=True)
    assert [str(one) for one in bound.conditions if not one.holds] == [
        "the law controls a predicted state (docs/departures.md)"
    ]
    assert not bound.applies
    assert math.isinf(bound.v_bound)
    assert math.isinf(bound.settling_time_s)


@pytest.mark.parametrize(("weak", "share"), [("c1", 0.75), ("beta1", 0.75), ("c2", 0.25), ("beta2", 0.5)])
def test_m_is_what_the_weakest_cubic_gain_has_left(weak: str, share: float) -> None:
    gains = REPAIRED.model_copy(update={name: np.full(3, 9.0) for name in ("c1", "beta1", "c2", "beta2")})
    gains = gains.model_copy(update={weak: np.array([5.0, 0.2, 3.0])})
    assert fixed_time_bound(gains, Bounds()).m == pytest.approx(0.2 * share)


def test_a_large_disturbance_makes_the_quartic_ball_the_smaller_one() -> None:
    bound = fixed_time_bound(REPAIRED, Bounds(delta_mps2=100.0), omega=0.2)
    assert bound.v_bound == pytest.approx(math.sqrt(bound.n / (0.8 * 0.25)))
    assert bound.v_bound < (bound.n / (0.8 * bound.l)) ** (4.0 / 3.0)
    assert bound.settling_time_s == pytest.approx(20.0 / bound.l + 20.0)


@pytest.mark.parametrize(
    ("bounds", "more"),
    [
        (Bounds(filter_error_mps=0.6), 0.36 / 12.0),  # |xi|^2/(4 k), k = 3
        (Bounds(f_hat_mps2=0.5), 0.75 * 0.25 ** (1.0 / 3.0) * 0.5),  # 3/4 (2 c_2)^(-1/3) f^(4/3) at f = 2^-1
        (Bounds(delta_mps2=0.6), 0.75 * 0.6),  # 3/4 beta_2^(-1/3) Delta^(4/3) with beta_2 = Delta
        (
            Bounds(residual_mps2=0.6),
            0.75 * 0.6,
        ),  # b = (beta_2 eps^2)^(1/3) makes it one more disturbance
        # a v^2 + (l^2 x^2/(2 a))^2/beta_2 is least at a^3 = 2 A^2/(beta_2 v^2), A = l^2 x^2/2: 3/2 a v^2
        (Bounds(v0_error=2.0, v1_error=8.0, x_d=1.5), 1.5 * 4.0 * (2.0 * 4.5**2 / (0.6 * 4.0)) ** (1.0 / 3.0)),
        (Bounds(v0_error=2.0, v1_size=8.0, x_d=1.5), 1.5 * 4.0 * (2.0 * 4.5**2 / (0.6 * 4.0)) ** (1.0 / 3.0)),
    ],
)
def test_what_each_bound_adds_to_n_by_hand(bounds: Bounds, more: float) -> None:
    assert fixed_time_bound(REPAIRED, bounds).n - 0.002 == pytest.approx(more, rel=1e-5)


def test_friction_in_n_by_hand() -> None:
    """Eqs. S-Lip1 to y-iota with L_f = 0.2, |xi| = 0.1, for the choice that was made; no network, no Delta."""
    bound = fixed_time_bound(REPAIRED, Bounds(lipschitz_per_s=0.2, filter_error_mps=0.1))
    f = bound.free
    eta1, eta2, eta3, eta4 = f.eta
    k_theta, c_theta = 0.5 / math.sqrt(f.tangent), 0.5 * math.sqrt(f.tangent)  # of |s|^(1/2), where it is touched
    a_iota1, a_y1, c_s1 = 4.0 + 1.2 * k_theta, 1.2 * k_theta, 0.1 + 2.4 * c_theta
    c_y2 = 0.2 + 0.5 * sum(f.eta) + 0.5 * f.b
    sigma5, sigma6, sigma7 = 0.02 * a_y1**2 / eta4, 0.02 * a_iota1**2 / eta3, 0.02 / eta1
    quadratic = c_y2**2 / 0.6 + sigma5**2 + sigma6**2 + sigma7**2
    assert bound.n == pytest.approx(quadratic + 0.02 * c_s1**2 / eta2 + 0.01 / 12.0 + 0.002, rel=1e-6)


def test_the_friction_leaves_the_same_margin_to_all_three_conditions() -> None:
    """Lemma 2 with L_f = 0.7, |c_1| = |beta_1| = 1.2: nu = (0.84/(1 - 4 m/3))^3, and beta_2/2 - 2 nu 0.84/4 = m."""
    bound = fixed_time_bound(REPAIRED, Bounds(lipschitz_per_s=0.7))
    assert 0.3 - 0.42 * (0.84 / (1.0 - bound.m / 0.75)) ** 3 == pytest.approx(bound.m, rel=1e-6)
    margins = [(c.value - c.limit) * share for c, share in zip(bound.conditions, (0.75, 0.75, 0.5), strict=False)]
    assert margins == pytest.approx([bound.m] * 3)


def test_no_other_choice_makes_n_smaller() -> None:
    """One of the free numbers a little or much larger or smaller."""
    best = fixed_time_bound(REPAIRED, BOUNDS)
    least = {name: float(min(getattr(REPAIRED, name))) for name in GAIN_NAMES}
    eta, factors = best.free.eta, (0.5, 0.9, 1.1, 2.0)
    others = {
        f"{factor} {name}": {name: factor * vars(best.free)[name]}
        for name in ("a", "b", "tangent")
        for factor in factors
    }
    others |= {
        f"{factor} eta_{index + 1}": {"eta": (*eta[:index], factor * eta[index], *eta[index + 1 :])}
        for index in range(len(eta))
        for factor in factors
    }
    for what, change in others.items():
        other = offset(REPAIRED, BOUNDS, least, replace(best.free, **change))
        assert other >= best.n * (1.0 - 1e-6), f"{what} is better"


def test_what_the_departures_add_to_n_by_hand() -> None:
    layered = REPAIRED.model_copy(update={"boundary_layer_mps": 0.4})  # 3/4 (0.05 + 0.05/0.1) 0.4
    assert fixed_time_bound(layered, Bounds()).n == pytest.approx(0.002 + 0.165, rel=1e-5)
    charged = layered.model_copy(update={"kappa_initial": 0.1})  # 3/4 (0.05 + 0.1/0.1) 0.4
    assert fixed_time_bound(charged, Bounds()).n == pytest.approx(0.002 + 0.315, rel=1e-5)
    rounded = REPAIRED.model_copy(update={"power_regularisation": 1e-4})  # e^p of k_1, gamma_1, k_2, gamma_2
    assert fixed_time_bound(rounded, Bounds()).n == pytest.approx(3.8e-3, rel=1e-5)


def test_the_weights_own_part_of_v_is_added_to_the_ball() -> None:
    gains = REPAIRED.model_copy(update={"gamma_v0": np.full(4, 10.0), "gamma_v1": np.array([5.0, 4.0, 5.0, 5.0, 0.0])})
    bounds = Bounds(v0_error=2.0, v1_error=4.0)
    bound = fixed_time_bound(gains, bounds)
    ball = min((2.0 * bound.n / bound.l) ** (4.0 / 3.0), math.sqrt(2.0 * bound.n / bound.m))
    assert bound.v_bound == pytest.approx(ball + 4.0 / 20.0 + 16.0 / 8.0)


@pytest.mark.parametrize(
    ("gains", "lipschitz_per_s", "failed", "numbers"),
    [
        (EtnnGains(), 0.0, "rho/filter_eps against k + s", (1.0 / 3.0, 4.0 + 1.2 * 10.0665)),
        (REPAIRED.model_copy(update={"switching": 0.5}), 0.0, "share of the sgn term", (0.5, 1.0)),
        (REPAIRED.model_copy(update={"compensation": 0.5}), 0.0, "share of the compensation", (0.5, 1.0)),
        # no nu_3 leaves a margin once L_f^4 (1.2^4 + 1.2^4)/4 >= beta_2/2: L_f >= 0.7334
        (REPAIRED, 0.74, "smallest beta_2 against 2 sigma_1", (0.6, None)),
        (REPAIRED, 0.74, "smallest c_1 against 4/3 sigma_3", (1.0, None)),
        (REPAIRED, 0.74, "smallest beta_1 against 4/3 sigma_2", (1.0, None)),
    ],
)
def test_where_the_theorem_does_not_apply_it_says_why(
    gains: EtnnGains, lipschitz_per_s: float, failed: str, numbers: tuple[float, float | None]
) -> None:
    bound = fixed_time_bound(gains, Bounds(lipschitz_per_s=lipschitz_per_s))
    assert not bound.applies
    assert bound.v_bound == bound.settling_time_s == math.inf
    (condition,) = [c for c in bound.conditions if c.name == failed]
    assert not condition.holds
    assert condition.value == pytest.approx(numbers[0])
    assert condition.limit == pytest.approx(numbers[1], rel=1e-3) if numbers[1] else condition.limit > condition.value
    assert str(condition).startswith(f"{failed}: {condition.value:.3g}, needs ")


def test_just_below_that_friction_it_still_applies() -> None:
    bound = fixed_time_bound(REPAIRED, Bounds(lipschitz_per_s=0.73))
    assert bound.applies
    assert 0.0 < bound.m < 0.01


def test_omega_must_lie_between_none_and_all() -> None:
    for omega in (0.0, 1.0):
        with pytest.raises(ValueError, match="between 0 and 1"):
            fixed_time_bound(REPAIRED, Bounds(), omega)


@dataclass(frozen=True)
class Instant:
    """States, weights and disturbances of one instant, inside BOUNDS."""

    y1: Array
    y2: Array
    iota1: Array
    iota2: Array
    v0: Array
    v1: Array
    v0_error: Array
    v1_error: Array
    delta: Array
    residual: Array
    filter_error: Array


def along(direction: Array, size: float) -> Array:
    return direction * (size / max(float(np.linalg.norm(direction)), 1e-12))


def worst_instant(rng: np.random.Generator, lead_axis: int) -> Instant:
    """All that disturbs points where V grows: Delta and varepsilon along y_2, chi - alpha_1 along iota_1.

    The states lean on one axis, as the one with the smallest gain counts most.
    """
    lean = 1.0 + 9.0 * (np.arange(3) == lead_axis)
    y1, y2, iota1, iota2 = (along(lean * rng.normal(size=3), 10.0 ** rng.uniform(-2.5, 1.0)) for _ in range(4))
    v1 = np.outer([*rng.normal(size=4), 3.0], iota2)  # f_hat along iota_2
    return Instant(
        y1,
        y2,
        iota1,
        iota2,
        rng.normal(size=(4, 4)),
        along(v1, BOUNDS.v1_size),
        along(rng.normal(size=(4, 4)), BOUNDS.v0_error),
        along(np.outer(rng.normal(size=5), y2), BOUNDS.v1_error),
        along(y2, BOUNDS.delta_mps2),
        along(y2, BOUNDS.residual_mps2),
        along(iota1, BOUNDS.filter_error_mps),
    )


def v_rate(at: Instant, gains: EtnnGains) -> float:
    """V' by the equations themselves, in plain loops: eqs. y1-dot, y2-dot, iota-dyn, update1 and update2.

    u = alpha_2, the most eq. key-ineq allows; f has the slope L_f and turns the velocity error along y_2.
    """
    g = {name: getattr(gains, name).tolist() for name in GAIN_NAMES}
    y1, y2, iota1, iota2 = (v.tolist() for v in (at.y1, at.y2, at.iota1, at.iota2))
    p_dot = [0.6, 0.0, 0.0]
    alpha1 = by_hand.alpha_1(p_dot, y1, iota1, g, gains.p, gains.epsilon)
    chi = [a + e for a, e in zip(alpha1, at.filter_error.tolist(), strict=True)]
    x1 = [a + b for a, b in zip(y1, iota1, strict=True)]
    velocity = [chi[j] + iota2[j] + y2[j] for j in range(3)]
    u = by_hand.alpha_2([0.0] * 3, x1, y2, iota2, g, gains.p)  # xi = chi' = 0 wherever it enters: it cancels
    x_d = [*p_dot, 1.0]
    phi_hat = by_hand.activations(at.v0.tolist(), x_d)
    f_hat = by_hand.network_output(at.v1.tolist(), phi_hat)
    phi = by_hand.activations((at.v0 + at.v0_error).tolist(), x_d)
    f_d = by_hand.network_output((at.v1 + at.v1_error).tolist(), phi)
    slip = math.dist(velocity, p_dot)
    f = np.array(f_d) + at.residual + along(at.y2, BOUNDS.lipschitz_per_s * slip)
    theta1, power2 = by_hand.theta(iota1, gains.p, gains.epsilon), by_hand.power(iota2, gains.p)
    s1, s2 = by_hand.squared(iota1), by_hand.squared(iota2)
    iota1_dot = [
        iota2[j] + chi[j] - alpha1[j] - g["c1"][j] * s1 * iota1[j] - g["k"][j] * iota1[j] - g["k1"][j] * theta1[j]
        for j in range(3)
    ]
    iota2_dot = [-iota1[j] - g["c2"][j] * s2 * iota2[j] - g["k2"][j] * power2[j] + f_hat[j] for j in range(3)]
    y1_dot = [velocity[j] - p_dot[j] - iota1_dot[j] for j in range(3)]
    y2_dot = [u[j] + at.delta[j] + f[j] - iota2_dot[j] for j in range(3)]
    states = sum(np.dot(a, b) for a, b in ((y1, y1_dot), (y2, y2_dot), (iota1, iota1_dot), (iota2, iota2_dot)))
    ones0, ones1 = [1.0] * 4, [1.0] * 5  # Gamma cancels with its inverse
    rate1 = np.array(by_hand.rate_of_v1(phi_hat, y2, ones1))
    rate0 = np.array(by_hand.rate_of_v0(x_d, phi_hat, at.v1.tolist(), y2, ones0))
    return float(states - (at.v1_error * rate1).sum() - (at.v0_error * rate0).sum())


@pytest.mark.parametrize("seed", range(6))
def test_v_falls_as_fast_as_the_constants_say_whatever_disturbs_it(seed: int) -> None:
    """Eq. Vdot_ft at many states, for gains whose three axes differ by up to four times."""
    rng = np.random.default_rng(seed)
    axis = seed % 3
    uneven = {name: rng.uniform(1.0, 2.0) * (1.0 + 3.0 * (np.arange(3) != axis)) for name in GAIN_NAMES}
    uneven["beta2"] = uneven["beta2"] + 2.0
    gains = REPAIRED.model_copy(update=uneven)
    bound = fixed_time_bound(gains, BOUNDS)
    assert bound.m > 0.0
    for _ in range(150):
        at = worst_instant(rng, axis)
        z = 0.5 * sum(float(s @ s) for s in (at.y1, at.y2, at.iota1, at.iota2))
        allowed = -bound.l * z**gains.p - bound.m * z**2 + bound.n
        assert v_rate(at, gains) <= allowed + 1e-9 * z**2
    calm = replace(worst_instant(rng, axis), y1=np.zeros(3), y2=np.zeros(3), iota1=np.zeros(3), iota2=np.zeros(3))
    assert v_rate(calm, gains) == pytest.approx(0.0, abs=1e-12)
