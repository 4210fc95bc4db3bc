"""Defaults against the paper's printed list, departures off, and the stability condition of the filter loop."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import ValidationError

from companion.control.gains import EtnnGains, PidGains
from tests.control import by_hand


def test_the_defaults_are_the_papers_list() -> None:
    gains = EtnnGains()
    for name, diagonal in by_hand.PRINTED.items():
        np.testing.assert_array_equal(getattr(gains, name), diagonal, err_msg=f"section 5.1 prints {name} otherwise")
    for name, number in by_hand.PRINTED_NUMBERS.items():
        assert getattr(gains, name) == number, f"section 5.1 prints {name} = {number}"
    assert (gains.inputs, gains.hidden) == (3, 4), "N_0 = 3, N_1 = 4"
    assert gains.gamma_v0.shape == (4,), "Gamma_0 is 4 x 4: N_0 + 1"
    assert gains.gamma_v1.shape == (5,), "Gamma_1 is 5 x 5: N_1 + 1"


def test_what_departs_from_the_print_is_off_by_default() -> None:
    gains = EtnnGains()
    assert gains.power_regularisation == 0.0
    assert gains.boundary_layer_mps == 0.0
    assert gains.switching == 1.0
    assert gains.every_cycle is False
    assert gains.kappa_initial >= 0.0, "the paper asks for kappa(0) >= 0"


def test_the_baselines_defaults_are_the_papers() -> None:
    gains = PidGains()
    np.testing.assert_allclose(4.85 * gains.kp_per_s2, [8.0, 8.0, 10.0], rtol=1e-4)
    np.testing.assert_allclose(4.85 * gains.ki_per_s3, [1.5, 1.5, 8.0], rtol=1e-4)
    np.testing.assert_allclose(4.85 * gains.kd_per_s, [10.0, 10.0, 13.0], rtol=1e-4)


def test_gains_in_newtons_are_refused_and_never_taken_for_others() -> None:
    with pytest.raises(ValidationError, match=r"kp, integral_max_n: .* divide .* kp_per_s2, integral_max_mps2"):
        PidGains.model_validate({"kp": [8.0, 8.0, 10.0], "integral_max_n": 15.0})


@pytest.mark.parametrize(
    ("bad", "name"),
    [
        ({"c1": [1.0, 1.0]}, "c1"),
        ({"k": [1.0, -1.0, 1.0]}, "k"),
        ({"k": [1.0, 0.0, 1.0]}, "k"),
        ({"beta2": [1.0, float("nan"), 1.0]}, "beta2"),
        ({"gamma1": "strong"}, "gamma1"),
        ({"gamma_v0": [1.0] * 3}, "gamma_v0"),
        ({"gamma_v1": [1.0] * 4}, "gamma_v1"),
        ({"hidden": 6}, "gamma_v1"),
        ({"p": 0.5}, "p"),
        ({"p": 1.0}, "p"),
        ({"sigma": 0.0}, "sigma"),
        ({"filter_eps": -0.1}, "filter_eps"),
        ({"sigmas": 0.1}, "sigmas"),
    ],
)
def test_what_the_paper_does_not_allow_is_refused(bad: dict[str, object], name: str) -> None:
    with pytest.raises(ValidationError, match=name):
        EtnnGains.model_validate(bad)


def test_gains_cannot_be_changed_under_way() -> None:
    gains = EtnnGains()
    with pytest.raises(ValueError, match="read-only"):
        gains.c1[0] = 5.0
    with pytest.raises(ValidationError):
        gains.sigma = 1.0  # type: ignore[misc]


def test_the_printed_set_has_growing_roots() -> None:
    """rho/eps = 1/3 against k = 3: the pair the divergence is made of."""
    gains = EtnnGains()
    damping, needed = gains.filter_loop()
    assert damping == pytest.approx(1.0 / 3.0)
    assert needed == pytest.approx(4.0 + 1.2 * 10.0665, abs=0.01), "z: k + the steepest secant of k_1 Theta"
    pair = max(np.roots([1.0, 1.0 / 3.0, 0.5 / 0.09, 3.0 * 0.5 / 0.09]), key=lambda root: float(root.real))
    assert pair.real == pytest.approx(0.798, abs=0.001)
    assert abs(pair.imag) == pytest.approx(2.83, abs=0.05)


@given(
    k=st.floats(0.1, 20.0),
    e=st.floats(1e-4, 1.0),
    eps=st.floats(0.01, 1.0),
    zeta=st.floats(0.05, 5.0),
    rho=st.floats(0.01, 5.0),
)
def test_the_condition_is_that_of_the_eigenvalues(k: float, e: float, eps: float, zeta: float, rho: float) -> None:
    """d/dt (iota_1, chi, xi) = (chi, xi, -(zeta (chi + (k + s) iota_1) + rho eps xi) / eps^2) per axis."""
    gains = EtnnGains(k=np.full(3, k), k1=np.ones(3), power_regularisation=e, filter_eps=eps, zeta=zeta, rho=rho)
    damping, needed = gains.filter_loop()
    slope = k + e**-0.25
    assert damping == pytest.approx(rho / eps)
    assert needed == pytest.approx(slope)
    assume(abs(damping / needed - 1.0) > 1e-3)
    stiffness = zeta / eps**2
    matrix = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-stiffness * slope, -stiffness, -rho / eps]])
    growth = float(np.linalg.eigvals(matrix).real.max())
    assert (growth < 0.0) == (damping > needed), f"eigenvalues grow at {growth}, rho/eps {damping}, k + s {needed}"
    roots = np.roots([1.0, rho / eps, stiffness, slope * stiffness])
    assert float(roots.real.max()) == pytest.approx(growth, rel=1e-6, abs=1e-6)
