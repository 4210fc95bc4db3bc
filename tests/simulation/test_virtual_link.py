"""Radio in virtual time: which messages arrive, when, in which order; and both ends against those that fly."""

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.simulation.virtual_link import NONE, Direction, newest, radio_named
from companion.simulation.virtual_link_ends import BYTES, Kind, LinkEnds, LinkTiming, Messages, measured_up_age_s
from mock_autopilot.impairment.sentences import parse
from tests.simulation.real_ends import PERIOD_S, RealEnds

CYCLES = 2000
ALL = np.ones(2, dtype=bool)


def sent(sentence: str, seed: int = 1, cycles: int = CYCLES, size: float = 24.0) -> Direction:
    """Two vehicles that send in every cycle; each with a seed of its own, and the same bursts."""
    seeds = [np.random.SeedSequence(seed + one) for one in range(2)]
    direction = Direction([parse(sentence)] * 2, seeds, [seed, seed], cycles, PERIOD_S)
    for cycle in range(cycles):
        direction.send(cycle, ALL, size)
    return direction


def late_s(direction: Direction) -> NDArray[np.float64]:
    return np.asarray(direction.arrival_s - np.arange(len(direction.arrival_s))[:, None] * PERIOD_S)


@pytest.mark.parametrize("percent", [10, 30])
def test_the_share_that_is_lost_is_the_sentences(percent: int) -> None:
    lost = ~np.isfinite(sent(f"loss {percent}%").arrival_s)
    assert lost.mean(axis=0) == pytest.approx([percent / 100] * 2, abs=0.03)
    assert (lost[:, 0] != lost[:, 1]).any(), "each vehicle has its own"
    together = (lost[1:] & lost[:-1]).mean()
    assert together == pytest.approx((percent / 100) ** 2, abs=0.015), "each message by itself"


def test_a_burst_loses_all_of_a_window_and_the_windows_take_their_share() -> None:
    lost = ~np.isfinite(sent("loss 30% burst 100 ms").arrival_s[:, 0])
    assert lost.mean() == pytest.approx(0.3, abs=0.02)
    edges = np.flatnonzero(np.diff(lost.astype(int), prepend=0, append=0)).reshape(-1, 2)
    lengths = edges[:, 1] - edges[:, 0]
    assert set(lengths.tolist()) <= {*range(9, 12), *range(18, 23)}, "100 ms, or two windows that touch"


def test_delay_and_jitter_are_uniform_from_the_delay_on() -> None:
    late = late_s(sent("delay 5 ms jitter 20 ms"))
    assert 0.005 <= late.min() < 0.0051
    assert 0.0249 < late.max() <= 0.025
    assert np.median(late) == pytest.approx(0.015, abs=0.001)


def test_a_message_that_is_reordered_arrives_just_behind_its_successor() -> None:
    late = late_s(sent("reorder 20%"))[:-1]
    behind = late > 0.0
    assert behind.mean() == pytest.approx(0.2, abs=0.015)
    assert late[behind] == pytest.approx(PERIOD_S, abs=1e-6)


def test_a_limited_rate_delays_each_message_and_loses_what_waits_too_long() -> None:
    slow = late_s(sent("rate 10 kB/s", size=50.0))
    assert slow == pytest.approx(0.005), "50 bytes take 5 ms, and none waits for the one before"
    choked = late_s(sent("rate 10 kB/s", size=200.0))
    assert np.isinf(choked).mean() == pytest.approx(0.5, abs=0.02), "twice what passes"
    assert 0.2 < choked[np.isfinite(choked)].max() <= 0.221


def test_the_same_seed_gives_the_same_fates_and_another_one_others() -> None:
    one, same, other = (sent("loss 10% jitter 20 ms", seed).arrival_s for seed in (1, 1, 5))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_the_newest_message_is_the_one_sent_last_of_those_that_have_arrived() -> None:
    direction = sent("jitter 50 ms", cycles=50)
    for cycle in range(50):
        first, here, now = direction.arrived(cycle)
        by_hand = [np.flatnonzero(column <= cycle * PERIOD_S + 1e-9) for column in direction.arrival_s.T]
        assert newest(first, here).tolist() == [one[-1] if one.size else NONE for one in by_hand]
        assert (here | ~now).all()


