"""PX4's automatic modes: Hold, Takeoff, Land, Return and the blind descent.

A cascade of PX4's kind and with PX4's parameters: position P, velocity PI, then tilt and thrust.
It sees the estimate only. Units m, m/s, NED in the estimator's frame.
"""

import math
from dataclasses import dataclass, field

from mock_autopilot.physics.plant import GRAVITY_MPS2
from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.setpoint import LEVEL, Quad
from mock_autopilot.px4.vocabulary import Mode, Position

IDLE_SIGNAL = 0.001
"""PX4's thrust setpoint while it waits on the ground, as recorded."""
STOPPED_MPS = 0.3
TAKEOFF_SPEED_MPS = 0.85
"""Recorded: MPC_TKO_SPEED is 1.5, but the smoothed climb of 2.5 m never gets faster than this."""
HEIGHT_P = 0.8
CONTACT_S = 0.35
HOVER_LEARNT_S = 2.0
"""PX4's hover thrust estimator begins 0.1 off, and learns within seconds."""
COMING_DOWN = frozenset({Mode.LAND, Mode.DESCEND})
"""Standing still for this long while landing counts as ground contact."""


@dataclass(frozen=True)
class Estimate:
    """The estimate that the cascade flies on: position, velocity and heading, NED."""

    position_m: tuple[float, float, float]
    velocity_mps: tuple[float, float, float]
    yaw_rad: float
    local_ok: bool
    falls_mps2: float = 0.0
    """Downward acceleration."""


