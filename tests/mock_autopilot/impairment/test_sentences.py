"""Sentences of the impairment: what they mean, and what is said about a wrong one."""

import pytest

from mock_autopilot.impairment import CLEAN, CUT, Directions, Impairment, ImpairmentError, parse, parse_directions


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("loss 10% jitter 20 ms", Impairment(loss_share=0.1, jitter_s=0.02)),
        ("loss 30% burst 100 ms delay 5 ms", Impairment(burst_share=0.3, burst_s=0.1, delay_s=0.005)),
        ("loss 30 % burst 0.1 s, delay 5ms", Impairment(burst_share=0.3, burst_s=0.1, delay_s=0.005)),
        ("loss 2%, loss 30% burst 100 ms", Impairment(loss_share=0.02, burst_share=0.3, burst_s=0.1)),
        ("loss 30% burst 100 ms loss 2%", Impairment(loss_share=0.02, burst_share=0.3, burst_s=0.1)),
        ("rate 100 kB/s", Impairment(rate_bytes_per_s=1e5)),
        ("rate 1 Mbit/s", Impairment(rate_bytes_per_s=125e3)),
        ("duplicate 5%", Impairment(duplicate_share=0.05)),
        ("Reorder 5%", Impairment(reorder_share=0.05)),
        ("loss 100%", CUT),
        ("off", CUT),
        ("clean", CLEAN),
    ],
)
def test_a_sentence_and_its_meaning(sentence: str, expected: Impairment) -> None:
    assert parse(sentence) == expected
    assert parse(str(expected)) == expected, "and back"


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("", "an empty sentence"),
        ("loss", "how much?"),
        ("loss burst 5 ms", "how much?"),
        ("loss 10 burst 5 ms", "loss is in %"),
        ("loss 10", 'loss is in %: "loss 10%"'),
        ("loss 10 ms", "loss is in %"),
        ("jitter 20", "jitter is in ms or s"),
        ("delay 5 min", "delay is in ms or s"),
        ("loss 110%", "at most 100%"),
        ("loss 110% burst 1 s", "at most 100%"),
        ("reorder 60%", "at most 50%"),
        ("rate 0 kB/s", 'say "off"'),
        ("rate 100 kB", "rate is in B/s, kB/s"),
        ("burst 100 ms", "follows the loss"),
        ("delay 5 ms burst 100 ms", "follows the loss"),
        ("loss 5% burst 0 ms", "longer than 0 s"),
        ("loss 5% loss 6%", "a second time"),
        ("loss 5% burst 1 s loss 6% burst 1 s", "a second time"),
        ("delay 5 ms delay 5 ms", "a second time"),
        ("off delay 5 ms", "stands alone"),
        ("los 10%", '"los" is no impairment; possible: "loss 10%"'),
        ("loss -10%", "how much?"),
        ("10%", "is not understood"),
    ],
)
def test_a_wrong_sentence_is_answered_with_one(sentence: str, said: str) -> None:
    with pytest.raises(ImpairmentError) as error:
        parse(sentence)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_directions_are_given_together_or_each_by_itself() -> None:
    lossy, late = parse("loss 10%"), parse("delay 5 ms")
    assert parse_directions("loss 10%") == Directions(lossy, lossy)
    assert parse_directions("up loss 10%") == Directions(lossy, CLEAN)
    assert parse_directions("up loss 10%; down: delay 5 ms") == Directions(lossy, late)
    assert parse_directions("down clean", Directions(late, late)) == Directions(late, CLEAN)
    with pytest.raises(ImpairmentError, match="is no impairment"):
        parse_directions("sideways loss 10%")


@pytest.mark.parametrize(
    ("name", "value"),
    [("loss_share", 1.1), ("burst_share", 0.5), ("delay_s", -1.0), ("rate_bytes_per_s", 0.0), ("reorder_share", 0.6)],
)
def test_an_impossible_value_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        Impairment(**{name: value})


def test_two_impairments_are_one_link_behind_the_other() -> None:
    both = parse("loss 50% delay 5 ms rate 10 kB/s").and_also(parse("loss 50% jitter 2 ms rate 5 kB/s"))
    assert both == parse("loss 75% delay 5 ms jitter 2 ms rate 5 kB/s")
    assert parse("loss 10% burst 1 s").and_also(CLEAN) == parse("loss 10% burst 1 s")
    assert CUT.and_also(parse("loss 30% burst 100 ms")).loss_share == 1.0
