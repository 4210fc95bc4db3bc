"""One vehicle looked at closely: the true friction, what the network knows of it, the figures and the page."""

import re
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from companion.control.gains import EtnnGains
from companion.core.types import Array
from companion.studies.paper.ablations import Ablation
from companion.studies.paper.campaign import Flown, Item, fly, scene_of
from companion.studies.paper.campaign_detail import Detail, delta_w_mps2, friction_w_mps2, learnt, look_closely
from companion.studies.paper.campaign_plots import Drawn, draw_experiment
from companion.studies.paper.campaign_report import Chapter, Source, page
from companion.studies.paper.descriptions import facts_of
from companion.studies.paper.network_and_proof import closer
from mock_autopilot.physics.plant import PlantParams
from tests.studies.short_experiments import short_experiment

pytestmark = pytest.mark.slow

PLANT = PlantParams(mass_kg=5.0, viscous_npm=(0.5, 0.5, 1.0), quadratic_npm2=(0.2, 0.2, 0.4), coulomb_n=(0.5, 0.5, 0.5))


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> str:
    """With arms, and a steady push alone."""
    path = tmp_path_factory.mktemp("experiment") / "short.toml"
    return str(short_experiment(path, arms="swing", title="<b>short</b> & sweet", noise_n=0.0))


@pytest.fixture(scope="module")
def details(experiment: str) -> list[Detail]:
    """The baseline and the law that flies."""
    return [look_closely(Item(experiment=experiment, controller=name, seeds=(2, 3))) for name in ("pid", "practical")]


