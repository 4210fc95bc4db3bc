"""Faults as sentences and as TOML: what is understood, and what is said of the rest."""

import math
from pathlib import Path

import pytest

from mock_autopilot.config import MockConfig, MockConfigError
from mock_autopilot.faults.catalogue import WAYS, Kind, Part, Phase, Way
from mock_autopilot.faults.fault import Fault
from mock_autopilot.faults.sentences import EXAMPLES, FaultError, parse, sentence_of
from tests.mock_autopilot.faults.document import document


def test_the_document_is_what_the_code_prints() -> None:
    written = (Path(__file__).parents[3] / "docs" / "faults.md").read_text(encoding="utf-8")
    assert written == document(), "python -m tests.mock_autopilot.faults.document > docs/faults.md"


def test_a_sentence_is_a_fault() -> None:
    assert parse("mocap stuck at 12 s for 2 s") == Fault(part=Part.MOCAP, kind=Kind.STUCK, at_s=12.0, for_s=2.0)
    mirrored = parse("Mocap  wrong (mirrored) in the air after 3s")
    assert mirrored == Fault(part=Part.MOCAP, kind=Kind.WRONG, how="mirrored", phase=Phase.IN_THE_AIR, after_s=3.0)
    assert mirrored.for_s == math.inf
    assert parse("link delayed by 0.2 s at 10 s").magnitude == 0.2
    assert parse("mocap slow to 15 Hz").magnitude == 15.0
    assert parse("network slow to 5 kB/s").magnitude == 5.0
    assert parse("network intermittent (bursts of 0.1 s) by 0.3 at 12 s for 5 s").how == "bursts of 0.1 s"
    assert parse("mocap slow").magnitude == 20.0, "the usual amount"
    assert parse("mocap wrong (clock jump) for 3 s by -4 s").amount == -4.0


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.words)
def test_every_line_of_the_table_is_understood_and_said_again(way: Way) -> None:
    fault = parse(f"{way.words} landing after 1.5 s")
    assert fault.way is way
    assert parse(sentence_of(fault)).way is way
    assert parse(sentence_of(fault)).magnitude == fault.magnitude
    if way.amount is not None:
        with pytest.raises(FaultError, match="goes from"):
            parse(f"{way.words} {way.amount.word} {way.amount.most + 1.0:g}")


