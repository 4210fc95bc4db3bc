"""Experiments as files: trajectory, arms, the companion's configuration, and the simulated vehicle and room."""

import pickle
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
from pydantic import Field

from companion.arms.feedforward import (
    force_accel_b_mps2,
    leads_of,
    tilt_accel_b_mps2,
    trimmed_b_radps2,
    turning_b_radps2,
)
from companion.arms.planning import Plan, plan
from companion.arms.trajectory import JointTrajectory
from companion.config.arm_files import motion_named
from companion.config.arms_config import ArmsConfig, Feedforward
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.config.locations import named_file, names_in
from companion.config.toml_files import Section, read_toml, validate
from companion.control.controller import VehicleModel
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.estimation.estimator import EstimatorParams
from companion.guard.guard import AgeRange
from companion.simulation.compiled_arms import driven
from companion.simulation.mission import Mission, mission_of
from companion.simulation.simulation import Pilot
from companion.simulation.virtual_ground import GroundRole
from companion.simulation.virtual_link_ends import LinkTiming, measured_up_age_s
from companion.simulation.virtual_world import STEP_S, Carried, VirtualVehicle
from companion.trajectories.reference import Ellipse, FigureEight, LapTiming, Trajectory
from mock_autopilot.config import MockConfig, MockConfigError
from mock_autopilot.impairment.sentences import Directions
from mock_autopilot.physics.arm_table import table_of
from mock_autopilot.px4.params import ParamTable


def arm_feedforward_b_mps2(config: CompanionConfig, arms: ArmsConfig, motion: JointTrajectory, time_s: Array) -> Array:
    """Return the acceleration (n, 3), body frame, that the motion causes when a setpoint sent at `time_s` (n,) acts.

    `time_s` counts from the motion's start, in steps of the control period. The torque of the arms' initial pose is
    assumed to be trimmed out by the autopilot.
    """
    if arms.feedforward is Feedforward.OFF:
        return np.zeros((len(time_s), 3))
    model, airframe, leads = arms.model(), config.airframe(), leads_of(config.vehicle_model(), arms.servo_lag_s)
    across, upward = motion.at(time_s + leads.across_s), motion.at(time_s + leads.upward_s)
    force = force_accel_b_mps2(model, airframe, across, upward)
    if arms.feedforward is Feedforward.FORCE:
        return force
    turning = turning_b_radps2(model, airframe, motion.at(time_s + leads.turning_s))
    trimmed, before = np.empty_like(turning), turning[0]
    for row, now in enumerate(turning):
        before = trimmed_b_radps2(before, now, airframe, 1.0 / config.control.rate_hz)
        trimmed[row] = before
    return np.asarray(force + tilt_accel_b_mps2(turning - trimmed, airframe))


class HorizonError(StrEnum):
    """Error of the autopilot's horizon: none, a random walk of 1.2 degrees, or as recorded in a flight of PX4."""

    PERFECT = "perfect"
    RANDOM = "random"
    PX4_A = "px4-a"
    PX4_B = "px4-b"
    PX4_TIGHT = "px4-tight"


class CurveConfig(Section):
    """Trajectory: a closed curve at constant height, from rest to rest."""

    curve: Literal["ellipse", "figure8"] = Field(description="shape of the path")
    semi_axes_m: tuple[float, float] = Field(description="semi-axes along x and y, m")
    period_s: float = Field(gt=3.0, le=120.0, description="time of a lap at full speed, s")
    laps: int = Field(2, ge=1, le=20, description="number of laps")
    ramp_s: float = Field(4.0, gt=0.5, le=20.0, description="time from rest to full speed, and back, s")
    height_m: float = Field(1.2, ge=0.3, le=5.0, description="height in W, m")

    def trajectory(self) -> Trajectory:
        """Return the trajectory, centred over the room's origin."""
        kind = Ellipse if self.curve == "ellipse" else FigureEight
        timing = LapTiming(self.period_s, self.laps, self.ramp_s)
        return kind(np.array([0.0, 0.0, self.height_m]), self.semi_axes_m, timing)


