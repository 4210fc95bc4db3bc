"""Motor, gear and position loop of one servo; pure, plain floats, stepped with the physics at 500 Hz.

A DC motor behind a gear: at PWM share u and speed w it makes the torque stall * (u - w / no_load), as the "Performance
Graph" of the e-manual shows it. Stall torque and no-load speed are the e-manual's at 12 V and follow the supply. The
position loop is the manual's: PWM in proportion to the distance from the profile's position (XM: Position P Gain / 128
in PWM units of 1/885 for every position unit; AX: compliance slope and margin). D, I and feed-forward gains are left
out.
"""

import math
from dataclasses import dataclass

from mock_autopilot.physics.components import where

RATED_V = 12.0


@dataclass(frozen=True, kw_only=True)
class MotorSpec:
    """Limits, friction and warming of a motor with its gear; torques at the horn."""

    stall_nm: float
    """At RATED_V."""
    no_load_radps: float
    """At RATED_V."""
    stall_a: float
    inertia_kgm2: float
    """Inertia of rotor and gear at the horn, with a small link on it; not in the manuals."""
    friction_nm: float
    """While driven."""
    limp_friction_nm: float
    """Without torque: a geared servo is hard to turn by hand."""
    limp_damping_nms: float
    """Without torque, per rad/s: under more load than the friction holds it sags slowly."""
    warming_c_per_w: float
    warming_s: float
    """Time constant of warming and cooling."""


XM430_W350 = MotorSpec(
    stall_nm=4.1,
    no_load_radps=46 * math.pi / 30,
    stall_a=2.3,
    inertia_kgm2=0.017,
    friction_nm=0.05,
    limp_friction_nm=0.35,
    limp_damping_nms=2.0,
    warming_c_per_w=9.0,
    warming_s=300.0,
)
# Stall torque and no-load speed of the W210 have not been read off its own page of the e-manual.
XM430_W210 = MotorSpec(
    stall_nm=3.0,
    no_load_radps=77 * math.pi / 30,
    stall_a=2.3,
    inertia_kgm2=0.008,
    friction_nm=0.04,
    limp_friction_nm=0.22,
    limp_damping_nms=1.0,
    warming_c_per_w=9.0,
    warming_s=300.0,
)
AX_12A = MotorSpec(
    stall_nm=1.5,
    no_load_radps=59 * math.pi / 30,
    stall_a=1.5,
    inertia_kgm2=0.005,
    friction_nm=0.03,
    limp_friction_nm=0.20,
    limp_damping_nms=0.8,
    warming_c_per_w=12.0,
    warming_s=200.0,
)


