"""A user's own law: the example of docs/own-law.md flies, and errors in the two files are reported."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.config.controller_config import load_controller
from companion.control.law_check import LawFile, check_law
from companion.supervisor.flight_state import Phase, TrackRequest
from companion.trajectories.reference import Ellipse, LapTiming
from tests.control.first_law import PD, VEHICLE, loaded, still_at
from tests.flights.simulated import fly
from tests.flights.test_simulated_flights import DOWN, UP, ask, until

PROJECT = Path(__file__).resolve().parents[2]
PAGE = PROJECT / "docs" / "own-law.md"
EXAMPLE = PROJECT / "examples" / "own_law"
LAWS = ("pd", "sliding_mode")

# --- the page ---


def block(language: str, law: str) -> str:
    """Return what the page shows of a law."""
    found = re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    assert len(found) == len(LAWS), f"two {language} blocks"
    return str(found[LAWS.index(law)])


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("language", "suffix"), [("python", ".py"), ("toml", ".toml")])
def test_the_page_shows_the_examples_as_they_are(language: str, suffix: str, law: str) -> None:
    assert block(language, law) == (EXAMPLE / f"{law}{suffix}").read_text(encoding="utf-8")


def test_a_complete_law_takes_25_lines() -> None:
    assert len(block("python", "pd").splitlines()) <= 25


@pytest.mark.parametrize(
    ("law", "signals"), [("pd", {"error"}), ("sliding_mode", {"error", "surface", "wanted"})], ids=LAWS
)
async def test_what_the_page_shows_takes_off_flies_a_lap_and_lands(tmp_path: Path, law: str, signals: set[str]) -> None:
    (tmp_path / f"{law}.py").write_text(block("python", law), encoding="utf-8")
    (tmp_path / "mine.toml").write_text(block("toml", law), encoding="utf-8")
    lap = Ellipse(np.array([0.0, 0.0, 1.2]), (0.5, 0.3), timing=LapTiming(period_s=8.0, laps=1))
    script = [*UP, ask(TrackRequest(lap, 1.0)), until(Phase.TRACK), until(Phase.HOLD), *DOWN]
    flight = await fly(script, controller=str(tmp_path / "mine.toml"))
    assert flight.phase is Phase.DISARMED
    assert flight.loop.flight.reason == ""
    pairs = zip(flight.ticks, flight.truths_w_m, strict=True)
    error = np.abs(
        [truth - t.reference.position_w_m for t, truth in pairs if t.reference and t.flight.phase is Phase.TRACK]
    )
    limits = load_controller(str(tmp_path / "mine.toml"), VEHICLE, 0.01).error_limits
    assert error.mean(axis=0).max() < limits.mean_m
    assert error.max() < limits.max_m
    asked = [tick.pipeline for tick in flight.ticks if tick.pipeline is not None]
    if law == "sliding_mode":
        assert 0.02 < np.mean([a.law_output.event for a in asked]) < 0.5, "it sends what differs, and only that"
    assert signals == asked[-1].law_output.signals.keys()


def test_the_example_takes_its_gains_from_the_file() -> None:
    """At rest, 0.1 m off, nothing integrated yet: u = -w^2 e - K sat(2 w e / layer) = -0.256 - 2.0 * 0.32 / 0.6."""
    law = load_controller(str(EXAMPLE / "sliding_mode.toml"), replace(VEHICLE, mocap_age_s=0.01), 0.01).law
    first = still_at([0.1, 0.0, -0.1])
    _, output = law.step(law.initial(first), first)
    np.testing.assert_allclose(output.accel_w_mps2, [-1.32267, 0.0, 1.32267], atol=1e-5)
    assert output.event == 1.0


# --- what may be in the two files ---


def test_gains_limits_and_description_come_from_the_file(tmp_path: Path) -> None:
    toml = 'law = "pd.py:Pd"\ndescription = "my first"\n[gains]\nkp = 3.0\n[error_limits]\nmean_m = 0.3\nmax_m = 0.9'
    mine = loaded(tmp_path, PD, toml)
    assert (mine.description, mine.error_limits.mean_m, mine.error_limits.max_m) == ("my first", 0.3, 0.9)
    now = still_at([0.2, 0.0, 0.0])
    _, output = mine.law.step(mine.law.initial(now), now)
    np.testing.assert_allclose(output.accel_w_mps2, [-0.6 - 0.1 * 0.002, 0.0, 0.0])


@pytest.mark.parametrize(
    "code",
    [
        PD + "\ndef build(gains: PdGains, vehicle, period_s):\n    return Pd(gains, vehicle, period_s)\n",
        PD + "\ndef build(gains, vehicle, period_s):\n    return Pd(PdGains(**gains), vehicle, period_s)\n",
        PD + "\ndef build(gains: dict, vehicle, period_s):\n    return Pd(PdGains(**gains), vehicle, period_s)\n",
        "from __future__ import annotations\n" + PD.replace("class Pd:", "class build:"),
    ],
    ids=["a function", "plain gains", "gains as dict", "annotations as text"],
)
def test_a_law_may_be_made_by_a_class_or_a_function(tmp_path: Path, code: str) -> None:
    mine = loaded(tmp_path, code, 'law = "pd.py:build"\n[gains]\nkp = 3.0').law
    now = still_at([0.2, 0.0, 0.0])
    assert mine.step(mine.initial(now), now)[1].accel_w_mps2[0] == pytest.approx(-0.6002)


def test_an_edited_file_is_read_anew_and_two_of_one_name_are_two(tmp_path: Path) -> None:
    now = still_at([0.1, 0.0, 0.0])
    laws = []
    for folder, kp in (("a", "1.0"), ("a", "5.0"), ("b", "7.0")):
        (tmp_path / folder).mkdir(exist_ok=True)
        laws.append(loaded(tmp_path / folder, PD.replace("kp: float = 1.0", f"kp: float = {kp}")).law)
    accel = [law.step(law.initial(now), now)[1].accel_w_mps2[0] for law in laws]
    np.testing.assert_allclose(accel, [-0.1001, -0.5001, -0.7001])
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["mine.toml", "pd.py"], "nothing is left behind"


@pytest.mark.parametrize("name", ["practical", "pid"])
def test_the_laws_that_come_with_it_pass_the_check(name: str) -> None:
    law = load_controller(name, VEHICLE, 0.01).law
    assert check_law(law, LawFile(Path("law.py"), name), 0.01) is law