class ExperimentFile(Section):
    """Experiment file, as in config/experiments/."""

    title: str = Field(description="heading of the experiment in reports")
    trajectory: CurveConfig
    settle_s: float = Field(6.0, ge=0.0, le=60.0, description="time of the hold at the start before the trajectory, s")
    arms: str = Field("swing", description="a motion of config/arms/, a file, or off")
    companion: CompanionConfig = Field(
        CompanionConfig(arms=ArmsConfig()),
        description="configuration of the companion: its tables, as [companion.vehicle]",
    )
    mock: dict[str, Any] = Field(default_factory=dict, description="the vehicle and its room, as in config/mock.toml")


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Experiment ready to be flown, by any law."""

    name: str
    title: str
    trajectory: Trajectory
    settle_s: float
    arms: Plan | None
    """Motion of the arms; None: they stay stowed, and the vehicle flies as if it had none."""
    companion: CompanionConfig
    mock: MockConfig
    link_s: float = 0.0
    """Time that transport and event loops add to each of the mock's delays, s."""
    radio: Directions | None = None
    """Impairments of the link to a law on the ground; None: the law is on board."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the fields alone: where it is loaded once more there is one already, with all it has computed."""
        return _loaded, (pickle.dumps({field.name: getattr(self, field.name) for field in fields(self)}),)

    @property
    def period_s(self) -> float:
        """Period of the control cycle, s."""
        return 1.0 / self.companion.control.rate_hz

    def with_radio(self, radio: Directions | None) -> "Scene":
        """Return the same with the law on the ground, and these impairments of its link; None: on board."""
        return replace(self, radio=radio)

    @cached_property
    def up_age_s(self) -> float:
        """Usual time from a command of the law to its use by the vehicle, as measured before a flight; 0 on board."""
        if self.radio is None:
            return 0.0
        measured_s = measured_up_age_s(self.radio, LinkTiming(beat_s=self.companion.law.link.beat_s), self.period_s)
        return measured_s if np.isfinite(measured_s) else self.companion.law.link.delay_s

    def vehicle_model(self) -> VehicleModel:
        """Return the vehicle as its law is to know it: for one on the ground the state is older."""
        model = self.companion.vehicle_model()
        return replace(model, mocap_age_s=model.mocap_age_s + self.up_age_s) if self.up_age_s else model

    def mission(self, preview_s: float) -> Mission:
        """Return the mission for a law that looks `preview_s` ahead."""
        known = self._missions.get(preview_s)
        if known is None:
            known = mission_of(self.trajectory, preview_s + self.up_age_s, self.settle_s, self.period_s)
            self._missions[preview_s] = known
        return known

    @cached_property
    def _missions(self) -> dict[float, Mission]:
        return {}

    def pilot(self, controller: LoadedController, feedforward: Feedforward | None = None) -> Pilot:
        """Return the companion with this law; `feedforward` overrides the configuration's."""
        c = self.companion
        return Pilot(
            law=controller.law,
            thrust=c.vehicle.thrust_model(),
            limits=c.limits.limits(),
            estimator=EstimatorParams(delay_s=c.mocap.delay_s),
            period_s=self.period_s,
            feedforward_b_mps2=self._known(feedforward),
            horizon=c.control.horizon_rules(c.safety.tilt_apart_rad),
            ground=None if self.radio is None else self._ground_role(self.radio),
        )

    def _ground_role(self, radio: Directions) -> GroundRole:
        safety = self.companion.safety
        beat_s, silent_s = self.companion.law.link.beat_s, safety.command_silent_s
        return GroundRole(
            links=(radio,),
            timing=LinkTiming(beat_s=beat_s, up_age_s=self.up_age_s, silent_s=silent_s),
            level=AgeRange(safety.command_coast_s, safety.command_level_s),
        )

    def _known(self, feedforward: Feedforward | None) -> Any:
        config = self.companion.arms
        if self.arms is None or config is None:
            return None
        if feedforward is not None:
            config = config.model_copy(update={"feedforward": feedforward})
        return arm_feedforward_b_mps2(self.companion, config, self.arms.trajectory, self._cycle_s + self.up_age_s)

    def vehicle(self) -> VirtualVehicle:
        """Return the simulated vehicle and its room."""
        m = self.mock
        return VirtualVehicle(
            plant=m.plant,
            mocap_delay_s=m.qualisys.delay_s + self.link_s,
            attitude_delay_s=m.vehicle.attitude_delay_s + self.link_s,
            thrust_delay_s=m.vehicle.thrust_delay_s + self.link_s,
            noise_m=m.qualisys.noise_m,
            noise_rad=m.qualisys.noise_rad,
            forces=m.disturbance.forces(),
            attitude_error=m.estimator.attitude_error(),
            arms=self._carried,
        )

    def with_bandwidth(self, radps: float) -> "Scene":
        """Return the same with another attitude loop in roll and pitch, which the companion knows."""
        yaw = self.mock.plant.attitude_bandwidth_radps[2]
        plant = replace(self.mock.plant, attitude_bandwidth_radps=(radps, radps, yaw))
        vehicle = self.companion.vehicle.model_copy(update={"attitude_bandwidth_radps": radps})
        companion = self.companion.model_copy(update={"vehicle": vehicle})
        return replace(self, companion=companion, mock=self.mock.model_copy(update={"plant": plant}))

    def with_horizon(self, error: HorizonError) -> "Scene":
        """Return the same with another error of the autopilot's horizon."""
        change: dict[str, object] = {"attitude_error_rad": 0.0}
        if error is not HorizonError.PERFECT:
            change = {"attitude_error_source": str(error), "attitude_error_rad": None}
        estimator = self.mock.estimator.model_copy(update=change)
        return replace(self, mock=self.mock.model_copy(update={"estimator": estimator}))

    def uncorrected(self) -> "Scene":
        """Return the same with a companion that does not correct the autopilot's horizon."""
        control = self.companion.control.model_copy(update={"horizon_correction": False})
        return replace(self, companion=self.companion.model_copy(update={"control": control}))

    @property
    def corrects(self) -> bool:
        """Return True if the autopilot's horizon errs and the companion corrects it."""
        return self.companion.control.horizon_correction and self.vehicle().attitude_error.present

    @property
    def _cycle_s(self) -> Any:
        """Time of each cycle since the begin of the flight, s."""
        return np.arange(round((self.settle_s + self.trajectory.duration_s) / self.period_s)) * self.period_s

    @cached_property
    def _carried(self) -> Carried | None:
        if self.arms is None:
            return None
        goals_rad = self.arms.trajectory.at(self._cycle_s).position_rad
        table = table_of(self.mock.arms, goals_rad, self.period_s, STEP_S, driven)
        return Carried(table, self.mock.arms.inertia_kgm2, ParamTable(self.mock.px4.params).trim_times_s)


