"""Targets of the benchmark, compared with the measurements. Pure."""

from dataclasses import dataclass

from benchmarks.arms import ArmsCost
from benchmarks.flights import Footprint, Latency
from benchmarks.flood import FloodCost
from benchmarks.onlookers import OnlookersCost
from benchmarks.steps import CycleCost, StepCost
from benchmarks.virtual import VirtualCost

LATENCY_MS = 1.0
RELAY_RATIO = 2.0
STEP_US = 250.0
BATCH_GAIN = 100.0
CYCLE_RATIO = 0.15
TIMES_REAL = 5000.0
COMMAND_S = 0.6
VEHICLE_S_PER_MINUTE = 1e6
"""Twice that where the processor's vectors hold several vehicles."""
CPU_SHARE = 0.25
MEMORY_MB = 90.0
"""Of the process, as it was before law and estimator were compiled, 88 MB with numpy 2.4 and CPython 3.11."""
ARMS_CYCLE_MS = 5.0
ARMS_LATE_RATIO = 1.1
"""No later. Two halves of a run without arms differ by up to 8 % on a busy machine."""


ONLOOKERS_SHARE = 0.10

FLOOD_SHARE = 0.05
LEAST_STATES_PER_S = 9.0
"""Ten are sent."""


@dataclass(frozen=True)
class Target:
    """One number and its bound."""

    name: str
    value: float
    bound: float
    unit: str = ""
    at_least: bool = False
    """The bound is from below."""

    @property
    def met(self) -> bool:
        """True if the number is on the right side of the bound, or equal to it."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound

    @property
    def wanted(self) -> str:
        """The bound in words, with its unit."""
        return f"{'at least' if self.at_least else 'at most'} {self.bound:g} {self.unit}".strip()


def latency_targets(latency: Latency) -> list[Target]:
    """Median, absolute and beside the relay."""
    at = f"at {latency.rate_hz:g} Hz"
    return [
        Target(f"frame to setpoint {at}, median", latency.service_us.median / 1e3, LATENCY_MS, "ms"),
        Target(f"frame to setpoint {at}, times the relay's", latency.ratio, RELAY_RATIO),
    ]


def step_targets(costs: list[StepCost]) -> list[Target]:
    """One vehicle's step, and how much cheaper a vehicle is in the largest batch."""
    targets = []
    for law in dict.fromkeys(cost.law for cost in costs):
        mine = sorted((cost for cost in costs if cost.law == law), key=lambda cost: cost.vehicles)
        one, many = mine[0], mine[-1]
        gain = one.vehicle_us / many.vehicle_us
        targets += [
            Target(f"{law}, one step, median", one.step_us, STEP_US, "us"),
            Target(f"{law}, {many.vehicles} vehicles: times cheaper a vehicle", gain, BATCH_GAIN, at_least=True),
        ]
    return targets


def cycle_targets(cost: CycleCost) -> list[Target]:
    """Return the target for the share of a cycle's time that compiled code leaves."""
    return [Target("estimator, law, conversion, limits after a sleep, of Python's", cost.ratio, CYCLE_RATIO)]


def virtual_targets(cost: VirtualCost) -> list[Target]:
    """Return the targets for one flight and for a sweep."""
    sweep = f"sweep of {cost.vehicles} on {cost.processes} processors"
    wanted = VEHICLE_S_PER_MINUTE * (1.0 if cost.side_by_side == 1 else 2.0)
    return [
        Target("one virtual flight, times real time", cost.times_real, TIMES_REAL, at_least=True),
        Target("companion simulate, processor time", cost.command_s, COMMAND_S, "s"),
        Target(f"{sweep}, vehicle-seconds a minute", cost.vehicle_s_per_minute, wanted, at_least=True),
    ]


def footprint_targets(footprint: Footprint) -> list[Target]:
    """Share of a core, and memory."""
    at = f"at {footprint.rate_hz:g} Hz"
    return [
        Target(f"CPU in flight {at}", 100.0 * footprint.cpu_share, 100.0 * CPU_SHARE, "% of a core"),
        Target(f"memory in flight {at}", footprint.memory_mb, MEMORY_MB, "MB"),
    ]


def arms_targets(cost: ArmsCost) -> list[Target]:
    """A bus cycle, and the tick beside it."""
    return [
        Target("arms' bus, one cycle of 8 servos, median", cost.cycle_ms.median, ARMS_CYCLE_MS, "ms"),
        Target("tick at 100 Hz begins, times as late with arms", cost.late_ratio, ARMS_LATE_RATIO),
    ]


def onlookers_targets(cost: OnlookersCost) -> list[Target]:
    """Return the targets for the growth of the median tick."""
    what = f"record and telemetry at {cost.rate_hz:g} Hz, of the tick's median"
    return [Target(what, 100.0 * cost.all_share, 100.0 * ONLOOKERS_SHARE, "%")]


def flood_targets(cost: FloodCost) -> list[Target]:
    """Return the targets for a flight that many pages look at."""
    what = f"{cost.pages} open pages at {cost.rate_hz:g} Hz"
    return [
        Target(f"{what}, of the tick's median", 100.0 * cost.share, 100.0 * FLOOD_SHARE, "%"),
        Target(f"{what}, frames dropped", cost.dropped, 0.0),
        Target(f"{what}, states a second on each", cost.states_per_s, LEAST_STATES_PER_S, at_least=True),
    ]
