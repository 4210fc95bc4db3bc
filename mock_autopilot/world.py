"""The simulated world on one clock: airframe, disturbances, arms, faults, and the autopilot that flies it.

Deterministic: the same configuration, seed and timed inputs give the same truth, bit by bit.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mock_autopilot.config import ArmsConfig, MockConfig
from mock_autopilot.faults.autopilot import injected_faults_of
from mock_autopilot.faults.catalogue import Part
from mock_autopilot.faults.fault import Fault, check_fits
from mock_autopilot.faults.schedule import FaultSchedule, FaultTransition
from mock_autopilot.faults.servos import bus_fault_of
from mock_autopilot.physics import plant, plant_one
from mock_autopilot.physics import quaternion_one as quat_one
from mock_autopilot.physics.airframe import ActuatorDemand, SensorState
from mock_autopilot.physics.arms import Arms
from mock_autopilot.physics.disturbance import Disturbance
from mock_autopilot.physics.downwash import Push
from mock_autopilot.physics.handling import Handling
from mock_autopilot.physics.plant import PlantState, Wrench
from mock_autopilot.physics.plant_one import OneActuation, OneState
from mock_autopilot.physics.quaternion_one import Four, Three
from mock_autopilot.physics.truth import Truth
from mock_autopilot.px4.estimator import RANGE_OFF_M, Motion
from mock_autopilot.px4.horizon import Horizon
from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.timing import Timing
from mock_autopilot.px4.vehicle import Vehicle
from mock_autopilot.servos.rack import ServoRack

STEP_S = 0.002
"""Physics and autopilot both run at 500 Hz of simulated time."""


class World:
    """The simulated room; `advance` is the only way time passes in it."""

    _one: OneState
    _arrays: PlantState | None
    """The same in arrays, once somebody has asked for them."""

    def __init__(self, config: MockConfig | None = None, seed: int = 1, step_s: float = STEP_S) -> None:
        config = config or MockConfig()
        self._step_s = step_s
        self._seed = np.random.SeedSequence(seed)
        vehicle_rng, force_rng = (np.random.default_rng(part) for part in self._seed.spawn(2))
        start = config.vehicle
        self._params = config.plant
        self._start = np.array(start.start_position_ned_m)
        self.state = plant.at_rest(self._start, start.start_yaw_rad)
        self._start_m = tuple(self._start.tolist())
        self._params = replace(config.plant, ground_z_m=max(config.plant.ground_z_m, float(self._start[2])))
        self._fixed_for, self._factors = self._params, plant_one.fixed_of(self._params, self._step_s)
        self.timing = Timing(seed)
        self._vehicle_rng, self._booted_s, self.boots = vehicle_rng, 0.0, 1
        self._estimator, self._horizon_rng = config.estimator, _horizon_rng(seed)
        self.vehicle = self._booted(ParamTable(config.px4.params), start.start_yaw_rad)
        self._full_thrust_n = self._params.max_thrust_n
        self._disturbance = Disturbance(config.disturbance.forces(), force_rng, self._step_s)
        self._steps = 0
        still = ActuatorDemand(self.state.q_ned_frd_wxyz, None, 0.0, motors_on=False)
        self.attitude_delay_s = start.attitude_delay_s
        self._attitude_line = deque([still] * round(start.attitude_delay_s / self._step_s))
        self._thrust_line = deque([still] * round(start.thrust_delay_s / self._step_s))
        self.external_wrench: Wrench = plant.no_wrench()
        """Force and angular acceleration from outside, for a payload or a gust; stays until it is changed."""
        self.air_push: Push | None = None
        """The downwash of other vehicles, with a fleet."""
        self.crashed = ""
        """The reason why this vehicle flies no more; empty while it can."""
        self._handling = Handling()
        self.servos: ServoRack | None = None
        self.arms: Arms | None = None
        """Both arms, or None without arms."""
        if config.arms.enabled:
            self._fit_arms(config.arms)
        self.faults = FaultSchedule(config.faults)
        """The injected faults and their times."""
        self.faults.observers.append(self._on_turn)
        self.observers: list[Callable[[Truth], None]] = []
        """Callbacks for the truth of every step, in order."""

    def _booted(self, params: ParamTable, yaw_rad: float) -> Vehicle:
        """Return an autopilot that has just booted; its errors are drawn again."""
        horizon = Horizon(self._estimator.attitude_error(), self._horizon_rng)
        range_off_m = float(self._horizon_rng.uniform(*RANGE_OFF_M)) if self._estimator.distance_sensor else None
        return Vehicle(params, self._vehicle_rng, self.timing, yaw_rad, horizon, range_off_m)

    def _fit_arms(self, config: ArmsConfig) -> None:
        self.servos = ServoRack(config.bus)
        self.arms = Arms(config.assembly(), self.servos, self._params.mass_kg, self.vehicle.params.trim_times_s)

    @property
    def time_s(self) -> float:
        """Return the simulated time since the start, when the autopilot booted for the first time."""
        return self._steps * self._step_s

    @property
    def uptime_s(self) -> float:
        """Return the autopilot's own time, since its last boot."""
        return self.time_s - self._booted_s

    @property
    def truth(self) -> Truth:
        """Return the vehicle's true state now."""
        place, velocity, q, rate, _, _, on_ground, _ = self._one
        every = np.array((*place, *velocity, *rate, *q))  # one array and views cost less than four
        return Truth(self.time_s, every[0:3], every[3:6], every[9:13], every[6:9], on_ground)

    @property
    def position_ned_m(self) -> Three:
        """Return the true position, in floats."""
        return self._one.position_ned_m

    @property
    def q_ned_frd_wxyz(self) -> Four:
        """Return the true attitude, in floats."""
        return self._one.q_ned_frd_wxyz

    @property
    def thrust_n(self) -> float:
        """Return the rotors' thrust."""
        return self._one.thrust_n

    @property
    def state(self) -> PlantState:
        """The airframe's full state, thrust and acceleration included; setting it carries the vehicle there."""
        if self._arrays is None:
            self._arrays = plant_one.in_arrays(self._one)
        return self._arrays

    @state.setter
    def state(self, state: PlantState) -> None:
        self._arrays = state
        self._one = plant_one.in_floats(state)

    def advance(self, to_s: float) -> None:
        """Let time pass step by step, as far as whole steps reach; never backwards."""
        while (self._steps + 1) * self._step_s <= to_s + 1e-9:
            self._step()
            if self.observers:
                truth = self.truth
                for observer in self.observers:
                    observer(truth)

    def _step(self) -> None:
        self._steps += 1
        self._update_faults()
        before = self._one
        demand = self.vehicle.step(self.uptime_s, self._sensor_state(before), self._step_s)
        actuation = self._delayed(demand)
        force, push = self._pushed(before)
        self._one = plant_one.moved(before, actuation, force, push, self._fixed)
        self._arrays = None
        self._handling.holds = self._handling.holds and not demand.motors_on
        if self._handling.holds:
            self.state = self._handling.carry(self.state, self.time_s)

    @property
    def _fixed(self) -> plant_one.Fixed:
        """The step's factors, found again when the airframe has changed."""
        if self._fixed_for is not self._params:
            self._fixed_for, self._factors = self._params, plant_one.fixed_of(self._params, self._step_s)
        return self._factors

    def _pushed(self, state: OneState) -> tuple[Three, Three]:
        """Return force (N, NED) and angular acceleration (rad/s^2, FRD) from outside, arms included."""
        x, y, z = self._disturbance.step_one(self.time_s)
        ex, ey, ez = self.external_wrench.force_ned_n.tolist()
        p, q, r = self.external_wrench.angular_frd_radps2.tolist()
        if self.arms is not None:
            (ax, ay, az), (ap, aq, ar) = self.arms.step_one(state, self._step_s)
            ex, ey, ez, p, q, r = ex + ax, ey + ay, ez + az, p + ap, q + aq, r + ar
        if self.air_push is not None:
            (ax, ay, az), (ap, aq, ar) = self.air_push.force_ned_n, self.air_push.angular_frd_radps2
            ex, ey, ez, p, q, r = ex + ax, ey + ay, ez + az, p + ap, q + aq, r + ar
        return (x + ex, y + ey, z + ez), (p, q, r)

    def crash(self, why: str) -> None:
        """End this vehicle's flights: the motors stop for good, and the autopilot says why."""
        self.crashed = self.crashed or why
        self.vehicle.commander.wreck(f"{why}: motors stopped")

    def inject(self, fault: Fault) -> None:
        """Inject a fault, from now on or at its own time; raise ValueError when there is no such part."""
        check_fits(fault, self.arms is not None)
        self.faults.inject(fault, self.time_s)

    def carry(self, north_east_down_m: Sequence[float], roll_pitch_yaw_rad: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Carry the vehicle to a pose and hold it there until it is armed; raise ValueError when it is armed."""
        if self.vehicle.armed:
            raise ValueError("carry rejected: the vehicle is armed; disarm it first")
        where = np.array([*north_east_down_m, *roll_pitch_yaw_rad])
        if where.shape != (6,) or not np.isfinite(where).all():
            raise ValueError("carry rejected: it takes NORTH EAST DOWN in m, and optionally ROLL PITCH YAW in rad")
        self._handling.take_to(where, self.state, self.time_s)

    def fault_rng(self) -> np.random.Generator:
        """Return a new generator for one part's faults, independent of all other random numbers."""
        return np.random.default_rng(self._seed.spawn(1)[0])

    def _update_faults(self) -> None:
        vehicle = self.vehicle
        self.faults.step(self.time_s, vehicle.armed, not self._one.on_ground, vehicle.lands)

    def _on_turn(self, turn: FaultTransition) -> None:
        if turn.fault.part is Part.SERVOS and turn.begins and self.servos is not None:
            self.servos.inject(bus_fault_of(turn.fault))
        if turn.fault.part is Part.AUTOPILOT:
            self._apply_lasting()
            if turn.begins and not turn.fault.lasts_s:
                self._apply_once(turn.fault)

    def _apply_lasting(self) -> None:
        before, after = (
            self.vehicle.injected_faults,
            injected_faults_of(self.faults.active(Part.AUTOPILOT), self._booted_s),
        )
        if after.thrust_share != before.thrust_share:
            self._params = replace(self._params, max_thrust_n=after.thrust_share * self._full_thrust_n)
        if before.powered and not after.powered:
            params, yaw_rad = self.vehicle.params, quat_one.yaw_of(self._one.q_ned_frd_wxyz)
            self.vehicle = self._booted(params, yaw_rad)
            self.vehicle.commander.wrecked = bool(self.crashed)
        if after.powered and not before.powered:
            self._booted_s, self.boots = self.time_s, self.boots + 1
        self.vehicle.injected_faults = after

    def _apply_once(self, fault: Fault) -> None:
        vehicle = self.vehicle
        if fault.how == "disarms":
            vehicle.commander.disarm("Disarmed by kill switch")
        elif fault.how == "pilot takes over":
            vehicle.take_over()
        else:
            vehicle.battery.drop_to(fault.magnitude)

    def _delayed(self, demand: ActuatorDemand) -> OneActuation:
        """Delay the setpoints by the transport delays; motors off takes effect at once."""
        self._attitude_line.append(demand)
        self._thrust_line.append(demand)
        attitude, thrust = self._attitude_line.popleft(), self._thrust_line.popleft()
        motors_on = demand.motors_on and thrust.motors_on and not self.crashed
        return plant_one.one_actuation(attitude.q_sp_wxyz, thrust.signal, attitude.rate_sp_frd_radps, motors_on)

    def _sensor_state(self, one: OneState) -> SensorState:
        (x, y, z), (x0, y0, z0), q = one.position_ned_m, self._start_m, one.q_ned_frd_wxyz
        place = (x - x0, y - y0, z - z0)
        motion = Motion(place, one.velocity_ned_mps, one.acceleration_ned_mps2, quat_one.yaw_of(q))
        return SensorState(motion, q, one.rate_frd_radps)


def _horizon_rng(seed: int) -> np.random.Generator:
    """Return the generator for the estimator's errors, independent of all other random numbers."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_HORIZON_KEY,)))


_HORIZON_KEY = 1_000_000