@lru_cache(maxsize=16)
def _loaded(values: bytes) -> Scene:
    return Scene(**pickle.loads(values))  # noqa: S301


def experiment_names() -> list[str]:
    """Return the names of the experiments in config/experiments/, sorted."""
    return names_in("experiments")


def load_scene(name: str) -> Scene:
    """Return an experiment of config/experiments/, or of a TOML file; ConfigError with one sentence for any error."""
    path = named_file("experiments", name)
    if path is None:
        raise ConfigError(f"unknown experiment {name!r}: give a TOML file or one of {', '.join(experiment_names())}")
    file = validate(ExperimentFile, read_toml(path), path)
    try:
        mock = MockConfig.from_dict(file.mock)
    except MockConfigError as error:
        raise ConfigError(f"{path}: mock.{error}") from None
    trajectory = file.trajectory.trajectory()
    arms = planned_arms(file.arms, file.companion.arms, trajectory.duration_s + file.settle_s)
    return Scene(
        name=path.stem,
        title=file.title,
        trajectory=trajectory,
        settle_s=file.settle_s,
        arms=arms,
        companion=file.companion,
        mock=mock,
    )


def planned_arms(name: str, config: ArmsConfig | None, duration_s: float) -> Plan | None:
    """Return a motion of `duration_s`, begun from the stowed pose; None for `off`. Raises ArmError or ConfigError."""
    if name == "off":
        return None
    if config is None:
        raise ConfigError(f"arms {name}: this vehicle has no arms, its configuration has no [arms]")
    model, start = config.model(), config.stow_rad()
    motion = motion_named(name, duration_s).trajectory(model, start)
    return plan(model, motion, start, via_rad=(config.home_rad(),))