@dataclass(kw_only=True)
class Pilot:
    """The controller of one automatic mode at a time; `enter` starts a mode, `step` sets attitude and signal."""

    params: ParamTable
    mode: Mode = Mode.HOLD
    q_wxyz: Quad = LEVEL
    signal: float = 0.0
    takeoff_done: bool = False
    range_finder: bool = True
    """A distance sensor looks down."""
    _hover_thrust: float = 0.0
    """Learnt thrust of a hover; the parameter until then."""
    _target: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    _yaw_rad: float = 0.0
    _braking: bool = True
    _integral_mps2: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    _ramp_start_s: float = 0.0
    _floor_z_m: float = 0.0
    _down_sp_mps: float = 0.0
    _down_sp_mps2: float = 0.0
    _stuck_s: float = 0.0

    def enter(self, mode: Mode, now: Estimate, start_s: float, floor_z_m: float, airborne: bool = True) -> None:
        """Begin `mode` here and now; `start_s` is when a take-off may spin up, `floor_z_m` the take-off height.

        A take-off that is ordered in the air climbs on: there is nothing to spin up.
        """
        climbing = mode is Mode.HOLD and self.mode is Mode.TAKEOFF and self.takeoff_done
        height_z_m = self._target[2] if climbing else now.position_m[2]  # the take-off ends a little below its height
        goes_on = {mode, self.mode} <= COMING_DOWN
        self.mode, self.takeoff_done, self._braking = mode, False, True
        self._target, self._yaw_rad = [*now.position_m[:2], height_z_m], now.yaw_rad
        self._ramp_start_s, self._floor_z_m = -math.inf if airborne else start_s, floor_z_m
        if not goes_on:  # a failsafe in a landing changes nothing for a vehicle that stands already
            self._stuck_s = 0.0
            self._down_sp_mps, self._down_sp_mps2 = now.velocity_mps[2] if airborne else 0.0, 0.0
        if not airborne or not self._hover_thrust:
            self._hover_thrust = self.params["MPC_THR_HOVER"]
        if not airborne:
            self._integral_mps2 = [0.0, 0.0, 0.0]
        if mode is Mode.TAKEOFF:
            self._target[2] = now.position_m[2] - self.params["MIS_TAKEOFF_ALT"]

    def aim(self, height_z_m: float) -> None:
        """Set another height (NED z, m) for the take-off in progress."""
        self._target[2] = height_z_m

    def home_in(self, home: Position, cruise_z_m: float) -> None:
        """Start Return: fly at `cruise_z_m` (NED) until above home, then land."""
        self._target = [home.x_m, home.y_m, cruise_z_m]
        self._braking = False

    def step(self, now: Estimate, now_s: float, landed: bool, dt_s: float) -> None:
        """Run the cascade once: set attitude and signal from the estimate."""
        if landed and self.mode is not Mode.TAKEOFF:
            self.q_wxyz, self.signal = _tilted(0.0, 0.0, now.yaw_rad), IDLE_SIGNAL
            self._integral_mps2 = [0.0, 0.0, 0.0]
            return
        acceleration = self._wanted_acceleration(now, dt_s)
        self._to_attitude(acceleration)
        self._notice_ground(now, dt_s)
        if not landed and self._stuck_s == 0.0:
            self._learn_hover_thrust(now, dt_s)
        if self.mode is Mode.TAKEOFF:
            self._ramp_up(now, now_s)

    def _wanted_acceleration(self, now: Estimate, dt_s: float) -> tuple[float, float, float]:
        velocity_sp = (*self._horizontal_velocity(now), self._vertical_velocity(now, dt_s))
        gains = [(self.params[f"MPC_{a}_VEL_P_ACC"], self.params[f"MPC_{a}_VEL_I_ACC"]) for a in ("XY", "XY", "Z")]
        wanted = []
        for axis, (gain, integral_gain) in enumerate(gains):
            error = velocity_sp[axis] - now.velocity_mps[axis]
            if axis < 2 and not now.local_ok:
                error = self._integral_mps2[axis] = 0.0  # level: nothing to correct against
            step = integral_gain * error * dt_s
            self._integral_mps2[axis] = _clip(self._integral_mps2[axis] + step, GRAVITY_MPS2 / 2.0)
            wanted.append(gain * error + self._integral_mps2[axis])
        return (wanted[0], wanted[1], wanted[2])

    def _horizontal_velocity(self, now: Estimate) -> tuple[float, float]:
        """Return the velocity setpoint: brake first, then hold the position where it stopped."""
        if self.mode in {Mode.DESCEND, Mode.ALTITUDE}:
            return (0.0, 0.0)
        if self._braking:
            if math.hypot(*now.velocity_mps[:2]) < STOPPED_MPS:
                self._braking = False
                self._target[0], self._target[1] = now.position_m[0], now.position_m[1]
            return (0.0, 0.0)
        climbing = now.position_m[2] - self._target[2] > 1.0
        if self.mode is Mode.RTL and climbing and not self._above_home(now):
            return (0.0, 0.0)  # height first
        gain = self.params["MPC_XY_P"]
        vx = gain * (self._target[0] - now.position_m[0])
        vy = gain * (self._target[1] - now.position_m[1])
        scale = min(1.0, self.params["MPC_XY_CRUISE"] / max(math.hypot(vx, vy), 1e-9))
        return (vx * scale, vy * scale)

    def _vertical_velocity(self, now: Estimate, dt_s: float) -> float:
        landing = self.mode is Mode.RTL and self._above_home(now)
        if landing or self.mode in {Mode.LAND, Mode.DESCEND}:
            return self._slewed(self._landing_speed(now), dt_s)
        up = TAKEOFF_SPEED_MPS if self.mode is Mode.TAKEOFF else self.params["MPC_Z_V_AUTO_UP"]
        wanted = HEIGHT_P * (self._target[2] - now.position_m[2])
        return self._slewed(min(max(wanted, -up), self.params["MPC_Z_V_AUTO_DN"]), dt_s)

    def _above_home(self, now: Estimate) -> bool:
        away_m = math.hypot(self._target[0] - now.position_m[0], self._target[1] - now.position_m[1])
        return away_m < self.params["NAV_ACC_RAD"]

    @property
    def takes_off(self) -> bool:
        """Return whether a take-off from the ground is in progress (landed_state 3)."""
        return self.mode is Mode.TAKEOFF and math.isfinite(self._ramp_start_s)

    @property
    def descending(self) -> bool:
        """Return whether the landing proper is in progress (landed_state 4)."""
        return self.mode is Mode.LAND or (self.mode is Mode.RTL and self._down_sp_mps > 0.1)

    def _landing_speed(self, now: Estimate) -> float:
        """Return the sink speed: falling from MPC_LAND_ALT1 to _ALT2, a crawl below _ALT3 with a distance sensor.

        When blind it is MPC_LAND_SPEED all the way.
        """
        slow_mps = self.params["MPC_LAND_SPEED"]
        if self.mode is Mode.DESCEND or not now.local_ok:
            return slow_mps
        height_m = self._floor_z_m - now.position_m[2]
        crawls = self.range_finder and int(self.params["EKF2_RNG_CTRL"])
        if height_m < self.params["MPC_LAND_ALT3"] and crawls:
            return self.params["MPC_LAND_CRWL"]
        high_m, low_m = self.params["MPC_LAND_ALT1"], self.params["MPC_LAND_ALT2"]
        share = min(max((height_m - low_m) / max(high_m - low_m, 1e-6), 0.0), 1.0)
        return slow_mps + share * (max(self.params["MPC_Z_V_AUTO_DN"], slow_mps) - slow_mps)

    def _notice_ground(self, now: Estimate, dt_s: float) -> None:
        """Level the vehicle and reduce the thrust when it stands still although it should sink: that is the ground."""
        stuck = self._down_sp_mps > 0.2 and abs(now.velocity_mps[2]) < 0.05
        self._stuck_s = self._stuck_s + dt_s if stuck else 0.0
        if self._stuck_s > CONTACT_S:
            self.q_wxyz = _tilted(0.0, 0.0, self._yaw_rad)
            self.signal = min(self.signal, self.params["MPC_THR_MIN"])

    def _learn_hover_thrust(self, now: Estimate, dt_s: float) -> None:
        """Learn the thrust that carries the weight, as PX4's hover thrust estimator does in these modes only."""
        if int(self.params["MPC_USE_HTE"]):
            shown = self.signal * GRAVITY_MPS2 / max(GRAVITY_MPS2 - now.falls_mps2, 1.0)
            usual, range_ = self.params["MPC_THR_HOVER"], self.params["HTE_THR_RANGE"]
            learnt = self._hover_thrust + (shown - self._hover_thrust) * dt_s / HOVER_LEARNT_S
            self._hover_thrust = usual + _clip(learnt - usual, range_)

    def _slewed(self, wanted_mps: float, dt_s: float) -> float:
        """Follow the wanted speed with limited acceleration and jerk, as PX4's trajectories do."""
        jerk = self.params["MPC_JERK_AUTO"]
        missing = wanted_mps - self._down_sp_mps
        reached = math.sqrt(2.0 * jerk * abs(missing))  # with which it arrives without acceleration
        wanted_mps2 = math.copysign(min(reached, self.params["MPC_ACC_DOWN_MAX"]), missing)
        self._down_sp_mps2 += _clip(wanted_mps2 - self._down_sp_mps2, jerk * dt_s)
        self._down_sp_mps += self._down_sp_mps2 * dt_s
        return self._down_sp_mps

    def _to_attitude(self, acceleration: tuple[float, float, float]) -> None:
        """Tilt the thrust along the wanted specific force; hover thrust carries the weight."""
        ax, ay, az = acceleration
        lift = max(GRAVITY_MPS2 - az, 0.1)
        most = math.tan(math.radians(self.params["MPC_TILTMAX_AIR"])) * lift
        scale = min(1.0, most / max(math.hypot(ax, ay), 1e-9))
        ax, ay = ax * scale, ay * scale
        c, s = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        forward, right = c * ax + s * ay, -s * ax + c * ay
        pitch = -math.atan2(forward, lift)
        roll = math.atan2(right, math.hypot(forward, lift))
        self.q_wxyz = _tilted(roll, pitch, self._yaw_rad)
        total = math.sqrt(forward**2 + right**2 + lift**2) / GRAVITY_MPS2
        hover = self._hover_thrust
        self.signal = min(max(hover * total, self.params["MPC_THR_MIN"]), self.params["MPC_THR_MAX"])

    def _ramp_up(self, now: Estimate, now_s: float) -> None:
        """Raise the thrust limit over MPC_TKO_RAMP_T after the spool-up; end the climb near its height."""
        since_s = now_s - self._ramp_start_s - self.params["COM_SPOOLUP_TIME"]
        hover = self._hover_thrust
        ramp = hover * since_s / max(self.params["MPC_TKO_RAMP_T"], 0.1)
        if since_s < 0.0:
            self.signal = IDLE_SIGNAL
        elif ramp < 1.3 * hover:
            self.signal = min(self.signal, max(ramp, IDLE_SIGNAL))
        if ramp < hover:
            self._integral_mps2 = [0.0, 0.0, 0.0]
            self._down_sp_mps = self._down_sp_mps2 = 0.0
        self.takeoff_done = now.position_m[2] - self._target[2] < self.params["NAV_MC_ALT_RAD"] * 0.75


def _tilted(roll: float, pitch: float, yaw: float) -> Quad:
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _clip(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
