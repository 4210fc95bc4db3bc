"""Another law takes over in the air: nothing jumps, it knows the disturbance, and soon it has the vehicle to itself."""

from typing import Any

import numpy as np
import pytest

from companion.control.controller import ControlInput, ControlOutput, SeededLaw, VehicleModel
from companion.control.delay_predictor import Predictor
from companion.control.etnn import Etnn, compensation_at_rest
from companion.control.gains import EtnnGains, PidGains
from companion.control.law_switch import BLEND_S, HELD_S, LawSwitch
from companion.control.pid import Pid
from companion.control.pipeline import ControlPipeline, PipelineOutput, idle_setpoint
from companion.core.types import Array, AttitudeThrust, Reference, VehicleState
from companion.geometry.attitude import ThrustModel, accel_of_setpoint
from companion.guard.limits import Limits

MODEL = ThrustModel(4.85, 9.8, 0.5, 0.0)
DT_S = 0.01
LIMITS = Limits(0.5, 0.05, 0.9, 6.0, 5.0)
WIND_W_MPS2 = np.array([0.6, -0.4, 0.1])


class Constant:
    """A law that always wants the same, and says so rarely."""

    preview_s = 0.0

    def __init__(self, accel_w_mps2: Any) -> None:
        self.accel_w_mps2 = np.array(accel_w_mps2)

    def initial(self, first: ControlInput) -> Any:  # noqa: ARG002
        return 0

    def step(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:  # noqa: ARG002
        return memory + 1, ControlOutput(self.accel_w_mps2, np.array([float(memory == 0)]), {})


class Seeded(Constant):
    """It counters what it is told."""

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> Any:  # noqa: ARG002
        self.accel_w_mps2 = -known_disturbance_w_mps2
        return 0


class Observing(Constant):
    """It finds the wind by itself within a second."""

    def step(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:  # noqa: ARG002
        return memory + 1, ControlOutput(-min(DT_S * memory, 1.0) * WIND_W_MPS2, np.array([1.0]), {})


def fly(stage: ControlPipeline, cycles: int, sent: AttitudeThrust) -> list[PipelineOutput]:
    """Fly at rest after `sent`, as by a vehicle whose rotors and wind are in balance."""
    zero = np.zeros(3)
    reference = Reference(zero, zero, zero, 0.0)
    flown = []
    for cycle in range(cycles):
        vehicle = VehicleState(DT_S * cycle, zero, zero, sent.q_w_flu_wxyz, zero)
        asked = stage.fly(vehicle, 0.01, reference, sent, DT_S)
        sent = asked.limited.setpoint
        flown.append(asked)
    return flown


def sent_w_mps2(asked: PipelineOutput) -> Array:
    return accel_of_setpoint(asked.limited.setpoint, MODEL)


def switched(law: Any, cycles: int) -> tuple[PipelineOutput, list[PipelineOutput]]:
    """Switch from a law that compensates the wind to `law`; return the last cycle before and the cycles after."""
    stage = ControlPipeline(Constant(-WIND_W_MPS2), MODEL, LIMITS)
    last = fly(stage, 800, idle_setpoint(0.0))[-1]
    stage.switch(law)
    return last, fly(stage, cycles, last.limited.setpoint)


@pytest.mark.parametrize("law", [Constant((-1.0, 0.5, 0.0)), Seeded((0.0, 0.0, 0.0))], ids=["unseeded", "seeded"])
def test_the_first_command_of_the_new_law_is_the_last_of_the_old_one(law: Any) -> None:
    last, after = switched(law, 2)
    assert after[0].begun
    np.testing.assert_allclose(sent_w_mps2(after[0]), sent_w_mps2(last), atol=1e-9)


def test_a_seeded_law_counters_at_once_what_the_old_one_did() -> None:
    assert isinstance(Seeded(np.zeros(3)), SeededLaw)
    assert not isinstance(Constant(np.zeros(3)), SeededLaw)
    _, after = switched(Seeded(np.zeros(3)), round(2.0 * BLEND_S / DT_S))
    for asked in after:
        np.testing.assert_allclose(sent_w_mps2(asked), -WIND_W_MPS2, atol=2e-3)
    done = round(BLEND_S / DT_S)
    assert all(asked.law_output.event.all() for asked in after[:done])
    assert not after[done + 1].law_output.event.any(), "and then its own word on what is worth sending"


CALM = EtnnGains.model_validate(
    {"power_regularisation": 0.02, "boundary_layer_mps": 0.8, "gamma_v0": [4.0] * 4, "gamma_v1": [4.0] * 5}
)


def test_the_baseline_counters_it_as_well() -> None:
    _, after = switched(Pid(PidGains()), 100)
    for asked in after:
        np.testing.assert_allclose(sent_w_mps2(asked), -WIND_W_MPS2, atol=5e-3)


def test_where_its_compensation_rests_the_seeded_law_counters_it() -> None:
    """Without an observer f_hat has it all, and x_1 = iota_1."""
    law, zero = Etnn(CALM), np.zeros(3)
    iota1, _ = compensation_at_rest(WIND_W_MPS2, CALM)
    reference = Reference(zero, zero, zero, 0.0)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    now = ControlInput(
        position_w_m=iota1,
        velocity_w_mps=zero,
        q_w_flu_wxyz=level,
        rate_flu_radps=zero,
        age_s=0.01,
        reference=reference,
        sent_accel_w_mps2=-WIND_W_MPS2,
        dt_s=DT_S,
    )
    memory = law.initial_with(now, WIND_W_MPS2)
    for _ in range(100):
        memory, output = law.step(memory, now)
    np.testing.assert_allclose(output.signals["f_hat"], WIND_W_MPS2, atol=0.01)
    np.testing.assert_allclose(output.signals["u_bar"], -WIND_W_MPS2, atol=0.01)


def test_with_an_observer_the_law_shares_it_between_push_and_network() -> None:
    vehicle = VehicleModel(mocap_age_s=0.01)
    gains = CALM.model_copy(update={"push_share": 0.8})
    law = Etnn(gains, Predictor(vehicle, DT_S, 0.1, 0.1, observer_radps=7.0))
    _, after = switched(law, 1)
    signals = after[0].law_output.signals
    np.testing.assert_allclose(signals["u_bar"], -WIND_W_MPS2, atol=0.1)
    np.testing.assert_allclose(signals["push"], WIND_W_MPS2, atol=0.1)


def test_what_an_unseeded_law_does_not_know_is_held_for_it_and_fades_slowly() -> None:
    _, after = switched(Constant(np.zeros(3)), round(1.1 * HELD_S / DT_S))
    sent = np.array([sent_w_mps2(asked) for asked in after])
    np.testing.assert_allclose(sent[round(BLEND_S / DT_S)], -WIND_W_MPS2, atol=0.02)
    steps = np.diff(sent, axis=0)
    assert (steps[:, 0] >= -1e-9).all(), "in one direction"
    assert np.abs(steps[:, 0]).max() < 0.025 * 0.6, "by a fiftieth of it at most, and no more often"
    assert sum(asked.law_output.event.any() for asked in after) < BLEND_S / DT_S + 55
    np.testing.assert_allclose(sent[-1], np.zeros(3), atol=1e-5)
    assert not after[-1].law_output.event.any()


def test_a_law_that_finds_the_wind_by_itself_is_not_helped_any_longer() -> None:
    _, after = switched(Observing(np.zeros(3)), 400)
    sent = np.array([sent_w_mps2(asked) for asked in after])
    np.testing.assert_allclose(sent[-1], -WIND_W_MPS2, atol=0.02)
    most = np.linalg.norm(sent, axis=1).max() / np.linalg.norm(WIND_W_MPS2)
    assert most < 1.5, "twice would be both all the time"


def test_at_lift_off_nothing_is_known_and_a_switch_on_the_ground_is_no_switch() -> None:
    stage = ControlPipeline(Constant(-WIND_W_MPS2), MODEL, LIMITS)
    last = fly(stage, 800, idle_setpoint(0.0))[-1]
    law = Seeded((0.3, 0.0, 0.0))
    stage.switch(law)
    stage.forget()
    after = fly(stage, 30, last.limited.setpoint)
    np.testing.assert_array_equal(law.accel_w_mps2, [0.3, 0.0, 0.0])
    np.testing.assert_allclose(after[-1].law_output.accel_w_mps2, [0.3, 0.0, 0.0])


def test_a_heading_of_the_new_laws_own_is_kept_while_it_takes_over() -> None:
    zero = np.zeros(3)
    given = ControlInput(
        position_w_m=zero, velocity_w_mps=zero, q_w_flu_wxyz=np.array([1.0, 0.0, 0.0, 0.0]), rate_flu_radps=zero,
        age_s=0.0, reference=Reference(zero, zero, zero, 0.5), sent_accel_w_mps2=zero, dt_s=DT_S,
    )  # fmt: skip
    for own_rad, flown_rad in ((0.25, 0.25), (None, 0.5)):
        output, _ = LawSwitch(zero).blend(ControlOutput(zero, np.array([1.0]), {}, yaw_rad=own_rad), given)
        assert output.heading_rad(given.reference) == flown_rad
