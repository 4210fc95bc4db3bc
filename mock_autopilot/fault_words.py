"""Faults as sentences: "mocap stuck at 12 s for 2 s"."""

import re
from typing import Any

from pydantic import ValidationError

from mock_autopilot.fault_ways import WAYS, Kind, Part, Phase, ways_of
from mock_autopilot.faults import Fault

_NUMBER = r"(?P<value>[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?)"
_SECONDS = rf"{_NUMBER}\s*s"
_CLAUSES = {
    "amount": re.compile(rf"(?P<word>by|to|with)\s+{_NUMBER}(?:\s*(?P<unit>m/s|m|rad|s|hz|v)(?![a-z/]))?(?=\s|$)"),
    "at_s": re.compile(rf"at\s+{_SECONDS}(?=\s|$)"),
    "phase": re.compile(rf"(?P<phase>{'|'.join(Phase)})(?=\s|$)"),
    "after_s": re.compile(rf"after\s+{_SECONDS}(?=\s|$)"),
    "for_s": re.compile(rf"for\s+{_SECONDS}(?=\s|$)"),
}
_POSSIBLE = (
    'after that may come an amount ("by 0.5 m"), a time from lift-off ("at 12 s") or a phase '
    f'({", ".join(Phase)}; "after 3 s" of it), and how long ("for 2 s")'
)
_HEAD = re.compile(r"(?P<part>\S+)(?:\s+(?P<kind>[^\s(]+))?\s*(?:\((?P<how>[^()]*)\))?\s*(?P<rest>.*)")


class FaultError(ValueError):
    """The sentence says no fault; the message is one sentence that says what is wrong and what is possible."""


def parse(sentence: str) -> Fault:
    """The fault that a sentence says; FaultError when it says none."""
    try:
        return Fault.model_validate(keys_of(sentence))
    except ValidationError as error:
        raise FaultError(error.errors()[0]["msg"].removeprefix("Value error, ")) from None


def keys_of(sentence: str) -> dict[str, Any]:
    """A sentence as the keys of `Fault`, which checks what they say; FaultError when it is not understood."""
    head = _HEAD.fullmatch(" ".join(sentence.lower().split()))
    if head is None:
        raise FaultError(f'an empty sentence is no fault; one is "{EXAMPLES[0]}"')
    part, kind = _word(head["part"], Part, "part"), head["kind"] or ""
    known = list(dict.fromkeys(way.kind for way in WAYS if way.part is part))
    if kind not in known:
        raise FaultError(f'{part} cannot be "{kind}"; it can be {", ".join(known)}')
    keys: dict[str, Any] = {"part": part, "kind": Kind(kind), "how": (head["how"] or "").strip()}
    _take_clauses(head["rest"], keys)
    return keys


def _word(text: str, words: type[Part], what: str) -> Part:
    if text not in list(words):
        raise FaultError(f'"{text}" is no {what}; possible: {", ".join(words)}')
    return words(text)


def _take_clauses(rest: str, keys: dict[str, Any]) -> None:
    while rest := rest.strip():
        key, match = next(((key, said) for key, clause in _CLAUSES.items() if (said := clause.match(rest))), ("", None))
        if match is None:
            raise FaultError(f'"{rest}" is not understood; {_POSSIBLE}')
        if key in keys:
            raise FaultError(f'"{match[0]}" says a second time what was said before')
        keys[key] = Phase(match["phase"]) if key == "phase" else float(match["value"])
        if key == "amount":
            _check_unit(match["unit"], keys)
        rest = rest[match.end() :]


def _check_unit(unit: str | None, keys: dict[str, Any]) -> None:
    way = next((way for way in ways_of(keys["part"], keys["kind"]) if way.how == keys["how"]), None)
    if unit and way is not None and way.amount is not None and unit != way.amount.unit.lower():
        wants = f"is in {way.amount.unit}" if way.amount.unit else "is a share and has no unit"
        raise FaultError(f'the amount of "{way.words}" {wants}, not in {unit}')


def sentence_of(fault: Fault) -> str:
    """The fault in words; `parse` understands them."""
    words = [fault.way.words]
    if fault.way.amount is not None:
        words.append(fault.way.amount.text(fault.much))
    if fault.at_s is not None:
        words.append(f"at {fault.at_s:g} s")
    if fault.phase is not None:
        words.append(f"{fault.phase}{f' after {fault.after_s:g} s' if fault.after_s else ''}")
    if fault.for_s < float("inf"):
        words.append(f"for {fault.for_s:g} s")
    return " ".join(words)


EXAMPLES = (
    "mocap stuck at 12 s for 2 s",
    "mocap wrong (mirrored) in the air after 3 s",
    "link delayed by 0.2 s at 10 s",
    "autopilot wrong (pilot takes over) at 8 s",
    "servos off landing",
)
