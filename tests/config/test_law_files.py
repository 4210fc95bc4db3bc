"""Errors in a law of one's own, each told in one sentence: which file, what, and what would be right."""

from pathlib import Path

import pytest

from companion.config.law_files import LAW_FORM
from companion.core.interfaces import ConfigError
from tests.control.first_law import PD, loaded

RETURN = '        return {"integral": integral}, ControlOutput(accel, event, {"error": error})\n'
EVENT = "np.ones((*error.shape[:-1], 1))"
ONE, TWO = ".step with positions of shape (3,)", ".step with positions of shape (2, 3)"
PREVIEW = "    preview_s = 0.0\n"
MAKE = " must be a class or function that takes (gains, vehicle, period_s): "


def refusal(folder: Path, code: str, toml: str = 'law = "pd.py:Pd"') -> str:
    with pytest.raises(ConfigError) as caught:
        loaded(folder, code, toml)
    said = str(caught.value)
    assert "\n" not in said, "one sentence"
    assert str(folder) in said, "which names the file"
    return said.replace(f"{folder}/", "")


def refusal_with(folder: Path, line: str, instead: str) -> str:
    assert PD.count(line) == 1
    return refusal(folder, PD.replace(line, instead))


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ("pd.py", f"mine.toml: law = 'pd.py': must be {LAW_FORM}"),
        ("pd.py:", f"mine.toml: law = 'pd.py:': must be {LAW_FORM}"),
        ("pd.py:a b", f"mine.toml: law = 'pd.py:a b': must be {LAW_FORM}"),
        ("pt.py:Pd", "mine.toml: law = 'pt.py:Pd': there is no file pt.py"),
        ("pd.py:Dp", "pd.py: has no class or function 'Dp'; there are Pd, PdGains"),
        ("pd.py:np", f"pd.py: np{MAKE}"),
        ("pd.py:PdGains", f"pd.py: PdGains{MAKE}"),
    ],
)
def test_a_law_that_cannot_be_found(tmp_path: Path, law: str, said: str) -> None:
    assert refusal(tmp_path, PD, f'law = "{law}"').startswith(said)


@pytest.mark.parametrize(
    ("toml", "said"),
    [
        ("[gains]\nkd = 1.0", "mine.toml: gains.kd: unknown key; known here are kp"),
        ('[gains]\nkp = "1"', "mine.toml: gains.kp = '1': must be a number, without quotes"),
        ("[gain]\nkp = 1.0", "mine.toml: gain: unknown key, did you mean 'gains'?"),
        ("gains = 3", "mine.toml: gains = 3: must be a table [gains]"),
    ],
)
def test_wrong_gains(tmp_path: Path, toml: str, said: str) -> None:
    assert refusal(tmp_path, PD, f'law = "pd.py:Pd"\n{toml}').startswith(said)


@pytest.mark.parametrize(
    ("instead", "said"),
    [
        ("import nunpy", "ModuleNotFoundError: No module named 'nunpy' (line 2)"),
        ("import numpy as np)", "SyntaxError: unmatched ')' (line 2)"),
        ("raise SystemExit(3)", "SystemExit: 3 (line 2)"),
        ("import numpy as np\n1.0 / 0.0", "ZeroDivisionError: float division by zero (line 3)"),
    ],
)
def test_a_file_that_cannot_be_imported(tmp_path: Path, instead: str, said: str) -> None:
    assert refusal_with(tmp_path, "import numpy as np", instead) == f"pd.py: cannot be imported: {said}"


@pytest.mark.parametrize(
    ("line", "instead", "said"),
    [
        (
            "class PdGains(Gains):",
            "import pydantic\nclass PdGains(pydantic.BaseModel):",
            " wants a PdGains as gains: must be a subclass of companion.control.gains.Gains, or a dict",
        ),
        ("period_s: float\n", "period_s: float\n    mass_kg: float\n", f"{MAKE}missing a required argument: 'mass_kg'"),
        (
            PREVIEW,
            f"{PREVIEW}    def __post_init__(self):\n        self.a = 1\n",
            "(gains, vehicle, period_s) raised FrozenInstanceError: cannot assign to field 'a' (line 16)",
        ),
        (
            "def initial(",
            "def start(",
            " has no method initial: a law has initial(self, first), the memory at lift-off",
        ),
        ("def step(", "def update(", " has no method step: a law has step(self, memory, now), one cycle"),
        (PREVIEW, "", ".preview_s is None: must be a property that gives seconds, 0.0 or more"),
        (PREVIEW, "    preview_s = -0.1\n", ".preview_s is -0.1: must be a property"),
        (PREVIEW, "    def preview_s(self): return 0.0\n", ".preview_s is <bound method"),
    ],
)
def test_a_file_that_gives_no_law(tmp_path: Path, line: str, instead: str, said: str) -> None:
    assert refusal_with(tmp_path, line, instead).startswith(f"pd.py: Pd{said}")