@pytest.mark.parametrize("sentence", EXAMPLES)
def test_the_examples_are_sentences(sentence: str) -> None:
    assert parse(sentence_of(parse(sentence))) == parse(sentence)


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("", 'an empty sentence is no fault; one is "mocap stuck at 12 s for 2 s"'),
        ("camera stuck", '"camera" is no part; possible: mocap, link, autopilot, servos, broker, network'),
        ("autopilot slow", 'autopilot cannot be "slow"; it can be off, stuck, wrong'),
        ("mocap garbage (noise)", 'mocap garbage does not know "(noise)"; possible: nothing more, (packets)'),
        ("autopilot wrong", "autopilot wrong must say which; possible: (reboot), (disarms), (pilot takes over), "),
        ("mocap stuck for ever", '"for ever" is not understood; after that may come an amount '),
        ("mocap stcuk", 'mocap cannot be "stcuk"; it can be off, stuck, garbage, '),
        ("mocap", "what is wrong with mocap? It can be off, stuck, "),
        ("mocap stuck at 12", '"at 12": 12 what? Times are in s: "at 12 s"'),
        ("mocap stuck at 12 ms", '"at 12 ms": times are in s: "at 0.012 s"'),
        ("mocap stuck at -3 s", '"at -3 s": times count from lift-off, 0 s or later'),
        ("mocap stuck landing after -1 s", '"after -1 s": times count from the phase\'s begin, 0 s or later'),
        ("mocap stuck for 0 s", '"for 0 s": it must last longer than 0 s; without, it is for ever'),
        ("mocap stuck at 1e9 s", '"at 1e+09 s": at most 100000 s'),
        ("link delayed by 200 ms", '"by 200 ms": the amount of "link delayed" is in s: "by 0.2 s"'),
        ("link slow by 50 %", '"by 50 %": the amount of "link slow" is a share and has no unit: "by 0.5"'),
        ("mocap wrong (tilted) by 20 deg", '"by 20 deg": the amount of "mocap wrong (tilted)" is in rad: "by 0.349066'),
        ("mocap stuck by 3 m", "mocap stuck has no amount, so leave out 3"),
        ("link delayed by 3 m", 'the amount of "link delayed" is in s, not in m'),
        ("link intermittent by 0.5 s", 'the amount of "link intermittent" is a share and has no unit, not in s'),
        ("network slow to 5 MB/s", '"to 5 mb/s": the amount of "network slow" is in kB/s: "to 5 kB/s"'),
        (
            "network intermittent (bursts)",
            'network intermittent does not know "(bursts)"; possible: nothing more, (up), ',
        ),
        ("link delayed by 30 s", "link delayed goes from 0 to 5 s, not 30"),
        ("autopilot wrong (reboot) for 3 s", 'autopilot wrong (reboot) happens once: leave out "for"'),
        ("mocap off at 3 s at 4 s", '"at 4 s" says a second time what was said before'),
        ("mocap off at 3 s landing", "it begins at a time or in a phase, not both"),
        ("mocap off after 2 s", '"after" counts from a phase: on the ground, armed, in the air or landing'),
    ],
)
def test_what_is_no_fault_gets_one_sentence_that_says_what_would_be(sentence: str, said: str) -> None:
    with pytest.raises(FaultError) as refused:
        parse(sentence)
    assert str(refused.value).startswith(said)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("sentence", "meant"),
    [
        ("mocap stcuk", "mocap stuck"),
        ("moacp stuck at 3 s", "mocap stuck"),
        ("battery low", "autopilot wrong (battery low)"),
        ("mocap wrong jump at 3 s", "mocap wrong (jump)"),
        ("mocap jump by 0.5 m", "mocap wrong (jump)"),
        ("mocap wrong (jmup)", "mocap wrong (jump)"),
        ("pilot takes over in the air", "autopilot wrong (pilot takes over)"),
        ("autopilot wrong refuses to land", "autopilot wrong (refuses to land)"),
    ],
)
def test_what_looks_like_a_fault_is_asked_for(sentence: str, meant: str) -> None:
    with pytest.raises(FaultError) as refused:
        parse(sentence)
    assert str(refused.value).endswith(f'; did you mean "{meant}"?')


@pytest.mark.parametrize("sentence", ["camera stuck", "autopilot slow", "autopilot wrong", "mocap stuck for ever"])
def test_what_looks_like_nothing_is_not(sentence: str) -> None:
    with pytest.raises(FaultError) as refused:
        parse(sentence)
    assert "did you mean" not in str(refused.value)


def test_toml_takes_sentences_and_keys(tmp_path: Path) -> None:
    path = tmp_path / "mock.toml"
    path.write_text(
        '[[faults]]\nsay = "mocap wrong (jump) by 0.5 m in the air after 3 s for 2 s"\n'
        '[[faults]]\npart = "mocap"\nkind = "wrong"\nhow = "jump"\namount = 0.5\n'
        'phase = "in the air"\nafter_s = 3.0\nfor_s = 2.0\n',
        encoding="utf-8",
    )
    said, spelt = MockConfig.load(path).faults
    assert said == spelt


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        ({"say": "mocap stuk"}, 'faults.0: mocap cannot be "stuk"; it can be off, '),
        ({"say": "mocap stuck", "for_s": 2.0}, 'faults.0: say = "..." is a whole fault in words and stands alone'),
        ({"part": "mocap", "kind": "wrong", "how": "jumps"}, 'faults.0: mocap wrong does not know "(jumps)"; '),
        ({"part": "mocap", "kind": "stuck", "form_s": 2.0}, "faults.0.form_s: unknown key"),
        (
            {"part": "mocap", "kind": "slow", "amount": math.nan},
            "faults.0: mocap slow goes from 0.1 to 500 Hz, not nan",
        ),
        ({"say": "servos off"}, "servos cannot fail on a vehicle without arms: set arms.enabled = true"),
    ],
)
def test_a_wrong_fault_in_the_configuration_is_one_sentence(faults: dict[str, object], said: str) -> None:
    with pytest.raises(MockConfigError) as refused:
        MockConfig.from_dict({"faults": [faults]})
    assert str(refused.value).startswith(said)
