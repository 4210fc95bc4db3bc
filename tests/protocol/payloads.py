"""Commands good and bad, as bytes; no broker."""

import json
from typing import Any

from hypothesis import strategies as st

SESSION = "0123456789abcdef"
NOW_S = 1.8e9
GOOD: dict[str, dict[str, Any]] = {
    "preflight": {},
    "arm": {},
    "takeoff": {"height_m": 1.5},
    "hold": {},
    "goto": {"x_m": 0.5, "y_m": -0.5, "z_m": 1.0, "yaw_rad": 0.1},
    "track": {"curve": "figure8", "laps": 1, "period_s": 20.0, "size": 0.5, "height_m": 1.2, "arms": "wave"},
    "arms": {"do": "play", "motion": "wave"},
    "controller": {"name": "pid"},
    "land": {},
    "abort": {},
    "resume": {},
    "kill": {"confirm": "kill"},
    "disarm": {},
    "params": {},
}
"""Every verb, and fields with which it is a command."""


def payload(verb: Any = "hold", **changes: Any) -> bytes:
    """A good command, but for the changes."""
    said = {"verb": verb, "id": "a-1", "session": SESSION, "sent_s": NOW_S}
    return json.dumps(said | GOOD.get(verb, {}) | changes).encode()


_ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@st.composite
def _spoilt(draw: st.DrawFn) -> bytes:
    """A good command of which one field is missing, something else, or one too many."""
    verb = draw(st.sampled_from(list(GOOD)))
    said = json.loads(payload(verb))
    names = [*said, "reply_to"]
    match draw(st.sampled_from(["missing", "other", "more"])):
        case "missing":
            del said[draw(st.sampled_from(["verb", "id", "session", "sent_s"]))]
        case "other":
            said[draw(st.sampled_from(names))] = draw(_ANY_JSON)
        case _:
            said[draw(st.text(min_size=1, max_size=12).filter(lambda name: name not in names))] = draw(_ANY_JSON)
    return json.dumps(said).encode()


@st.composite
def _broken(draw: st.DrawFn) -> bytes:
    """A good command with bits flipped, bytes cut out, put in or doubled."""
    said = bytearray(payload(draw(st.sampled_from(list(GOOD)))))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(said) - 1))
        match draw(st.sampled_from(["flip", "cut", "put", "double"])):
            case "flip":
                said[at] ^= 1 << draw(st.integers(0, 7))
            case "cut":
                del said[at : at + draw(st.integers(1, 30))]
            case "put":
                said[at:at] = draw(st.binary(min_size=1, max_size=5))
            case _:
                said[at:at] = said[at : at + 40]
        said = said or bytearray(b" ")
    return bytes(said)


_BAD = (
    st.binary(max_size=300)
    | st.text().map(str.encode)
    | _ANY_JSON.map(json.dumps).map(str.encode)
    | _spoilt()
    | _broken()
)


@st.composite
def bad_payloads(draw: st.DrawFn) -> list[bytes]:
    """Ten of a kind: one, and what becomes of it when it is cut short, or a byte of it is another.

    Very few are commands still, or again: with another letter in the id, say.
    """
    first = draw(_BAD)
    where = draw(st.binary(min_size=18, max_size=18))
    return [first, *(_cut_or_changed(first, *where[at : at + 2]) for at in range(0, 18, 2))]


def _cut_or_changed(said: bytes, where: int, other: int) -> bytes:
    at = where * len(said) // 256
    return said[:at] if other % 3 == 0 else said[:at] + bytes([other]) + said[at + 1 :]