def test_friction_as_an_acceleration_in_w() -> None:
    """v = (0.3, -0.4, 0): |v| = 0.5, so 0.5 v + 0.2 0.5 v = 0.6 v N, and 0.5 N of dry friction against each motion."""
    found = friction_w_mps2(np.array([[0.3, -0.4, 0.0], [0.0, 0.0, 0.5]]), PLANT)
    np.testing.assert_allclose(found[0] * 5.0, [-0.6 * 0.3 - 0.5, 0.6 * 0.4 + 0.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(found[1] * 5.0, [0.0, 0.0, -(1.0 + 0.4 * 0.5) * 0.5 - 0.5], atol=1e-9)


def test_the_friction_to_learn_is_that_of_the_reference(details: Sequence[Detail], experiment: str) -> None:
    detail, plant = details[1], scene_of(Item(experiment=experiment, controller="pid", seeds=(1,))).mock.plant
    wanted = detail.trace.reference_velocity_w_mps
    assert np.abs(wanted).max() > 0.1
    np.testing.assert_array_equal(detail.friction_w_mps2, friction_w_mps2(wanted, plant))


def test_the_room_pushes_as_configured(details: Sequence[Detail]) -> None:
    """0.5 N north, 0.25 N west and 0.1 N down on 4.85 kg; W has x north, y west, z up."""
    room = details[0].room_w_mps2
    np.testing.assert_allclose(room, np.broadcast_to(np.array([0.5, 0.25, -0.1]) / 4.85, room.shape), atol=1e-12)


def test_what_is_neither_u_nor_friction_nor_known_is_delta(details: Sequence[Detail], experiment: str) -> None:
    """A vehicle made to follow u + f(v) + d exactly, with the dry friction of the reference, has Delta = d - known.

    alpha_2 = (1, 2, 3) m/s^2, sigma + kappa/delta = 0.05 + 0.02/0.1 = 0.25 and y_2 = (+, -, 0): u_bar would be
    (0.75, 2.25, 3.0); it is 0.2 m/s^2 less along y, which is known of the arms.
    """
    plant, d = (
        scene_of(Item(experiment=experiment, controller="pid", seeds=(1,))).mock.plant,
        np.array([0.3, -0.2, 0.1]),
    )
    smooth = replace(plant, coulomb_n=(0.0, 0.0, 0.0))
    trace, rows = details[1].trace, np.ones((len(details[1].trace.time_s), 1))
    inner = {"alpha2": [1.0, 2.0, 3.0], "y2": [0.4, -0.1, 0.0], "kappa": [0.02], "u_bar": [0.75, 2.05, 3.0]}
    trace = replace(trace, signals={name: rows * value for name, value in inner.items()})
    dry = friction_w_mps2(trace.reference_velocity_w_mps, plant) - friction_w_mps2(
        trace.reference_velocity_w_mps, smooth
    )
    velocity: Array = np.zeros_like(trace.velocity_w_mps)
    for cycle in range(len(velocity) - 1):
        moved = trace.accel_w_mps2[cycle] + friction_w_mps2(velocity[cycle], smooth) + dry[cycle] + d
        velocity[cycle + 1] = velocity[cycle] + 0.01 * moved
    found = delta_w_mps2(replace(trace, velocity_w_mps=velocity), EtnnGains(), plant, 0.01)
    np.testing.assert_allclose(found, np.broadcast_to(d - [0.0, 0.2, 0.0], found.shape), atol=1e-9)


def test_what_a_signal_knows(details: Sequence[Detail]) -> None:
    detail = details[1]

    def known(f_hat: Array) -> Array:
        signals = {"f_hat": f_hat}
        return learnt(replace(detail, trace=replace(detail.trace, signals=signals))).of_friction

    friction = detail.friction_w_mps2
    np.testing.assert_allclose(known(friction)[:2], 1.0)
    np.testing.assert_allclose(known(0.0 * friction)[:2], 0.0, atol=1e-12)
    np.testing.assert_allclose(known(0.5 * friction)[:2], 0.75)
    assert np.isnan(known(friction)[2])  # the reference never climbs: there is no friction to know


def test_only_the_papers_law_has_a_proof(details: Sequence[Detail]) -> None:
    pid, practical = details
    assert pid.proof is None
    assert practical.proof is not None
    v = practical.proof.lyapunov
    assert v.total.shape == practical.trace.time_s.shape
    assert (v.weights1 > 0.0).all()
    np.testing.assert_allclose(v.y1, 0.5 * (practical.signals["y1"] ** 2).sum(axis=-1))


def test_where_the_bound_does_not_apply_the_condition_is_named(details: Sequence[Detail]) -> None:
    practical = details[1]
    assert practical.proof is not None
    conditions = practical.proof.bound.conditions
    broken = replace(conditions[0], value=conditions[0].limit - 1.0)
    bound = replace(practical.proof.bound, conditions=(broken, *conditions[1:]))
    changed = replace(practical.proof, bound=bound, delta_mps2=0.75)
    _, proof = closer([details[0], replace(practical, proof=changed)])
    assert "practical: the fixed-time bound does not apply, with |Delta| up to 0.75 m/s²" in proof.note
    assert str(broken) in proof.note
    assert [cell.text for cell in proof.rows[0][4:7]] == ["–", "–", "–"]


def test_to_a_law_that_predicts_the_theorem_does_not_apply(details: Sequence[Detail], experiment: str) -> None:
    """Its velocity jumps with each command, so no Delta is measured; without the prediction one is."""
    predicting = details[1]
    bare = look_closely(Item(experiment=experiment, controller="practical", seeds=(2,), without=Ablation.PREDICTION))
    assert predicting.proof is not None
    assert bare.proof is not None
    said = "the law controls a predicted state (docs/departures.md)"
    assert [str(one) for one in predicting.proof.bound.conditions if not one.holds][-1] == said
    assert said not in [str(one) for one in bare.proof.bound.conditions if not one.holds]
    assert np.isinf(predicting.proof.bound.v_bound)
    assert np.isinf(predicting.proof.delta_mps2)
    assert 0.0 < bare.proof.delta_mps2 < 10.0
    _, proof = closer([predicting])
    assert "|Delta| up to" not in proof.note
    assert proof.note.endswith(f"{said}.")
    assert float(proof.rows[0][2].text) > 0.0
    assert [cell.text for cell in proof.rows[0][4:7]] == ["–", "–", "–"]


def test_a_lost_vehicle_has_no_proof_and_spoils_no_table(details: Sequence[Detail]) -> None:
    trace = details[1].trace
    away = np.where(trace.time_s[:, None] > 1.0, 1e200, trace.position_w_m)
    lost = replace(details[1], trace=replace(trace, position_w_m=away), proof=None)
    assert (lost.lost, details[1].lost) == (True, False)
    network, proof = closer([details[0], lost, details[1]])
    assert [row[0].text for row in network.rows if "f_hat" in row[0].text] == ["practical: f_hat"]
    assert proof.note.endswith("practical: lost, so left out.")


@pytest.fixture(scope="module")
def drawn(details: Sequence[Detail], tmp_path_factory: pytest.TempPathFactory) -> list[Drawn]:
    return draw_experiment(details, tmp_path_factory.mktemp("figures"))


def test_every_figure_is_a_picture_and_a_print(drawn: Sequence[Drawn]) -> None:
    assert [subject for subject, _, _ in drawn] == ["flown", "position", "force", "network", "events", "lyapunov"]
    for _, _, png in drawn:
        assert imread(png)[..., :3].std() > 0.02  # not blank
        assert png.with_suffix(".pdf").read_bytes().startswith(b"%PDF")


class _References(HTMLParser):
    """Whatever a page would fetch, and its tags that were never closed."""

    VOID = frozenset({"meta", "img", "br", "link"})

    def __init__(self) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [value or "" for name, value in attrs if name in {"src", "href", "srcset", "data", "action"}
                         and not str(value).startswith("#")]  # fmt: skip
        self.open += [] if tag in self.VOID else [tag]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_needs_nothing_but_itself(
    experiment: str, details: Sequence[Detail], drawn: Sequence[Drawn], tmp_path: Path
) -> None:
    flights: list[Flown] = [
        fly(Item(experiment=experiment, controller=name, seeds=(2, 3))) for name in ("pid", "practical")
    ]
    scene = scene_of(Item(experiment=experiment, controller="pid", seeds=(1,)))
    chapter = Chapter(scene.title, facts_of(scene), flights, [], closer(details), drawn)
    text = page([chapter], [Source(tmp_path / "a.toml", "law = '<script>'")], "companion experiments")
    seen = _References()
    seen.feed(text)
    assert seen.open == []
    assert len(seen.fetched) == len(drawn)
    assert all(value.startswith("data:image/png;base64,") for value in seen.fetched)
    assert not re.search(r"@import|url\(|<script|<link", text)
    assert "<h2>&lt;b&gt;short&lt;/b&gt; &amp; sweet</h2>" in text
    assert "0.40 m along x, 0.20 m along y" in text
