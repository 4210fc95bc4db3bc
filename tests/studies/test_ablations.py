"""Ablations: one part of the law is gone, and nothing else is touched."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from companion.config.controller_config import EtnnFile, PredictionConfig, etnn_law, read_etnn
from companion.control.controller import ControlInput, VehicleModel
from companion.control.peers.linear_mpc import LinearMpc
from companion.core.interfaces import ConfigError
from companion.core.types import Array, Reference
from companion.studies.paper.ablations import Ablation, ablated, load_ablated, parts_of

VEHICLE = VehicleModel()
PRINTED = read_etnn("paper")
PREDICTING = PRINTED.model_copy(
    update={
        "prediction": PredictionConfig(enabled=True, observer_radps=3.0),
        "gains": PRINTED.gains.model_copy(update={"push_share": 0.5}),
    }
)


def swaying(cycles: int = 60) -> Iterator[ControlInput]:
    """A vehicle that sways about its reference by centimetres, whatever it is told."""
    level = np.array([1.0, 0.0, 0.0, 0.0])
    for cycle in range(cycles):
        angle = 0.1 * cycle + np.array([0.0, 1.0, 2.0])
        reference = Reference(np.zeros(3), 0.3 * np.cos(0.05 * cycle + np.arange(3.0)), np.zeros(3), 0.0)
        position, velocity = 0.04 * np.sin(angle), 0.1 * np.cos(angle)
        yield ControlInput(
            position_w_m=position,
            velocity_w_mps=velocity,
            q_w_flu_wxyz=level,
            rate_flu_radps=np.zeros(3),
            age_s=0.01,
            reference=reference,
            sent_accel_w_mps2=np.zeros(3),
            dt_s=0.01,
        )


def signals(file: EtnnFile) -> dict[str, Array]:
    """Return the law's signals, its events and its commands, one row a cycle."""
    law, rows, memory = etnn_law(file, VEHICLE, 0.01), [], None
    for now in swaying():
        memory = law.initial(now) if memory is None else memory
        memory, output = law.step(memory, now)
        rows.append(output.signals | {"event": output.event, "u": output.accel_w_mps2})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_without_its_network_nothing_is_learnt() -> None:
    assert np.abs(signals(PRINTED)["f_hat"][-1]).min() > 0.01
    assert not signals(ablated(PRINTED, Ablation.NETWORK))["f_hat"].any()


def test_without_its_trigger_every_cycle_sends_what_is_wanted() -> None:
    every = signals(ablated(PRINTED, Ablation.TRIGGER))
    assert signals(PRINTED)["event"].mean() < 1.0
    assert (every["event"] == 1.0).all()
    np.testing.assert_array_equal(every["u"], every["u_bar"])


def test_without_its_switching_term_the_command_is_alpha_2() -> None:
    printed, smooth = signals(PRINTED), signals(ablated(PRINTED, Ablation.SWITCHING))
    size = (PRINTED.gains.sigma + printed["kappa"] / PRINTED.gains.delta) * np.sign(np.abs(printed["y2"]))
    np.testing.assert_allclose(np.abs(printed["u_bar"] - printed["alpha2"]), size, atol=1e-12)
    assert size.max() > 0.05
    np.testing.assert_array_equal(smooth["u_bar"], smooth["alpha2"])


def test_without_its_compensator_the_errors_are_not_compensated() -> None:
    plain = signals(ablated(PRINTED, Ablation.COMPENSATOR))
    assert np.abs(signals(PRINTED)["iota1"][-1]).min() > 1e-3
    assert not plain["iota1"].any()
    assert not plain["iota2"].any()
    np.testing.assert_array_equal(plain["y1"], plain["x1"])


def test_without_its_prediction_the_law_sees_the_state_as_it_is() -> None:
    bare = ablated(PREDICTING, Ablation.PREDICTION)
    assert etnn_law(PREDICTING, VEHICLE, 0.01).preview_s > 0.0
    assert etnn_law(bare, VEHICLE, 0.01).preview_s == 0.0
    seen = signals(bare)
    np.testing.assert_array_equal(seen["x1"], [now.position_w_m for now in swaying()])


