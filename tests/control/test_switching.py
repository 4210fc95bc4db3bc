"""Another law takes over in the air: nothing jumps, and after a while the new one has the vehicle to itself."""

from typing import Any

import numpy as np

from companion.control.attitude import ThrustModel, accel_of_setpoint
from companion.control.controller import ControlInput, ControlOutput
from companion.control.limits import Limits
from companion.control_stage import SWITCH_S, Asked, ControlStage
from companion.types import Array, Reference, VehicleState

MODEL = ThrustModel(4.85, 9.8, 0.5, 0.0)
DT_S = 0.01


class Constant:
    """A law that always wants the same, and says so rarely."""

    preview_s = 0.0

    def __init__(self, accel_w_mps2: tuple[float, float, float]) -> None:
        self.accel_w_mps2 = np.array(accel_w_mps2)

    def initial(self, first: ControlInput) -> Any:  # noqa: ARG002
        return 0

    def step(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:  # noqa: ARG002
        return memory + 1, ControlOutput(self.accel_w_mps2, np.array([float(memory == 0)]), {})


def fly(stage: ControlStage, cycles: int) -> list[Asked]:
    zero = np.zeros(3)
    reference = Reference(zero, zero, zero, 0.0)
    flown = []
    for cycle in range(cycles):
        vehicle = VehicleState(DT_S * cycle, zero, zero, np.array([1.0, 0.0, 0.0, 0.0]), zero)
        asked = stage.fly(vehicle, 0.01, reference, DT_S)
        stage.sent = asked.gated.setpoint
        flown.append(asked)
    return flown


def sent_w_mps2(asked: Asked) -> Array:
    return accel_of_setpoint(asked.gated.setpoint, MODEL)


def switched() -> tuple[Asked, list[Asked]]:
    limits = Limits(0.5, 0.05, 0.9, 6.0, 5.0)
    stage = ControlStage(Constant((1.0, -0.5, 0.4)), MODEL, limits)
    last = fly(stage, 200)[-1]
    stage.switch(Constant((-1.0, 0.5, 0.0)))
    return last, fly(stage, int(1.5 * SWITCH_S / DT_S))


def test_the_first_command_of_the_new_law_is_the_last_of_the_old_one() -> None:
    last, after = switched()
    assert after[0].begun
    np.testing.assert_allclose(sent_w_mps2(after[0]), sent_w_mps2(last), atol=1e-9)


def test_between_them_the_command_moves_in_one_direction_and_slowly() -> None:
    _, after = switched()
    sent = np.array([sent_w_mps2(asked) for asked in after])
    steps = np.diff(sent, axis=0)
    assert (steps[:, 0] <= 1e-9).all()
    fastest = 0.5 * np.pi / SWITCH_S * 2.0 * DT_S  # of a cosine that falls by 2 m/s^2
    assert np.abs(steps[:, 0]).max() < 1.05 * fastest


def test_in_the_end_the_new_law_has_the_vehicle_to_itself() -> None:
    _, after = switched()
    done = int(SWITCH_S / DT_S)
    np.testing.assert_allclose(sent_w_mps2(after[done + 1]), [-1.0, 0.5, 0.0], atol=1e-9)
    assert not after[done + 1].output.event.any(), "and its own word on what is worth sending"
    assert all(asked.output.event.all() for asked in after[: done - 1])