@pytest.mark.parametrize(
    ("line", "instead", "said"),
    [
        (
            "np.zeros_like(first.position_w_m)",
            "first.nothing",
            ".initial with positions of shape (3,) raised AttributeError: 'ControlInput' object has no attribute "
            "'nothing' (line 17)",
        ),
        (
            "now.dt_s\n",
            "now.period_s\n",
            f"{ONE} raised AttributeError: 'ControlInput' object has no attribute 'period_s' (line 21)",
        ),
        (RETURN, "        pass\n", ".step returned nothing: must be (memory, ControlOutput)"),
        (RETURN, "        return accel\n", ".step returned a ndarray: must be (memory, ControlOutput)"),
        ("(accel, e", "(accel[..., :2], e", f"{ONE} gave accel_w_mps2 of shape (2,): must be (3,)"),
        ("(accel, e", "(accel.tolist(), e", f"{ONE} gave a list as accel_w_mps2: must be an array of shape (3,)"),
        ("(accel, e", "(accel * np.nan, e", f"{ONE} gave accel_w_mps2 = [nan, nan, nan]: must be finite numbers"),
        (EVENT, "1.0", f"{ONE} gave a float as event: must be an array of shape (1,)"),
        (EVENT, "0.5 * np.ones(1)", f"{ONE} gave event = [0.5]: must be 1 where to send and 0 elsewhere"),
        ('{"error": error})', "error)", ".step gave a ndarray as signals: must be a dict of arrays, {} for none"),
        ("error})", "1.0})", f"{ONE} gave a float as signals['error']: must be an array of shape (1,)"),
        ("error})", "error * np.inf})", f"{ONE} gave signals['error'] = [inf, -inf, -inf]: must be finite numbers"),
        (
            "        error = ",
            "        now.position_w_m[...] = 0.0\n        error = ",
            f"{ONE} raised ValueError: assignment destination is read-only (line 20)",
        ),
    ],
)
def test_a_law_that_does_not_work(tmp_path: Path, line: str, instead: str, said: str) -> None:
    assert refusal_with(tmp_path, line, instead).startswith(f"pd.py: Pd{said}")


@pytest.mark.parametrize(
    "instead",
    [
        'memory["integral"] += error * now.dt_s; integral = memory["integral"]; accel = -integral #',
        'memory["integral"] += error * now.dt_s; integral = 0 * error; accel = -memory["integral"] #',
        "accel = np.random.default_rng().normal(size=error.shape) #",
        'object.__setattr__(self, "count", getattr(self, "count", 0) + 1); accel = self.count * error #',
    ],
    ids=["memory changed and returned", "memory changed", "random", "kept in self"],
)
def test_a_step_that_is_not_pure(tmp_path: Path, instead: str) -> None:
    said = refusal_with(tmp_path, "accel = -", f"{instead} ")
    assert said.startswith(
        "pd.py: Pd.step gave two answers to the same memory and input: it must give back a new memory"
    )


@pytest.mark.parametrize(
    ("line", "instead", "said"),
    [
        (EVENT, "np.ones(1)", f"{TWO} gave event of shape (1,): must be (2, 1)"),
        ("error})", "error.T})", f"{TWO} gave signals['error'] of shape (3, 2): must be (2, 2)"),
        ("error})", "error.reshape(-1, 3)})", f"{TWO} gave signals['error'] of shape (2, 3): must be (2, 1, 3)"),
        ("accel = ", "accel = 0.0 if error[2] > 1.0 else ", f"{TWO} raised IndexError: "),
        ("accel = ", "accel = -np.linalg.norm(error) - ", ".step commands ["),
    ],
)
def test_a_law_that_works_for_one_vehicle_only(tmp_path: Path, line: str, instead: str, said: str) -> None:
    assert refusal_with(tmp_path, line, instead).startswith(f"pd.py: Pd{said}")


def test_a_vehicle_flown_differently_in_company_is_refused_with_the_reason(tmp_path: Path) -> None:
    said = refusal_with(tmp_path, "accel = ", "accel = -np.linalg.norm(error) - ")
    assert said.endswith("to the same vehicle alone: sums and norms must go along the last axis only")


HALVES = """
    def decide(self, memory, now):
        return (memory, now), self.step(memory, now)[1]

    def settle(self, decided):
        return self.step(*decided)[0], {}
"""


def test_a_law_in_two_halves_is_tried_as_such(tmp_path: Path) -> None:
    assert loaded(tmp_path, PD + HALVES).law
    other = HALVES.replace("self.step(memory, now)[1]", "self.step(self.initial(now), now)[1]")
    assert refusal(tmp_path, PD + other).startswith("pd.py: Pd.decide gave another command than .step: step must be")
    lost = HALVES.replace("self.step(*decided)[0], {}", "self.step(*decided)[0]")
    assert refusal(tmp_path, PD + lost) == "pd.py: Pd.settle returned a dict: must be (memory, dict of arrays)"
