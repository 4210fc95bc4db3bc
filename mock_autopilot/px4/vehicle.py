"""PX4 as one vehicle: commander, estimator, pilot, land detector and battery, in simulated time.

Pure: time is an argument, nothing is sent from here. The link reads its state and passes on the messages received.
Recorded behaviour: docs/px4-conformance.md.
"""

import math

import numpy as np

from mock_autopilot.faults.autopilot import HEALTHY, rolled
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.airframe import ActuatorDemand, SensorState
from mock_autopilot.physics.geodesy import Origin, simulators_home
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.px4.battery import Battery
from mock_autopilot.px4.commander import AUTO_SUB_MODES, MAIN_MODES, OFFBOARD_LATE_S, PREFLIGHT_TEXT, Commander
from mock_autopilot.px4.estimator import Estimator, Motion
from mock_autopilot.px4.failsafe import FailsafeFlags
from mock_autopilot.px4.horizon import Horizon
from mock_autopilot.px4.innovation_checks import HORIZONTAL_UNSTABLE, InnovationChecks
from mock_autopilot.px4.land_detector import LandDetector
from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.pilot import Estimate, Pilot
from mock_autopilot.px4.setpoint import AttitudeSetpoint, AttitudeTarget, Quad, Triple, next_setpoint, signal_for_thrust
from mock_autopilot.px4.sticks import Sticks
from mock_autopilot.px4.timing import Timing
from mock_autopilot.px4.vision import VisionSample
from mock_autopilot.px4.vocabulary import (
    AUTO_MAIN_MODE,
    LandedState,
    Mode,
    Position,
    Result,
    Severity,
    SystemStatus,
    Text,
)

COMMANDER_PERIODS_S = (0.012, 0.016)
"""PX4's commander sleeps 10 ms between its passes; the recorded simulator counted in steps of 4 ms."""
AT_REST_S = 1.5
"""Time after disarming until the estimator takes it to be at rest."""
PILOT_PERIOD_S = 0.004
HOME_KNOWN_S = 2.0
"""After boot (GPS); without GPS one second after the global origin was set."""
PILOTED = frozenset({Mode.HOLD, Mode.POSITION, Mode.ALTITUDE, Mode.TAKEOFF, Mode.LAND, Mode.RTL, Mode.DESCEND})