def test_the_observer_goes_with_the_prediction() -> None:
    """Leave what remains of push_share without effect: the command is what it is without any."""
    bare = ablated(PREDICTING, Ablation.PREDICTION)
    none = bare.model_copy(update={"gains": bare.gains.model_copy(update={"push_share": 0.0})})
    assert bare.gains.push_share > 0.0
    assert not signals(bare)["push"].any()
    np.testing.assert_array_equal(signals(bare)["u_bar"], signals(none)["u_bar"])


@pytest.mark.parametrize("prediction", ["", "enabled = true", "observer_radps = 2.0"])
def test_a_share_of_no_push_is_refused(tmp_path: Path, prediction: str) -> None:
    path = tmp_path / "mine.toml"
    text = 'law = "etnn"\n[gains]\npush_share = 0.5\n[prediction]\n'
    path.write_text(text + prediction, encoding="utf-8")
    sentence = f"^{path}: gains.push_share = 0.5: must be 0 unless a push is observed, which needs "
    with pytest.raises(ConfigError, match=sentence) as caught:
        read_etnn(str(path))
    assert "\n" not in str(caught.value)
    path.write_text(text + "enabled = true\nobserver_radps = 2.0", encoding="utf-8")
    without = load_ablated(str(path), VEHICLE, 0.01, Ablation.PREDICTION)
    assert without.law.preview_s == 0.0


def test_without_its_push_observer_nothing_pushes_as_far_as_the_law_knows() -> None:
    whole, blind = signals(PREDICTING), signals(ablated(PREDICTING, Ablation.PUSH))
    assert np.abs(whole["push"][-1]).min() > 0.01
    assert not blind["push"].any()
    never = PRINTED.model_copy(update={"prediction": PredictionConfig(enabled=True)})
    np.testing.assert_array_equal(blind["u_bar"], signals(never)["u_bar"])


@pytest.mark.parametrize(
    ("ablation", "touched"),
    [
        (Ablation.NETWORK, {"gains.gamma_v0", "gains.gamma_v1"}),
        (Ablation.TRIGGER, {"gains.every_cycle"}),
        (Ablation.SWITCHING, {"gains.switching"}),
        (Ablation.COMPENSATOR, {"gains.compensation"}),
        (Ablation.PREDICTION, {"prediction.enabled"}),
        (Ablation.PUSH, {"prediction.observer_radps", "gains.push_share"}),
    ],
)
def test_nothing_else_is_touched(ablation: Ablation, touched: set[str]) -> None:
    before, after = PREDICTING, ablated(PREDICTING, ablation)
    changed = {
        f"{table}.{key}"
        for table in ("gains", "prediction")
        for key, value in before.model_dump()[table].items()
        if value != after.model_dump()[table][key]
    }
    assert changed == touched
    assert after.model_dump(exclude={"gains", "prediction"}) == before.model_dump(exclude={"gains", "prediction"})


def test_an_unstable_set_is_loaded_and_says_what_it_lacks() -> None:
    loaded = load_ablated("paper", VEHICLE, 0.01, Ablation.SWITCHING)
    assert loaded.name == "paper without switching"
    assert loaded.error_limits == PRINTED.error_limits
    assert loaded.description == PRINTED.description


def test_only_the_et_nn_law_has_these_parts() -> None:
    with pytest.raises(ConfigError, match=r"pid\.toml: law = 'pid': must be 'etnn' here$"):
        load_ablated("pid", VEHICLE, 0.01, Ablation.NETWORK)


def test_peers_have_a_trigger_and_a_prediction_and_mpc_only_the_trigger() -> None:
    assert [[*parts_of(law)] for law in ("indi", "mpc", "pid")] == [
        [Ablation.TRIGGER, Ablation.PREDICTION],
        [Ablation.TRIGGER],
        [],
    ]
    every = load_ablated("mpc", VEHICLE, 0.01, Ablation.TRIGGER)
    assert isinstance(every.law, LinearMpc)
    assert every.law.gains.send_from_mps2 == 0.0
    assert every.name == "mpc without trigger"
    blind = load_ablated("indi", VEHICLE, 0.01, Ablation.PREDICTION).law
    assert blind.preview_s == 0.0
    with pytest.raises(ConfigError, match=r"mpc\.toml: its law has no prediction to leave out$"):
        load_ablated("mpc", VEHICLE, 0.01, Ablation.PREDICTION)
