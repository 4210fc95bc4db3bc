"""The bench's arithmetic: pairing, percentiles, targets, and what it calls a setpoint."""

import pytest

from benchmarks.figures import calmest_median_us, match, spread, within
from benchmarks.peer import is_setpoint
from benchmarks.relay import _setpoint
from benchmarks.steps import StepCost
from benchmarks.synthetic import motion
from benchmarks.targets import Target, step_targets


@pytest.mark.parametrize(
    ("asked", "answered", "delays", "unanswered", "because"),
    [
        ([0.0, 1.0, 2.0], [0.1, 1.2, 2.3], (0.1, 0.2, 0.3), 0, "one answer each"),
        ([0.0, 1.0, 2.0], [0.1, 2.3], (0.1, 0.3), 1, "an answer after the next question is that one's"),
        ([0.0, 1.0], [0.1, 0.5, 1.2], (0.1, 0.2), 0, "only the first answer counts"),
        ([1.0, 2.0], [0.5, 1.2, 2.1], (0.2, 0.1), 0, "what came before the first question answers nothing"),
        ([0.0, 1.0], [0.1], (0.1,), 0, "the last question may have been asked at the very end"),
        ([0.0], [0.0], (), 0, "an answer takes time"),
        ([], [0.1], (), 0, "no questions"),
        ([0.0, 1.0], [], (), 1, "no answers"),
    ],
)
def test_a_question_belongs_to_the_first_answer_before_the_next_question(
    asked: list[float], answered: list[float], delays: tuple[float, ...], unanswered: int, because: str
) -> None:
    found = match(asked, answered)
    assert found.delays_s == pytest.approx(delays), because
    assert found.unanswered == unanswered, because


def test_a_spread_is_percentiles() -> None:
    found = spread([float(n) for n in range(101)])
    assert (found.count, found.least, found.median, found.p90, found.p99, found.most) == (101, 0, 50, 90, 99, 100)


def test_nothing_has_no_spread() -> None:
    with pytest.raises(ValueError, match="nothing was measured"):
        spread([])


def test_a_window_holds_its_start_and_not_its_end() -> None:
    assert within([0.9, 1.0, 1.5, 2.0], 1.0, 2.0) == [1.0, 1.5]


def test_calls_are_numbered_anew_in_each_round() -> None:
    numbers: list[int] = []
    assert calmest_median_us(numbers.append, calls=3, rounds=2) >= 0.0
    assert numbers == [0, 1, 2, 0, 1, 2]


def test_a_bound_is_met_by_itself() -> None:
    assert Target("a", 1.0, 1.0).met
    assert not Target("a", 1.1, 1.0).met
    assert Target("a", 1.0, 1.0, at_least=True).met
    assert not Target("a", 0.9, 1.0, at_least=True).met


def test_the_gain_of_a_batch_is_a_vehicle_alone_over_one_of_many() -> None:
    costs = [StepCost("law", 1, 100.0), StepCost("law", 10_000, 5_000.0)]
    one, gain = step_targets(costs)
    assert one.value == 100.0
    assert gain.value == pytest.approx(200.0)
    assert gain.met


def test_the_relays_frame_is_a_setpoint_and_a_heartbeat_is_none() -> None:
    from pymavlink.dialects.v20 import common as mavlink

    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(codec)
    assert is_setpoint(_setpoint(bytes(92), codec))
    assert not is_setpoint(bytes(heartbeat))
    assert not is_setpoint(b"")


def test_made_up_vehicles_broadcast_and_are_all_different() -> None:
    one, many = motion((), 0.01).input(3), motion((5,), 0.01).input(3)
    assert one.position_w_m.shape == (3,)
    assert many.position_w_m.shape == (5, 3)
    assert many.q_w_flu_wxyz.shape == (5, 4)
    assert len({tuple(row) for row in many.position_w_m.tolist()}) == 5