def flown(sentence: str, events: NDArray[np.bool_], seeds: list[int]) -> tuple[Messages, NDArray[np.int64]]:
    """The model of both ends: its messages, and the number of the command in use in each cycle, (n, B)."""
    radio, timing = radio_named(sentence), LinkTiming()
    timing = LinkTiming(up_age_s=measured_up_age_s(radio, timing, PERIOD_S))
    ends, many = LinkEnds([radio] * len(seeds), timing, seeds, len(events), PERIOD_S), len(seeds)
    in_use = list[NDArray[np.int64]]()
    for cycle in range(len(events)):
        ends.hear_reports(cycle)
        ends.send(cycle, np.repeat(events[cycle], many))
        before = ends.in_use
        ends.hear_commands(cycle)
        in_use.append(ends.in_use)
        ends.report(cycle, ends.in_use != before, np.zeros(many, dtype=bool))
    return ends.messages(() if many == 1 else (many,)), np.array(in_use)


@pytest.mark.parametrize(
    "sentence", ["loss 20% delay 2 ms", "loss 30% burst 100 ms delay 5 ms", "loss 10% jitter 20 ms"]
)
def test_the_ends_do_what_the_ends_that_fly_do(sentence: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cycle by cycle, but where a limit is a whole number of cycles, which rounding may move by one."""
    events = np.random.default_rng(1).random(1200) < 0.055
    fly_real = RealEnds(radio_named(sentence), 7, len(events))
    for name in ("companion.law_link.ground_end.CLOCK_S", "companion.simulation.virtual_link_ends.CLOCK_S"):
        monkeypatch.setattr(name, np.inf)  # the clocks' messages have another phase, which moves all beats
    monkeypatch.setattr("companion.law_link.ground_end._JUMP_S", np.inf)
    real, (model, in_use) = fly_real.fly(events), flown(sentence, events, [7])
    np.testing.assert_array_equal(model.kind == Kind.EVENT, real.kind == Kind.EVENT)
    assert (in_use[:, 0] == real.in_use).mean() > 0.98, "but for commands that are sent again"
    beats, again = ([int((one.kind == kind).sum()) for one in (model, real)] for kind in (Kind.BEAT, Kind.AGAIN))
    assert beats[0] == pytest.approx(beats[1], rel=0.04)
    assert again[0] == pytest.approx(again[1], rel=0.3, abs=4)
    assert BYTES[model.kind].sum() == pytest.approx(real.bytes_up, rel=0.03)
    assert model.silence_s.mean() == pytest.approx(real.silence_s.mean(), rel=0.05)


def test_a_lost_event_is_sent_again_after_a_round_trip_and_then_every_20_ms() -> None:
    """The command is used 10 ms after it is sent, and acknowledged 10 ms later: lost is known after 40 ms."""
    events = np.zeros(200, dtype=bool)
    events[[20, 100]] = True
    _, in_use = flown("loss 30% delay 5 ms", events, list(range(200)))
    late = np.argmax(in_use == 100, axis=0) - 100
    assert set(late.tolist()) <= {1, *range(5, 30)}, "at once, or after a round trip"
    assert (late == 1).mean() == pytest.approx(0.7, abs=0.08)
    assert np.mean(late <= 5) == pytest.approx(1.0 - 0.3**2, abs=0.06)
    assert np.mean(late <= 7) == pytest.approx(1.0 - 0.3**3, abs=0.04)


def test_silence_grows_until_the_ground_is_heard_and_px4_lands_at_its_limit() -> None:
    events = np.zeros(100, dtype=bool)
    events[0] = True
    model, _ = flown("off", events, [7])
    assert np.flatnonzero(model.landed)[0] == 26, "0.25 s are still inside"
    heard, _ = flown("clean", events, [7])
    assert not heard.landed.any()
    assert heard.silence_s.max() == pytest.approx(0.02), "a beat every 30 ms"


@pytest.mark.parametrize(("sentence", "age_s"), [("clean", 0.0), ("delay 2 ms", 0.01), ("delay 20 ms", 0.02)])
def test_the_age_of_a_message_counts_until_a_cycle_uses_it(sentence: str, age_s: float) -> None:
    assert measured_up_age_s(radio_named(sentence), LinkTiming(), PERIOD_S) == pytest.approx(age_s)


def test_no_message_has_no_age() -> None:
    assert np.isnan(measured_up_age_s(radio_named("off"), LinkTiming(), PERIOD_S))
