"""The paper's law once more, in plain Python loops straight from its index notation; slow, and shares no code."""

import math
import random
from dataclasses import dataclass, field

Vector = list[float]
Matrix = list[list[float]]

PRINTED: dict[str, Vector] = {
    "c1": [1.0, 1.0, 1.2],
    "k1": [1.0, 1.0, 1.2],
    "beta1": [1.0, 1.0, 1.2],
    "gamma1": [1.0, 1.0, 1.2],
    "c2": [1.0, 1.0, 1.2],
    "k2": [0.8, 0.8, 1.2],
    "beta2": [0.6, 0.6, 0.7],
    "gamma2": [1.0, 1.0, 1.2],
    "k": [3.0, 3.0, 4.0],
    "gamma_v0": [100.0] * 4,
    "gamma_v1": [100.0] * 5,
}
"""The diagonals of section 5.1."""
PRINTED_NUMBERS: dict[str, float] = {
    "p": 0.75,
    "epsilon": 1.0e-4,
    "filter_eps": 0.3,
    "zeta": 0.5,
    "rho": 0.1,
    "sigma": 0.05,
    "delta": 0.1,
}
"""The scalars of section 5.1."""


def squared(s: Vector) -> float:
    return s[0] * s[0] + s[1] * s[1] + s[2] * s[2]


def power(s: Vector, p: float, e: float = 0.0) -> Vector:
    """s/(s's + e)^(1-p), 0 at 0."""
    size = squared(s) + e
    return [0.0 if size == 0.0 else x / size ** (1.0 - p) for x in s]


def theta(s: Vector, p: float, epsilon: float) -> Vector:
    """Return Theta of Lemma 1, both branches, component by component."""
    if squared(s) > epsilon:
        return power(s, p)
    fade = math.sin(squared(s) * math.pi / (2.0 * epsilon)) ** 2
    return [fade * x for x in power(s, p)]


def sgn(x: float) -> float:
    return 0.0 if x == 0.0 else math.copysign(1.0, x)


def alpha_1(velocity_ref: Vector, y1: Vector, iota1: Vector, g: dict[str, Vector], p: float, eps: float) -> Vector:
    ti, ty = theta(iota1, p, eps), theta(y1, p, eps)
    return [
        velocity_ref[j]
        - g["c1"][j] * squared(iota1) * iota1[j]
        - g["k"][j] * iota1[j]
        - g["k1"][j] * ti[j]
        - g["beta1"][j] * squared(y1) * y1[j]
        - g["gamma1"][j] * ty[j]
        for j in range(3)
    ]


def alpha_2(chi_dot: Vector, x1: Vector, y2: Vector, iota2: Vector, g: dict[str, Vector], p: float) -> Vector:
    pi, py = power(iota2, p), power(y2, p)
    return [
        chi_dot[j]
        - x1[j]
        - g["c2"][j] * squared(iota2) * iota2[j]
        - g["k2"][j] * pi[j]
        - g["beta2"][j] * squared(y2) * y2[j]
        - g["gamma2"][j] * py[j]
        for j in range(3)
    ]


def activations(v0: Matrix, x_d: Vector) -> Vector:
    """phi = [phi_1 .. phi_N1, 1]."""
    inner = [sum(v0[i][n] * x_d[i] for i in range(len(x_d))) for n in range(len(v0[0]))]
    return [1.0 / (1.0 + math.exp(-a)) for a in inner] + [1.0]


def network_output(v1: Matrix, phi: Vector) -> Vector:
    return [sum(v1[n][j] * phi[n] for n in range(len(phi))) for j in range(3)]


def rate_of_v1(phi: Vector, y2: Vector, gamma: Vector) -> Matrix:
    """Return the rate of V_1, Gamma_1 phi y_2', (N_1 + 1) x 3."""
    return [[gamma[n] * phi[n] * y2[j] for j in range(3)] for n in range(len(phi))]


def slope_matrix(phi: Vector) -> Matrix:
    """phi', (N_1 + 1) x N_1: d phi_n / d b_m, the last row 0 because the bias does not move."""
    hidden = len(phi) - 1
    return [[phi[n] * (1.0 - phi[n]) if n == m else 0.0 for m in range(hidden)] for n in range(hidden)] + [
        [0.0] * hidden
    ]


