"""Faults as sentences: "mocap stuck at 12 s for 2 s"."""

import re
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from mock_autopilot.faults.catalogue import WAYS, Kind, Part, Phase, Way, ways_of
from mock_autopilot.faults.fault import Fault
from mock_autopilot.faults.mistakes import did_you_mean, mistaken_number, nearest_phrase

_NUMBER = r"(?P<value>[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?)"
_SECONDS = rf"{_NUMBER}\s*s"
_NEXT = rf"(?=\s*$|\s+(?:(?:by|to|with|at|after|for)\s|{'|'.join(Phase)}))"
_CLAUSES = {
    "amount": re.compile(rf"(?P<word>by|to|with)\s+{_NUMBER}(?:\s*(?P<unit>m/s|m|rad|s|hz|v|kb/s))?{_NEXT}"),
    "at_s": re.compile(rf"at\s+{_SECONDS}(?=\s|$)"),
    "phase": re.compile(rf"(?P<phase>{'|'.join(Phase)})(?=\s|$)"),
    "after_s": re.compile(rf"after\s+{_SECONDS}(?=\s|$)"),
    "for_s": re.compile(rf"for\s+{_SECONDS}(?=\s|$)"),
}
_POSSIBLE = (
    'after that may come an amount ("by 0.5 m"), a time from lift-off ("at 12 s") or a phase '
    f'({", ".join(Phase)}; "after 3 s" of it), and how long ("for 2 s")'
)
_VEHICLE = re.compile(r"vehicle\s+(?P<number>\d+)\s*:\s*(?P<rest>.*)")
_HEAD = re.compile(r"(?P<part>\S+)(?:\s+(?P<kind>[^\s(]+))?\s*(?:\((?P<how>[^()]*)\))?\s*(?P<rest>.*)")


class FaultError(ValueError):
    """The sentence names no fault; the message is one sentence with the mistake and the possible words."""


def parse(sentence: str) -> Fault:
    """Return the fault that a sentence names; raise FaultError when it names none."""
    try:
        return Fault.model_validate(keys_of(sentence))
    except ValidationError as error:
        raise FaultError(_said(error.errors()[0], sentence)) from None


_TIMES = {
    "at_s": ("at", "times count from lift-off, 0 s or later"),
    "after_s": ("after", "times count from the phase's begin, 0 s or later"),
    "for_s": ("for", "it must last longer than 0 s; without, it is for ever"),
}


def _said(mistake: ErrorDetails, sentence: str) -> str:
    word, wanted = _TIMES.get(str(mistake["loc"][0]) if mistake["loc"] else "", ("", ""))
    if not word:
        said = mistake["msg"].removeprefix("Value error, ")
        return f"{said}{did_you_mean(nearest_phrase(sentence))}" if "does not know" in said else said
    too_long = mistake["type"] == "less_than_equal"
    return f'"{word} {mistake["input"]:g} s": {"at most 100000 s can be waited for" if too_long else wanted}'


def keys_of(sentence: str) -> dict[str, Any]:
    """Return a sentence as the keys of `Fault`, which checks their values; raise FaultError if it cannot be parsed."""
    whose = _VEHICLE.fullmatch(" ".join(sentence.lower().split()))
    if whose is not None:
        return {**_keys_of_one(whose["rest"]), "vehicle": int(whose["number"])}
    return _keys_of_one(sentence)


def _keys_of_one(sentence: str) -> dict[str, Any]:
    head = _HEAD.fullmatch(" ".join(sentence.lower().split()))
    if head is None:
        raise FaultError(f'an empty sentence is no fault; one is "{EXAMPLES[0]}"')
    if head["part"] not in list(Part):
        raise FaultError(
            f'"{head["part"]}" is no part; possible: {", ".join(Part)}{did_you_mean(nearest_phrase(head[0]))}'
        )
    part, kind = Part(head["part"]), head["kind"] or ""
    known = list(dict.fromkeys(way.kind for way in WAYS if way.part is part))
    if kind not in known:
        cannot = f'{part} cannot be "{kind}"; it' if kind else f"what is wrong with {part}? It"
        raise FaultError(f"{cannot} can be {', '.join(known)}{did_you_mean(nearest_phrase(head[0])) if kind else ''}")
    keys: dict[str, Any] = {"part": part, "kind": Kind(kind), "how": (head["how"] or "").strip()}
    _take_clauses(head["rest"], keys, head[0])
    return keys


def _take_clauses(rest: str, keys: dict[str, Any], sentence: str) -> None:
    begun = False
    while rest := rest.strip():
        key, match = next(((key, said) for key, clause in _CLAUSES.items() if (said := clause.match(rest))), ("", None))
        if match is None:
            way = _way_of(keys)
            why = mistaken_number(rest, way.words, way.amount.unit if way.amount else None) if way else ""
            near = "" if begun or why else nearest_phrase(sentence)
            raise FaultError(why or f'"{rest}" is not understood{did_you_mean(near) or f"; {_POSSIBLE}"}')
        begun = True
        if key in keys:
            raise FaultError(f'"{match[0]}" says a second time what was said before')
        keys[key] = Phase(match["phase"]) if key == "phase" else float(match["value"])
        if key == "amount":
            _check_unit(match["unit"], keys)
        rest = rest[match.end() :]


def _check_unit(unit: str | None, keys: dict[str, Any]) -> None:
    way = _way_of(keys)
    if unit and way is not None and way.amount is not None and unit != way.amount.unit.lower():
        wants = f"is in {way.amount.unit}" if way.amount.unit else "is a share and has no unit"
        raise FaultError(f'the amount of "{way.words}" {wants}, not in {unit}')


def _way_of(keys: dict[str, Any]) -> Way | None:
    return next((way for way in ways_of(keys["part"], keys["kind"]) if way.how == keys["how"]), None)


def sentence_of(fault: Fault) -> str:
    """Return the fault as a sentence that `parse` accepts."""
    words = [f"vehicle {fault.vehicle}:"] if fault.vehicle is not None else []
    words.append(fault.way.words)
    if fault.way.amount is not None:
        words.append(fault.way.amount.text(fault.magnitude))
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
    "vehicle 2: mocap wrong (lost) at 20 s",
)
