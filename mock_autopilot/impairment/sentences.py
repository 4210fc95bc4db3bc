"""Impairments as sentences: "loss 10% jitter 20 ms"; pure."""

import re
from dataclasses import dataclass

from mock_autopilot.impairment.model import CLEAN, CUT, Impairment

EXAMPLES = ("loss 10% jitter 20 ms", "loss 30% burst 100 ms delay 5 ms", "rate 100 kB/s", "reorder 5%")
_POSSIBLE = (
    'possible: "loss 10%", "loss 30% burst 100 ms", "delay 5 ms", "jitter 20 ms", "reorder 5%", "duplicate 5%", '
    '"rate 100 kB/s", or alone "clean" or "off"'
)
_NEXT = r"(?:loss|burst|delay|jitter|reorder|duplicate|rate|clean|off)\b"
_NUMBER = r"(?P<value>\d+(?:\.\d*)?|\.\d+)"
_CLAUSE = re.compile(
    rf"(?P<word>[a-z]+)\s*(?:{_NUMBER}\s*(?P<unit>%|[a-z]+(?:/s)?)?)?(?=[\s,;]|$)[\s,]*", re.IGNORECASE
)
_SHARES = {"%": 0.01}
_TIMES = {"ms": 1e-3, "s": 1.0}
_RATES = {"b/s": 1.0, "kb/s": 1e3, "mb/s": 1e6, "kbit/s": 125.0, "mbit/s": 125e3}
_WORDS = {
    "loss": ("loss_share", _SHARES, "%", "10%"),
    "burst": ("burst_s", _TIMES, "ms or s", "100 ms"),
    "delay": ("delay_s", _TIMES, "ms or s", "5 ms"),
    "jitter": ("jitter_s", _TIMES, "ms or s", "20 ms"),
    "reorder": ("reorder_share", _SHARES, "%", "5%"),
    "duplicate": ("duplicate_share", _SHARES, "%", "5%"),
    "rate": ("rate_bytes_per_s", _RATES, "B/s, kB/s, MB/s, kbit/s or Mbit/s", "100 kB/s"),
}
"""Field, factors of the units, the units in words, an example."""


class ImpairmentError(ValueError):
    """The sentence is no impairment; the message is one sentence with the mistake and the possible words."""


def parse(sentence: str) -> Impairment:
    """Return the impairment that a sentence describes; raise ImpairmentError when it describes none."""
    said = sentence.strip()
    if said.lower() in _ALONE:
        return _ALONE[said.lower()]
    if not said:
        raise ImpairmentError(f'an empty sentence is no impairment; one is "{EXAMPLES[0]}", and a perfect link "clean"')
    values: dict[str, float] = {}
    clauses = _clauses(said)
    for number, (text, word, value) in enumerate(clauses):
        following = clauses[number + 1][1] if number + 1 < len(clauses) else ""
        if word == "burst" and (number == 0 or clauses[number - 1][1] != "loss"):
            raise ImpairmentError(f'"{text}" follows the loss whose length it says, as in "{EXAMPLES[1]}"')
        field = "burst_share" if (word, following) == ("loss", "burst") else _WORDS[word][0]
        if field in values:
            raise ImpairmentError(f'"{text}" says a second time what was said before')
        _check_range(text, field, value)
        values[field] = value
    return Impairment(**values)


_ALONE = {"clean": CLEAN, "off": CUT}


def _clauses(said: str) -> list[tuple[str, str, float]]:
    """Return text, word and value (in the field's unit) of each clause."""
    clauses, at = [], 0
    while at < len(said):
        clause = _CLAUSE.match(said, at)
        if clause is None:
            raise ImpairmentError(f'"{said[at:]}" is not understood; {_POSSIBLE}')
        text, word = clause[0].strip(" ,"), clause["word"].lower()
        if word not in _WORDS:
            raise ImpairmentError(f'"{word}" {"stands alone" if word in _ALONE else "is no impairment"}; {_POSSIBLE}')
        clauses.append((text, word, _value(text, word, clause)))
        at = clause.end()
    return clauses


def _value(text: str, word: str, clause: re.Match[str]) -> float:
    _, factors, units, example = _WORDS[word]
    if clause["value"] is None:
        raise ImpairmentError(f'"{text}": how much? Say it in {units}: "{word} {example}"')
    unit = (clause["unit"] or "").lower()
    if unit not in factors:
        raise ImpairmentError(f'"{text}": {word} is in {units}: "{word} {example}"')
    return float(clause["value"]) * factors[unit]


def _check_range(text: str, field: str, value: float) -> None:
    if field.endswith("_share") and value > 1.0:
        raise ImpairmentError(f'"{text}": at most 100% can be')
    if field == "reorder_share" and value > 0.5:
        raise ImpairmentError(f'"{text}": at most 50% of the datagrams can arrive behind their successor')
    if field == "rate_bytes_per_s" and value == 0.0:
        raise ImpairmentError(f'"{text}": nothing would pass; say "off"')
    if field == "burst_s" and value == 0.0:
        raise ImpairmentError(f'"{text}": a burst lasts longer than 0 s; without "burst" each is lost by itself')


@dataclass(frozen=True)
class Directions:
    """Impairment of both directions of a link: `up` from the client to the server, `down` back."""

    up: Impairment = CLEAN
    down: Impairment = CLEAN


_DIRECTED = re.compile(r"(?P<way>up|down|both)\s*:?\s+(?P<rest>.*)", re.IGNORECASE | re.DOTALL)


def parse_directions(text: str, before: Directions | None = None) -> Directions:
    """Return both directions' impairments: "loss 10%" for both, "up loss 10%; down delay 5 ms" each by itself.

    A direction that is not named keeps its impairment of `before`. Raises ImpairmentError.
    """
    now = before or Directions()
    for part in text.split(";"):
        said = _DIRECTED.fullmatch(part.strip())
        way, sentence = (said["way"].lower(), said["rest"]) if said else ("both", part)
        one = parse(sentence)
        now = Directions(now.up if way == "down" else one, now.down if way == "up" else one)
    return now
