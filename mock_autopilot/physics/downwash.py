"""Downwash of one multirotor on another: a turbulent jet with the momentum of the upper one's thrust. Pure.

Momentum theory says that the air below a hovering rotor carries the thrust as momentum; below the vehicle it goes on as
a round turbulent jet, which keeps this momentum and widens linearly, with a Gaussian profile. Measured below
quadrotors: L. Bauersfeld, K. Muller, D. Ziegler, F. Coletti, D. Scaramuzza, "Robotics meets Fluid Dynamics: A
Characterization of the Induced Airflow below a Quadrotor as a Turbulent Jet", IEEE RA-L 2025 (arXiv 2403.13321); forces
on a second one: K. Jain, T. Fortmuller, J. Byun, S. Makiharju, M. Mueller, "Modeling of aerodynamic disturbances for
proximity flight of multirotors", ICUAS 2019. Spreading of a round jet: S. Pope, "Turbulent Flows", section 5.1.

The lower one loses as much thrust as momentum meets its rotors: by blade element theory it is 14 N of 48 N in 6 m/s of
downwash, by this model 15 N. Left out: the wake's sweep behind an upper one that moves, its swirl, and the floor.
"""

import math
from dataclasses import dataclass

import numpy as np

from mock_autopilot.physics.quaternion_one import Three

ROTOR_AREA_M2 = 4.0 * math.pi * 0.17**2
"""All discs of the demo's vehicle: four rotors of 0.17 m, 0.33 m from the centre."""
ROTOR_SPREAD_M = 0.5
"""1/e radius of the Gaussian with the second moment of those discs."""
SPREADING = 0.12
"""The jet's 1/e radius grows by this per metre; its half-velocity radius by 0.1 (Pope: 0.094 to 0.102)."""
TURBULENCE = 0.25
"""Standard deviation of the force over its mean, in every axis: the turbulence intensity on a round jet's axis."""
TURBULENCE_TIME_S = 0.1
"""Time in which 6 m/s cross the vehicle."""
LEAST_N = 0.02
"""A smaller push is none."""
_BLOCK = 256


@dataclass(frozen=True)
class Push:
    """A force (N, NED) and an angular acceleration (rad/s^2, FRD) from outside."""

    force_ned_n: Three
    angular_frd_radps2: Three


def mean_push_n(thrust_n: float, below_m: float, beside_m: float) -> float:
    """Return the mean downward force (N) on a vehicle this far below and beside one with this thrust."""
    if below_m <= 0.0:
        return 0.0
    square_m2 = _square_m2(below_m)
    flux_npm2 = 2.0 * thrust_n / (math.pi * square_m2) * math.exp(-2.0 * beside_m * beside_m / square_m2)
    return ROTOR_AREA_M2 * flux_npm2


def _square_m2(below_m: float) -> float:
    """Return the squared 1/e radii of jet and lower vehicle together: the flow is averaged over the lower rotors."""
    jet_m = ROTOR_SPREAD_M + SPREADING * below_m
    return jet_m * jet_m + ROTOR_SPREAD_M * ROTOR_SPREAD_M


def mean_torque_nm(push_n: float, below_m: float, towards_ned_m: tuple[float, float]) -> tuple[float, float]:
    """Return the torque (N m, about north and east) of a push that is stronger on the side of the jet's axis.

    `towards_ned_m` is the horizontal way from the lower vehicle to the axis.
    """
    lever = push_n * ROTOR_SPREAD_M * ROTOR_SPREAD_M / _square_m2(below_m)
    north_m, east_m = towards_ned_m
    return lever * east_m, -lever * north_m


class WashedVehicle:
    """The push on one vehicle over time: its mean, turbulence, and a torque until the rate loops have trimmed it.

    A vehicle that meets no downwash draws no random numbers.
    """

    def __init__(self, rng: np.random.Generator, inertia_kgm2: Three, trim_s: Three, dt_s: float) -> None:
        self._rng, self._inertia, self._dt_s = rng, inertia_kgm2, dt_s
        self._keep = math.exp(-dt_s / TURBULENCE_TIME_S)
        self._fresh = TURBULENCE * math.sqrt(1.0 - self._keep**2)
        self._trim_gain = tuple(-math.expm1(-dt_s / time_s) for time_s in trim_s[:2])
        self._noise, self._trimmed = [0.0, 0.0, 0.0], [0.0, 0.0]
        self._draws: list[list[float]] = []
        self._rests = True

    def step(self, push_n: float, torque_ned_nm: tuple[float, float], yaw_rad: float) -> Push | None:
        """Return the push of the next step for this mean; None where there is none."""
        if push_n < LEAST_N and self._rests:
            return None
        north_nm, east_nm = torque_ned_nm
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        wanted = (
            (c * north_nm + s * east_nm) / self._inertia[0],
            (c * east_nm - s * north_nm) / self._inertia[1],
        )
        felt = [angular - trim for angular, trim in zip(wanted, self._trimmed, strict=True)]
        self._trimmed = [
            trim + gain * part for trim, gain, part in zip(self._trimmed, self._trim_gain, felt, strict=True)
        ]
        x, y, z = self._turbulence()
        self._rests = push_n < LEAST_N and max(abs(part) for part in self._trimmed) < 1e-3
        if self._rests:
            self._noise, self._trimmed = [0.0, 0.0, 0.0], [0.0, 0.0]
            return None
        return Push((push_n * x, push_n * y, push_n * (1.0 + z)), (felt[0], felt[1], 0.0))

    def _turbulence(self) -> list[float]:
        if not self._draws:
            self._draws = self._rng.standard_normal((_BLOCK, 3)).tolist()
        draw = self._draws.pop()
        self._noise = [self._keep * noise + self._fresh * part for noise, part in zip(self._noise, draw, strict=True)]
        return self._noise