class Vehicle:
    """One PX4 from its boot on: commander, estimator, pilot, land detector, battery."""

    def __init__(
        self,
        params: ParamTable,
        rng: np.random.Generator,
        timing: Timing,
        start_yaw_rad: float,
        horizon: Horizon,
        range_off_m: float | None = None,
    ) -> None:
        self.params = params
        self._timing = timing
        self._later_texts: list[tuple[float, Text]] = []
        self.commander = Commander(params, timing.checks_pass_s())
        self.estimator = Estimator(params, rng, start_yaw_rad, horizon, range_off_m or 0.0)
        self.pilot = Pilot(params=params, range_finder=range_off_m is not None)
        self.land_detector = LandDetector(params, timing)
        self.battery = Battery(params)
        self.injected_faults = HEALTHY
        self.sticks = Sticks(params)
        self._remote = False
        self._innovation_checks = InnovationChecks()
        self.attitude_setpoint = AttitudeSetpoint()
        self.home: Position | None = None
        self.origin = simulators_home(params)
        """The local frame's origin on earth, as far as it is known."""
        self.now_s = 0.0
        self.sensor_state = SensorState(
            Motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), start_yaw_rad), _UPRIGHT, _STILL
        )
        self._setpoint_at_s = self._moved_s = -math.inf
        self._commander_due_s = 0.0
        self.commander_passes = 0
        self._was_landed, self._range_doubted_s = True, (0.0, 0.0)
        self._pilot_due_s = 0.0
        self._piloted: tuple[Mode, bool] | None = None
        self._floor_z_m = 0.0
        self._takeoff_z_m = math.nan
        self._failure_told = False
        self._demand_inputs: tuple[object, ...] = ()
        self._last_demand = ActuatorDemand(np.array(self.sensor_state.q_ned_frd_wxyz), None, 0.0, motors_on=False)

    # -- what comes in ---------------------------------------------------------------------------

    def attitude_target(self, target: AttitudeTarget) -> None:
        """Handle SET_ATTITUDE_TARGET: any of them keeps OFFBOARD alive, used or not."""
        if not self.injected_faults.ignores_setpoints:
            self.attitude_setpoint = next_setpoint(target, self.attitude_setpoint)
        self._setpoint_at_s = self.now_s
        if self.commander.misses_setpoints:
            self.commander.check_now()

    def on_vision(self, sample: VisionSample) -> None:
        """Handle an external pose: check it against the estimate of a vehicle at rest, then fuse it.

        Recorded: poses 0.7 m off that came back 0.25 s after disarming were taken over, 2.8 s after it they failed.
        """
        x, y, z = self.estimator.position_m
        applies = self.estimator.at_rest and not self.estimator.uses_gps
        self._innovation_checks.update(self.estimator.believed_m(sample), (x, y, z), self.now_s, applies=applies)
        self.estimator.fuse_vision(sample, self.now_s, self.sensor_state.motion.yaw_rad)

    def set_origin(self, origin: Origin) -> None:
        """Handle SET_GPS_GLOBAL_ORIGIN; ignored with GPS or when an origin is set."""
        if not self.estimator.uses_gps and self.estimator.origin_set_s is None:
            self.origin = origin
            self.estimator.set_origin(self.now_s)
            self.commander.texts.append(Text(Severity.CRITICAL, PREFLIGHT_TEXT.format(HORIZONTAL_UNSTABLE)))

    def arm_disarm(self, arm: float, force: float) -> Result | None:
        """Handle COMPONENT_ARM_DISARM; return None where PX4 sends no ACK."""
        result = self.commander.arm_disarm(arm, force, self.failsafe_flags)
        self._floor_z_m = self.estimator.position_m[2] if self.land_detector.landed else self._floor_z_m
        return result

    def set_mode(self, base_mode: int, main: int, sub: int) -> Result:
        """Handle DO_SET_MODE or SET_MODE; return the commander's answer."""
        wanted = MAIN_MODES.get(main) if main != AUTO_MAIN_MODE else AUTO_SUB_MODES.get(sub)
        if wanted is not None and self._refuses(wanted):
            return Result.TEMPORARILY_REJECTED
        return self.commander.set_mode(base_mode, main, sub, self.failsafe_flags)

    def take_off(self, above_sea_m: float = math.nan) -> Result:
        """Handle NAV_TAKEOFF to a height above sea (m; NaN: MIS_TAKEOFF_ALT above the ground); does not arm."""
        result = self.commander.choose(Mode.TAKEOFF, self.failsafe_flags)
        self._takeoff_z_m = self.origin.above_sea_m - above_sea_m
        if result is Result.ACCEPTED and self.commander.armed:
            self._piloted = None  # from here, also when it takes off already
            if math.isnan(above_sea_m):
                height_m = self.params["MIS_TAKEOFF_ALT"]
                self._say(Severity.INFO, f"Using default takeoff altitude: {height_m:.1f} m")
            elif self._takeoff_z_m > self.estimator.position_m[2]:
                self._say(Severity.CRITICAL, "Already higher than takeoff altitude")
        return result

    def land(self) -> Result:
        """Handle NAV_LAND: land at the current position."""
        if self._refuses(Mode.LAND):
            return Result.TEMPORARILY_REJECTED
        result = self.commander.choose(Mode.LAND, self.failsafe_flags)
        if result is Result.ACCEPTED:
            self._say(Severity.INFO, "Landing at current position")
        return result

    def return_home(self) -> Result:
        """Handle NAV_RETURN_TO_LAUNCH; return the commander's answer."""
        return self.commander.choose(Mode.RTL, self.failsafe_flags)

    def take_over(self) -> None:
        """Let a pilot with a remote control fly from now on, in Position mode."""
        self._remote = True
        self.commander.take(Mode.POSITION)

    def on_manual_control(self, sticks: tuple[float, float, float, float]) -> None:
        """Handle MANUAL_CONTROL: pitch, roll, throttle, yaw, -1..1."""
        if self.sticks.update(sticks, self.now_s):
            self.commander.on_sticks(self.failsafe_flags)
            self.sticks.moved = False

    def _refuses(self, mode: Mode) -> bool:
        refused = self.injected_faults.refuses(mode)
        if refused:
            self._say(Severity.CRITICAL, f"Switching to {mode.title} is currently not available")
        return refused

    def _say(self, severity: Severity, text: str) -> None:
        self.commander.texts.append(Text(severity, text + "\t"))

    def pop_texts(self) -> list[Text]:
        """Return the texts since the last call."""
        texts, self.commander.texts = self.commander.texts, []
        self.commander.events_told += len(texts)
        return texts

    # -- what it reports -------------------------------------------------------------------------

    @property
    def failsafe_flags(self) -> FailsafeFlags:
        """Return the present conditions from which the commander decides."""
        loss_s = self.params["COM_OF_LOSS_T"] + OFFBOARD_LATE_S
        return FailsafeFlags(
            now_s=self.now_s,
            landed=self.land_detector.landed,
            local_ok=self.estimator.local_ok,
            global_ok=self.estimator.global_ok,
            offboard_ok=self.now_s - self._setpoint_at_s <= loss_s,
            offboard_attitude=self.attitude_setpoint.attitude_control,
            remote=self._remote or self.sticks.there(self.now_s),
            sticks_moved=self.sticks.moved,
            battery_warning=self.battery.warning,
            preflight_failures=self._innovation_checks.failures(self.now_s),
        )

    @property
    def mode(self) -> Mode:
        """Return the mode that is flown, which a failsafe may have changed."""
        return self.commander.mode

    @property
    def armed(self) -> bool:
        """Return whether the vehicle is armed."""
        return self.commander.armed

    @property
    def system_status(self) -> SystemStatus:
        """Return MAV_STATE for HEARTBEAT.system_status."""
        return self.commander.system_status(self.failsafe_flags)

    @property
    def base_mode(self) -> int:
        """Return the bits of HEARTBEAT.base_mode."""
        return self.commander.base_mode(self.failsafe_flags)

    @property
    def landed_state(self) -> LandedState:
        """Return EXTENDED_SYS_STATE.landed_state, in flight by mode."""
        if self.land_detector.landed:
            return LandedState.ON_GROUND
        if self.mode is Mode.TAKEOFF and self.pilot.takes_off:
            return LandedState.TAKING_OFF
        if self.mode is Mode.LAND or (self.mode is Mode.RTL and self.pilot.descending):
            return LandedState.LANDING
        return LandedState.IN_AIR

    @property
    def lands(self) -> bool:
        """Return whether PX4 lands by itself, on command or by a failsafe."""
        mode = self.mode
        if mode is Mode.OFFBOARD or mode is Mode.HOLD or not self.armed:  # asked at every step: nearly always this
            return False
        return self._sinks_blind or self.landed_state is LandedState.LANDING

    @property
    def _sinks_blind(self) -> bool:
        """Return whether it descends level without a position: Descend, or Altitude mode without sticks."""
        return self.mode is Mode.DESCEND or (self.mode is Mode.ALTITUDE and not self.failsafe_flags.remote)

    @property
    def attitude_estimate_wxyz(self) -> Array:
        """Return the attitude as reported: the truth, turned by the errors of heading and horizon."""
        turned = quat.turned_about_z(self._yaw_error_rad, np.array(self.sensor_state.q_ned_frd_wxyz))
        if not self.estimator.horizon.perfect:
            w, x, y, z = turned.tolist()
            turned = np.array(self.estimator.horizon.believed((w, x, y, z)))
        return rolled(turned, self.injected_faults.tilt_off_rad)

    @property
    def _yaw_error_rad(self) -> float:
        return self.estimator.yaw_error_rad + self.injected_faults.heading_off_rad

    @property
    def estimate(self) -> Estimate:
        """Return position, velocity and heading as reported."""
        x, y, z = self.estimator.position_m
        vx, vy, vz = self.estimator.velocity_mps
        yaw = self.sensor_state.motion.yaw_rad + self._yaw_error_rad
        falls_mps2 = self.sensor_state.motion.acceleration_ned_mps2[2]
        return Estimate((x, y, z), (vx, vy, vz), yaw, self.estimator.local_ok, falls_mps2)

    @property
    def target(self) -> AttitudeSetpoint:
        """Return the setpoint for ATTITUDE_TARGET: the offboard one as sent, or the autopilot's own."""
        if self.mode is Mode.OFFBOARD:
            return self.attitude_setpoint
        return AttitudeSetpoint(self.pilot.q_wxyz, self.pilot.q_wxyz, None, self.pilot.signal, self.pilot.signal, True)

    @property
    def signal(self) -> float:
        """Return the motor signal 0..1 for the thrust setpoint, by the curve that PX4 assumes (THR_MDL_FAC)."""
        if not self.armed:
            return 0.0
        thrust = self.attitude_setpoint.signal if self.mode is Mode.OFFBOARD else self.pilot.signal
        return signal_for_thrust(thrust, self.params["THR_MDL_FAC"])

    # -- every step ------------------------------------------------------------------------------

    def step(self, now_s: float, sensor_state: SensorState, dt_s: float) -> ActuatorDemand:
        """Advance the autopilot by `dt_s` to `now_s`; return the demand for the airframe."""
        if not self.injected_faults.running:
            return self.injected_faults.lifeless(
                self._last_demand, np.array(self.sensor_state.rate_frd_radps), now_s - self.now_s
            )
        self.now_s, self.sensor_state = now_s, sensor_state
        self.estimator.in_air = self.armed and not self.land_detector.landed
        if self.armed:
            self._moved_s = now_s
        self.estimator.at_rest = not self.commander.flown or now_s - self._moved_s > AT_REST_S
        self.estimator.landing = self.lands
        self.estimator.step(now_s, sensor_state.motion, dt_s)
        self.battery.step(self.armed, dt_s)
        if now_s >= self._commander_due_s - 1e-9:
            self._commander_due_s = now_s + COMMANDER_PERIODS_S[self.commander_passes % 2]
            self.commander_passes += 1
            self._command()
        if now_s >= self._pilot_due_s - 1e-9:
            self._pilot_due_s = now_s + PILOT_PERIOD_S
            self._fly()
        return self._demand()

    def _speak_later(self) -> None:
        """Send the delayed texts that are due."""
        due = [text for at_s, text in self._later_texts if self.now_s >= at_s]
        self._later_texts = [(at_s, text) for at_s, text in self._later_texts if self.now_s < at_s]
        self.commander.texts += due

    def _command(self) -> None:
        self._speak_later()
        if self.estimator.navigation_failed and not self._failure_told:
            self._say(Severity.CRITICAL, "Navigation failure! Land and recalibrate sensors")
        self._failure_told = self.estimator.navigation_failed
        climb_controlled = self.mode is not Mode.OFFBOARD
        throttle = self.pilot.signal if climb_controlled else self.attitude_setpoint.signal
        down_mps = self.estimator.velocity_mps[2]
        uses_gps = self.estimator.uses_gps
        self.land_detector.step(self.now_s, self.armed, climb_controlled, throttle, down_mps, uses_gps)
        self._watch_range()
        self.commander.step(self.failsafe_flags)
        if self.mode is Mode.TAKEOFF and self.armed and self.pilot.takeoff_done and self.pilot.mode is Mode.TAKEOFF:
            self.commander.choose(Mode.HOLD, self.failsafe_flags)
        self._find_home()

    def _watch_range(self) -> None:
        """Invalidate the range finder for some seconds after a take-off and at a landing, as PX4 does."""
        if self.land_detector.landed != self._was_landed:
            self._was_landed = self.land_detector.landed
            start_s, end_s = self._timing.range_doubt_s(taking_off=not self._was_landed)
            self._range_doubted_s = (self.now_s + start_s, self.now_s + end_s)
        start_s, end_s = self._range_doubted_s
        doubted = start_s <= self.now_s < end_s
        self.estimator.range_ok = not doubted and self.pilot.range_finder and bool(int(self.params["EKF2_RNG_CTRL"]))

    def _find_home(self) -> None:
        """Set home to the position when the origin on earth is first known, and at each arming."""
        origin_s = self.estimator.origin_set_s
        known_s = HOME_KNOWN_S if self.estimator.uses_gps else (origin_s + 1.0 if origin_s is not None else math.inf)
        if self.now_s >= known_s and (self.home is None or (self.land_detector.landed and self.armed)):
            x, y, z = self.estimator.position_m
            self.home = Position(x, y, z)

    def _fly(self) -> None:
        now = self.estimate
        flying = (Mode.DESCEND if self._sinks_blind else self.mode, self.armed)
        if flying != self._piloted:
            self._piloted = flying
            self._enter(now)
        if self.armed and self.mode in PILOTED:
            self.pilot.step(now, self.now_s, self.land_detector.landed, PILOT_PERIOD_S)
        elif self.mode is not Mode.OFFBOARD or not self.armed:
            self.pilot.signal = 0.0

    @property
    def _floor_seen_m(self) -> float:
        """Return the floor's NED z in the estimate's frame: by the range finder, or where it was armed."""
        if not int(self.params["EKF2_RNG_CTRL"]):
            return self._floor_z_m
        return self.estimator.position_m[2] - self.sensor_state.motion.position_ned_m[2]

    def _enter(self, now: Estimate) -> None:
        start_s = max(self.now_s, self.commander.armed_at_s)
        if self.mode not in PILOTED:
            return
        flown = Mode.DESCEND if self._sinks_blind else self.mode
        self.pilot.enter(flown, now, start_s, self._floor_seen_m, not self.land_detector.landed)
        if self.mode is Mode.TAKEOFF and math.isfinite(self._takeoff_z_m):
            self.pilot.aim(min(self._takeoff_z_m, now.position_m[2]))
        if self.mode is Mode.RTL and self.home is not None and self.armed:
            self._start_return(now, self.home)

    def _start_return(self, now: Estimate, home: Position) -> None:
        """Start Return: next to home land there at once, from further away climb first."""
        away_m = math.hypot(home.x_m - now.position_m[0], home.y_m - now.position_m[1])
        height_m = home.z_m - now.position_m[2]
        if away_m > self.params["RTL_MIN_DIST"]:
            height_m = max(height_m, self.params["RTL_RETURN_ALT"])
        self.pilot.home_in(home, home.z_m - height_m)
        above_sea_m = self.origin.above_sea_m - home.z_m + height_m
        self._say(Severity.INFO, f"RTL: start return at {above_sea_m:.0f} m ({height_m:.0f} m above destination)")
        if away_m <= self.params["RTL_MIN_DIST"]:
            text = Text(Severity.INFO, "RTL: land at destination\t")
            self._later_texts.append((self.now_s + self._timing.return_text_s(), text))

    def _demand(self) -> ActuatorDemand:
        offboard = self.mode is Mode.OFFBOARD
        rates = self.attitude_setpoint.rate_frd_radps if offboard else None
        q_estimated = self.attitude_setpoint.q_wxyz if offboard else self.pilot.q_wxyz
        off_rad = (
            self._yaw_error_rad,
            self.injected_faults.roll_off_rad(self.now_s),
            *self.estimator.horizon.error_rad,
        )
        return self._demand_of(q_estimated, rates, off_rad, self.signal, self.armed)

    def _demand_of(
        self, q_estimated: Quad, rates: Triple | None, off_rad: Quad, signal: float, armed: bool
    ) -> ActuatorDemand:
        """Convert a setpoint from the estimated heading and horizon to the true ones; cached while unchanged."""
        inputs = (q_estimated, rates, off_rad, signal, armed)
        if self._demand_inputs != inputs:
            self._demand_inputs = inputs
            yaw_error_rad, roll_rad, *_ = off_rad
            horizon = self.estimator.horizon
            q_level = q_estimated if horizon.perfect else horizon.true_setpoint(q_estimated)
            q_true = rolled(quat.turned_about_z(-yaw_error_rad, np.array(q_level)), roll_rad)
            self._last_demand = ActuatorDemand(q_true, None if rates is None else np.array(rates), signal, armed)
        return self._last_demand


_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_STILL = (0.0, 0.0, 0.0)
