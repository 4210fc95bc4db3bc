"""The window of sequence numbers, against the rules of RFC 4303, section 3.4.3, written down plainly."""

from hypothesis import example, given
from hypothesis import strategies as st

from companion.law_link.sequence_window import Order, SequenceWindow

WIDTH = 64
"""RFC 4303: at least 32 must be supported, 64 is preferred."""


def by_the_rfc(before: list[int], sequence: int) -> Order:
    """Return what the RFC says of a packet after those that were accepted before."""
    right_edge = max(before, default=0)
    if sequence > right_edge:
        return Order.NEWEST
    if sequence <= right_edge - WIDTH or sequence in before:
        return Order.REPEATED
    return Order.LATE


@given(st.lists(st.integers(1, 200), max_size=120))
@example([1, 65, 1])
@example([1, 64, 1])
@example([65, 1, 2])
@example([64, 1, 1])
@example([1, 2**31, 2**31 - 63, 2**31 - 64])
@example([1, 1])
def test_every_order_of_arrival_is_judged_as_the_rfc_says(arrivals: list[int]) -> None:
    window, accepted = SequenceWindow(), list[int]()
    for sequence in arrivals:
        expected = by_the_rfc(accepted, sequence)
        assert window.take(sequence) is expected, (arrivals, sequence)
        if expected is not Order.REPEATED:
            accepted.append(sequence)


@given(st.lists(st.integers(1, 2**32 - 1), max_size=60))
def test_no_sequence_is_accepted_twice(arrivals: list[int]) -> None:
    window = SequenceWindow()
    passed = [sequence for sequence in arrivals if window.take(sequence) is not Order.REPEATED]
    assert len(passed) == len(set(passed))


def test_a_gap_is_filled_by_what_comes_late() -> None:
    window = SequenceWindow()
    assert [window.take(sequence) for sequence in (1, 4, 2, 3, 3, 5)] == [
        Order.NEWEST, Order.NEWEST, Order.LATE, Order.LATE, Order.REPEATED, Order.NEWEST,
    ]  # fmt: skip
    assert window.newest == 5