def rate_of_v0(x_d: Vector, phi: Vector, v1: Matrix, y2: Vector, gamma: Vector) -> Matrix:
    """Gamma_0 x_d [phi'' V_1 y_2]' with phi' transposed."""
    slope = slope_matrix(phi)
    v1_y2 = [sum(v1[n][j] * y2[j] for j in range(3)) for n in range(len(phi))]
    back = [sum(slope[n][m] * v1_y2[n] for n in range(len(phi))) for m in range(len(phi) - 1)]
    return [[gamma[i] * x_d[i] * back[m] for m in range(len(back))] for i in range(len(x_d))]


@dataclass
class ByHand:
    """The whole law; call `step` once a cycle. The weights must stay well inside their balls: no projection here."""

    g: dict[str, Vector]
    n: dict[str, float]
    v0: Matrix
    chi: Vector
    v1: Matrix = field(default_factory=lambda: [[0.0] * 3 for _ in range(5)])
    xi: Vector = field(default_factory=lambda: [0.0] * 3)
    iota1: Vector = field(default_factory=lambda: [0.0] * 3)
    iota2: Vector = field(default_factory=lambda: [0.0] * 3)
    held: Vector | None = None
    kappa: float = 0.0

    def step(self, position: Vector, velocity: Vector, p_d: Vector, v_d: Vector, dt: float) -> tuple[Vector, bool]:
        """u and whether it is an event; then everything moves on by dt."""
        g, n = self.g, self.n
        p, eps = n["p"], n["epsilon"]
        x1 = [position[j] - p_d[j] for j in range(3)]
        y1 = [x1[j] - self.iota1[j] for j in range(3)]
        a1 = alpha_1(v_d, y1, self.iota1, g, p, eps)
        y2 = [velocity[j] - self.chi[j] - self.iota2[j] for j in range(3)]
        x_d = [*v_d, 1.0]
        phi = activations(self.v0, x_d)
        f_hat = network_output(self.v1, phi)
        a2 = alpha_2(self.xi, x1, y2, self.iota2, g, p)
        push = n["sigma"] + self.kappa / n["delta"]
        u_bar = [a2[j] - push * sgn(y2[j]) for j in range(3)]
        event = self.held is None or any(
            self.kappa + n["delta"] * (n["sigma"] - abs(self.held[j] - u_bar[j])) < 0.0 for j in range(3)
        )
        u = list(u_bar) if self.held is None or event else self.held
        self.held = u
        self.kappa += dt * (-self.kappa + max(n["sigma"] - abs(u[j] - u_bar[j]) for j in range(3)))
        self._learn(x_d, phi, y2, dt)
        self._filter(a1, f_hat, dt)
        return u, event

    def _learn(self, x_d: Vector, phi: Vector, y2: Vector, dt: float) -> None:
        r1 = rate_of_v1(phi, y2, self.g["gamma_v1"])
        r0 = rate_of_v0(x_d, phi, self.v1, y2, self.g["gamma_v0"])
        self.v1 = [[w + dt * r for w, r in zip(a, b, strict=True)] for a, b in zip(self.v1, r1, strict=True)]
        self.v0 = [[w + dt * r for w, r in zip(a, b, strict=True)] for a, b in zip(self.v0, r0, strict=True)]

    def _filter(self, a1: Vector, f_hat: Vector, dt: float) -> None:
        """Eqs. cmd-filter and iota-dyn; everything from the old state, but chi from the new xi."""
        g, n = self.g, self.n
        ti, pi = theta(self.iota1, n["p"], n["epsilon"]), power(self.iota2, n["p"])
        s1, s2 = squared(self.iota1), squared(self.iota2)
        eps = n["filter_eps"]
        for j in range(3):
            old_chi, old_iota1, old_iota2 = self.chi[j], self.iota1[j], self.iota2[j]
            bend = -n["zeta"] * math.atan(old_chi - a1[j]) - n["rho"] * math.atan(eps * self.xi[j])
            self.xi[j] += dt * bend / eps**2
            self.chi[j] += dt * self.xi[j]
            damping1 = g["c1"][j] * s1 * old_iota1 + g["k"][j] * old_iota1 + g["k1"][j] * ti[j]
            damping2 = g["c2"][j] * s2 * old_iota2 + g["k2"][j] * pi[j]
            self.iota1[j] = old_iota1 + dt * (old_iota2 + old_chi - a1[j] - damping1)
            self.iota2[j] = old_iota2 + dt * (-old_iota1 - damping2 + f_hat[j])


def random_vectors(seed: int, count: int, scale: float = 1.0) -> list[Vector]:
    rng = random.Random(seed)
    return [[rng.uniform(-scale, scale) for _ in range(3)] for _ in range(count)]