class Motor:
    """State and settings of one motor. `angle_rad`, `rate_radps` and `accel_radps2` are the true motion of the horn."""

    __slots__ = (
        "_goal_rad", "_moving_profile", "_no_load_radps", "_profile_rad", "_profile_radps", "_stall_nm", "_voltage_v",
        "accel_radps2", "angle_rad", "current_limit_nm", "gain_per_rad", "heat_nm2s", "margin_rad", "powered",
        "profile_accel_radps2", "profile_limit_radps", "pwm_limit", "pwm_share", "rate_radps", "spec", "torque_nm",
    )  # fmt: skip

    def __init__(self, spec: MotorSpec, angle_rad: float, voltage_v: float = RATED_V) -> None:
        self.spec = spec
        self.angle_rad, self.rate_radps, self.accel_radps2 = angle_rad, 0.0, 0.0
        self.torque_nm = 0.0
        """Torque of the motor itself."""
        self.pwm_share = 0.0
        """Output of the position loop, -1 to 1."""
        self.heat_nm2s = 0.0
        """Integral of the squared torque, from which the servo computes its temperature."""
        self.powered = False
        self.gain_per_rad = 1.0
        """Share of the full PWM for every radian of distance."""
        self.margin_rad = 0.0
        """No PWM inside this distance."""
        self.pwm_limit = 1.0
        self.current_limit_nm = math.inf
        """Torque that the current limit allows."""
        self.profile_limit_radps = math.inf
        self.profile_accel_radps2 = math.inf
        self._goal_rad = self._profile_rad = angle_rad
        self._profile_radps = 0.0
        self._moving_profile = False
        self._voltage_v = 0.0
        self.supply(voltage_v)

    def supply(self, voltage_v: float) -> None:
        """Set the supply voltage (V); stall torque and no-load speed follow it."""
        if voltage_v != self._voltage_v:
            self._voltage_v = voltage_v
            share = max(voltage_v, 0.1) / RATED_V
            self._stall_nm = self.spec.stall_nm * share
            self._no_load_radps = self.spec.no_load_radps * share

    @property
    def goal_rad(self) -> float:
        """Return the goal angle."""
        return self._goal_rad

    @property
    def profile(self) -> tuple[float, float]:
        """Return the profile's present angle (rad) and rate (rad/s)."""
        return self._profile_rad, self._profile_radps

    @property
    def profile_ongoing(self) -> bool:
        """Return whether the profile has not yet reached the goal."""
        return self._moving_profile

    @property
    def strength_nm(self) -> float:
        """Return the largest torque it can make now, at standstill."""
        return min(self._stall_nm * self.pwm_limit, self.current_limit_nm)

    def go_to(self, goal_rad: float) -> None:
        """Set a new goal; the profile continues from its present angle."""
        self._goal_rad = goal_rad
        if self.profile_limit_radps == math.inf:
            self._profile_rad, self._profile_radps, self._moving_profile = goal_rad, 0.0, False
        else:
            self._moving_profile = True

    def power(self, on: bool) -> None:
        """Switch the torque; a profile starts at the horn's angle."""
        if on and not self.powered:
            self._profile_rad, self._profile_radps = self.angle_rad, 0.0
            self.powered = True
            self.go_to(self._goal_rad)
        self.powered = on
        self._moving_profile = self._moving_profile and on

    def step(self, dt_s: float, load_nm: float) -> None:
        """Advance by `dt_s` under a load (N m, positive towards greater angles)."""
        spec, rate = self.spec, self.rate_radps
        if self.powered:
            if self._moving_profile:
                self._advance_profile(dt_s)
            torque, friction = self._drive(rate), spec.friction_nm
        else:
            torque, friction, self.pwm_share = 0.0, spec.limp_friction_nm, 0.0
            load_nm -= spec.limp_damping_nms * rate
        per_nm = dt_s / spec.inertia_kgm2
        # Friction can stop the horn within the step, but not turn it round: it sticks.
        after = _beyond(rate + per_nm * (torque + load_nm), per_nm * friction)
        self.torque_nm = torque
        self.heat_nm2s += torque * torque * dt_s
        self.accel_radps2 = (after - rate) / dt_s
        self.rate_radps = after
        self.angle_rad += after * dt_s

    def _drive(self, rate: float) -> float:
        distance = _beyond(self._profile_rad - self.angle_rad, self.margin_rad)
        self.pwm_share = share = _within(distance * self.gain_per_rad, self.pwm_limit)
        return _within(self._stall_nm * (share - rate / self._no_load_radps), self.current_limit_nm)

    def _advance_profile(self, dt_s: float) -> None:
        """Advance the trapezoidal profile: at the speed limit, or slower where it has to stop at the goal."""
        distance = self._goal_rad - self._profile_rad
        limit, change = self.profile_limit_radps, self.profile_accel_radps2 * dt_s
        if distance == 0.0 and abs(self._profile_radps) <= change:
            self._profile_radps, self._moving_profile = 0.0, False
            return
        wanted = min(limit, abs(distance) / dt_s)
        if change < math.inf:
            # Speed from which whole steps of this deceleration end at the goal.
            wanted = min(wanted, math.sqrt(change * change / 4 + 2 * change * abs(distance) / dt_s) - change / 2)
            wanted = math.copysign(wanted, distance)
            wanted = min(max(wanted, self._profile_radps - change), self._profile_radps + change)
        else:
            wanted = math.copysign(wanted, distance)
        self._profile_radps = wanted
        self._profile_rad += wanted * dt_s
        if abs(self._goal_rad - self._profile_rad) < 1e-12:
            self._profile_rad = self._goal_rad


def _within(number: float, limit: float) -> float:
    if isinstance(number, float):  # in a flight, 500 times a second for each servo
        return limit if number > limit else -limit if number < -limit else number
    return where(number > limit, limit, where(number < -limit, -limit, number))  # type: ignore[unreachable]


def _beyond(number: float, margin: float) -> float:
    """Return by how much a number leaves the margin around zero."""
    if isinstance(number, float):
        return number - margin if number > margin else number + margin if number < -margin else 0.0
    return where(number > margin, number - margin, where(number < -margin, number + margin, 0.0))  # type: ignore[unreachable]
