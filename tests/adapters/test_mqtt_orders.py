"""Which bytes are an order, and what the [operator] table may say; no broker."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config_files import validate
from companion.config_operator import OperatorConfig
from companion.operator_orders import MAX_BYTES, Order, OrderKind, Orders, Refusal
from companion.ports import ConfigError

NOW_S = 1.8e9


def payload(**changes: Any) -> bytes:
    return json.dumps({"order": "hold", "id": "a-1", "sent_s": NOW_S} | changes).encode()


def refusal(said: bytes) -> str:
    taken = Orders().take(said, NOW_S)
    assert isinstance(taken, Refusal)
    return taken.reason


@pytest.mark.parametrize("kind", [kind for kind in OrderKind if kind is not OrderKind.KILL])
def test_a_good_order_is_taken(kind: OrderKind) -> None:
    assert Orders().take(payload(order=str(kind)), NOW_S + 0.1) == Order(kind, "a-1")


def test_kill_needs_its_confirmation_and_nothing_else_may_have_one() -> None:
    assert Orders().take(payload(order="kill", confirm="kill"), NOW_S) == Order(OrderKind.KILL, "a-1")
    assert 'it needs "confirm": "kill"' in refusal(payload(order="kill"))
    assert refusal(payload(order="kill", confirm=True)).startswith("confirm: ")
    assert "is kill meant?" in refusal(payload(order="abort", confirm="kill"))


def test_an_id_counts_once_and_a_refused_one_not_at_all() -> None:
    orders = Orders()
    assert isinstance(orders.take(payload(order="kill"), NOW_S), Refusal)
    assert isinstance(orders.take(payload(order="kill", confirm="kill"), NOW_S), Order)
    assert orders.take(payload(order="land"), NOW_S) == Refusal("this id was taken already", "a-1")


def test_ids_are_forgotten_in_the_end_and_not_before_a_hundred_others() -> None:
    orders = Orders()
    for number in range(2000):
        assert isinstance(orders.take(payload(id=f"n{number}"), NOW_S), Order)
        assert isinstance(orders.take(payload(id=f"n{max(0, number - 100)}"), NOW_S), Refusal)
    assert len(orders._taken) < 300


@pytest.mark.parametrize(("late_s", "counts"), [(4.9, True), (5.1, False), (-4.9, True), (-5.1, False), (-1e9, False)])
def test_an_order_is_for_now(late_s: float, counts: bool) -> None:
    taken = Orders().take(payload(sent_s=NOW_S - late_s), NOW_S)
    assert isinstance(taken, Order) is counts
    if isinstance(taken, Refusal):
        assert taken.id == "a-1"
        assert "clocks" in taken.reason


@pytest.mark.parametrize("late_s", [6.0, -6.0, 1e9, -1e9])
def test_what_ends_a_flight_counts_whatever_the_clocks_say_and_still_only_once(late_s: float) -> None:
    orders = Orders()
    kill = payload(order="kill", confirm="kill", sent_s=NOW_S - late_s)
    assert orders.take(kill, NOW_S) == Order(OrderKind.KILL, "a-1")
    assert orders.take(kill, NOW_S) == Refusal("this id was taken already", "a-1")
    assert isinstance(orders.take(payload(order="kill", id="a-2", sent_s=NOW_S - late_s), NOW_S), Refusal)
    abort = payload(order="abort", id="a-2", sent_s=NOW_S - late_s)
    assert orders.take(abort, NOW_S) == Order(OrderKind.ABORT, "a-2")
    for kind in ("hold", "land", "resume"):
        assert isinstance(orders.take(payload(order=kind, id="a-3", sent_s=NOW_S - late_s), NOW_S), Refusal)


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (b"", "Invalid JSON"),
        (b"abort", "Invalid JSON"),
        (b"\xff\xfe\x00", "Invalid JSON"),
        (b"[" * 4000, "Invalid JSON"),
        (b'"abort"', "Input should be an object"),
        (payload(order="arm"), "order: Input should be 'abort', 'kill', 'hold', 'land' or 'resume'"),
        (payload(order=None), "order: Input should be"),
        (payload(id=""), "id: String should match"),
        (payload(id="two\nlines"), "id: String should match"),
        (payload(id=7), "id: Input should be a valid string"),
        (payload(sent_s="now"), "sent_s: Input should be a valid number"),
        (payload(sent_s=True), "sent_s: Input should be a valid number"),
        (payload(sent_s=float("nan")), "sent_s: Input should be a finite number"),
        (payload(sent_s=1e300), "sent_s: Input should be less than"),
        (payload(height_m=2.0), "height_m: Extra inputs are not permitted"),
        (b'{"order": "hold", "id": "a"}', "sent_s: Field required"),
        (payload(note="x" * MAX_BYTES), "bytes are no order: at most 4096"),
    ],
)
def test_all_else_is_refused_with_a_short_reason(said: bytes, reason: str) -> None:
    assert reason in refusal(said)
    assert len(refusal(said)) <= 200


@given(st.binary(max_size=300) | st.text().map(str.encode))
def test_garbage_is_never_an_order(said: bytes) -> None:
    assert isinstance(Orders().take(said, NOW_S), Refusal)


@given(st.data())
def test_a_broken_order_is_refused_or_the_order_it_was(data: st.DataObject) -> None:
    """Bits flipped, bytes cut out, put in or doubled: never another kind of order, and never a kill."""
    kind = data.draw(st.sampled_from(["abort", "hold", "land", "resume"]))
    said = bytearray(payload(order=kind))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(said) - 1))
        piece = data.draw(st.sampled_from(["flip", "cut", "put", "double"]))
        if piece == "flip":
            said[at] ^= 1 << data.draw(st.integers(0, 7))
        elif piece == "cut":
            del said[at : at + data.draw(st.integers(1, 30))]
        elif piece == "put":
            said[at:at] = data.draw(st.binary(min_size=1, max_size=5))
        else:
            said[at:at] = said[at : at + 40]
        said = said or bytearray(b" ")
    taken = Orders().take(bytes(said), NOW_S)
    assert isinstance(taken, Refusal) or taken.kind == kind


@given(st.recursive(st.none() | st.booleans() | st.floats() | st.integers() | st.text(), st.lists, max_leaves=5))
def test_any_json_in_any_field_is_refused_or_valid(value: Any) -> None:
    for field in ("order", "id", "sent_s", "confirm"):
        taken = Orders().take(payload(**{field: value}), NOW_S)
        assert isinstance(taken, (Order, Refusal))


@pytest.mark.parametrize("name", ["", "a/b", "+", "#", "$SYS", "näh", "x" * 33, "a b"])
def test_a_name_that_is_no_part_of_a_topic_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=r"operator\.vehicle = .*: must be 1 to 32 letters"):
        validate(OperatorConfig, {"vehicle": name}, Path("mine.toml"), "operator")


def test_topics_hold_prefix_and_vehicle() -> None:
    assert OperatorConfig(prefix="lab-2", vehicle="dauam_1").topic("order") == "lab-2/dauam_1/order"
