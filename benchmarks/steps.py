"""Cost of the pure stages: one control step of each law, for one vehicle and for batches, and each stage alone."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from benchmarks.figures import calmest_median_us
from benchmarks.synthetic import AGE_S, Motion, motion
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import load_controller
from companion.control.compiled.pipeline import FlightPipeline
from companion.control.controller import ControlInput, Controller
from companion.control.pipeline import ControlPipeline, idle_setpoint
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState
from companion.estimation.frame_estimator import FrameEstimator
from companion.geometry.attitude import accel_of_setpoint, setpoint_of_accel
from companion.geometry.frames import euler_ned_frd_deg
from companion.guard.limits import limit_setpoint

LAWS = {"ET-NN": "practical", "PID": "pid"}
BATCHES = (1, 100, 10_000)
CYCLES = 400
SLEEPY_CYCLES = 100
PAUSE_S = 0.008
"""Sleep of a 100 Hz loop between its cycles."""
ESTIMATOR = "estimator, one frame"
STAGE = "ControlStage.fly: law, conversion, gate"


@dataclass(frozen=True)
class StepCost:
    """One control step of one law for a batch of vehicles."""

    law: str
    vehicles: int
    step_us: float

    @property
    def vehicle_us(self) -> float:
        """The time of one vehicle in the batch, us."""
        return self.step_us / self.vehicles


@dataclass(frozen=True)
class StageCost:
    """One stage of a cycle, one vehicle."""

    stage: str
    call_us: float


@dataclass(frozen=True)
class CycleCost:
    """Estimator, law, conversion and limits of one cycle after PAUSE_S asleep."""

    python_us: float
    flown_us: float
    """As in flight: compiled where there is compiled code."""

    @property
    def ratio(self) -> float:
        """Share that is left of Python's time."""
        return self.flown_us / self.python_us


def cycle_cost(config: CompanionConfig, rounds: int) -> CycleCost:
    """Measure both in turn, as a busy machine is never the same for long."""
    moving = motion((), 1.0 / config.control.rate_hz)
    each = [
        _after(_estimating(moving, config, compiled=compiled), flying(moving, config, compiled=compiled))
        for compiled in (False, True)
    ]
    turns = [[calmest_median_us(one, SLEEPY_CYCLES, 1, PAUSE_S) for one in each] for _ in range(rounds)]
    python_us, flown_us = (min(column) for column in zip(*turns, strict=True))
    return CycleCost(python_us, flown_us)


def _after(first: Callable[[int], object], second: Callable[[int], object]) -> Callable[[int], None]:
    def both(cycle: int) -> None:
        first(cycle)
        second(cycle)

    return both


def step_costs(config: CompanionConfig, rounds: int) -> Iterator[StepCost]:
    """Each law at each batch size; yields as they are done."""
    for law_name, file_name in LAWS.items():
        law = load_controller(file_name, config.vehicle_model(), 1.0 / config.control.rate_hz).law
        for vehicles in BATCHES:
            yield StepCost(law_name, vehicles, _step_us(law, vehicles, 1.0 / config.control.rate_hz, rounds))


def _step_us(law: Controller, vehicles: int, period_s: float, rounds: int) -> float:
    calls = CYCLES if vehicles == 1 else max(20, CYCLES // vehicles)
    moving = motion(() if vehicles == 1 else (vehicles,), period_s)
    inputs = [moving.input(cycle) for cycle in range(calls)]
    return calmest_median_us(_stepper(law, inputs), calls, rounds)


def _stepper(law: Controller, inputs: list[ControlInput]) -> Callable[[int], None]:
    memory = law.initial(inputs[0])

    def step(cycle: int) -> None:
        nonlocal memory
        memory, _ = law.step(memory, inputs[cycle])

    return step


def stage_costs(config: CompanionConfig, rounds: int) -> Iterator[StageCost]:
    """Every stage of a cycle by itself, and law, conversion and gate together; yields as they are done."""
    period_s = 1.0 / config.control.rate_hz
    moving = motion((), period_s)
    model, limits = config.vehicle.thrust_model(), config.limits.limits()
    inputs = [moving.input(cycle) for cycle in range(CYCLES)]
    setpoints = [moving.setpoint(cycle) for cycle in range(CYCLES + 1)]
    stages: dict[str, Callable[[int], object]] = {
        ESTIMATOR: _estimating(moving, config),
        "what was sent, in the law's terms": lambda c: accel_of_setpoint(setpoints[c], model),
        "conversion to attitude and thrust": lambda c: setpoint_of_accel(inputs[c].sent_accel_w_mps2, 0.3, model),
        "limit_setpoint": lambda c: limit_setpoint(setpoints[c + 1], setpoints[c], limits, period_s),
        "Euler angles for MAVSDK": lambda c: euler_ned_frd_deg(setpoints[c].q_w_flu_wxyz),
        STAGE: flying(moving, config),
    }
    for name, call in stages.items():
        yield StageCost(name, calmest_median_us(call, CYCLES, rounds))
    for name in (ESTIMATOR, STAGE):
        slept_us = calmest_median_us(stages[name], SLEEPY_CYCLES, min(rounds, 3), PAUSE_S)
        yield StageCost(f"{name}, after {1e3 * PAUSE_S:g} ms asleep", slept_us)


def _estimating(moving: Motion, config: CompanionConfig, *, compiled: bool = True) -> Callable[[int], None]:
    """Each round begins anew: time must not run backwards."""
    frames = [moving.frame(cycle) for cycle in range(CYCLES)]
    params = EstimatorParams(delay_s=config.mocap.delay_s)
    state, estimating = EstimatorState(), FrameEstimator(params)

    def step(cycle: int) -> None:
        nonlocal state
        state = estimator.step(state if cycle else EstimatorState(), frames[cycle], params)

    def compiled_step(cycle: int) -> None:
        nonlocal estimating
        estimating = estimating if cycle else FrameEstimator(params)
        estimating.step(frames[cycle])

    return compiled_step if compiled else step


def flying(moving: Motion, config: CompanionConfig, *, compiled: bool = True) -> Callable[[int], None]:
    """Law, conversion and gate for one vehicle, `compiled` as in flight; call it with a number below CYCLES."""
    period_s = 1.0 / config.control.rate_hz
    law = load_controller(LAWS["ET-NN"], config.vehicle_model(), period_s).law
    model, limits = config.vehicle.thrust_model(), config.limits.limits()
    stage, sent = (FlightPipeline if compiled else ControlPipeline)(law, model, limits), idle_setpoint(0.0)
    vehicles = [moving.vehicle(cycle) for cycle in range(CYCLES)]
    references = [moving.reference(cycle) for cycle in range(CYCLES)]

    def fly(cycle: int) -> None:
        nonlocal sent
        sent = stage.fly(vehicles[cycle], AGE_S, references[cycle], sent, period_s).limited.setpoint

    return fly
