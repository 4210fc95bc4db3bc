"""Suggestions for a sentence that names no fault: the nearest phrase, the missing unit, the right unit."""

import difflib
import math
import re

from mock_autopilot.faults.catalogue import WAYS, Phase, Way

_TAIL = re.compile(rf"\s(?:(?:at|for|after|by|to|with)\s+[-+]?\d|(?:{'|'.join(Phase)})(?:\s|$)).*")
_NEAR = 0.75
_IN = {
    "ms": ("s", 1e-3),
    "sec": ("s", 1.0),
    "seconds": ("s", 1.0),
    "second": ("s", 1.0),
    "min": ("s", 60.0),
    "minutes": ("s", 60.0),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "deg": ("rad", math.pi / 180.0),
    "degrees": ("rad", math.pi / 180.0),
    "%": ("", 1e-2),
}
"""Other units: the one to use instead, and the factor."""
_NUMBER = re.compile(
    r"(?P<word>at|after|for|by|to|with)\s+(?P<value>[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?)\s*(?P<unit>[a-z/%]*)(?=\s|$)"
)
_TIMES = {"at", "after", "for"}


def nearest_phrase(sentence: str) -> str:
    """Return the first words of the fault's sentence that looks most like this one; empty when none does."""
    said = _plain(_TAIL.sub("", f"{sentence.lower()} "))
    part, _, rest = said.partition(" ")
    ways = [way for way in WAYS if way.part == part]
    if ways:  # the part is known: it must not make everything look alike
        return _nearest(rest, {phrase: way.words for way in reversed(ways) for phrase in _phrases(way)})
    return _nearest(
        said, {f"{way.part} {phrase}": way.words for way in reversed(WAYS) for phrase in _phrases(way)}
    ) or (_nearest(said, {way.how: way.words for way in reversed(WAYS) if way.how}))


def _nearest(said: str, phrases: dict[str, str]) -> str:
    near = difflib.get_close_matches(said, phrases, n=1, cutoff=_NEAR)
    return phrases[near[0]] if near else ""


def did_you_mean(phrase: str) -> str:
    """Return the suggestion that is appended to an error message; empty when there is no phrase to suggest."""
    return f'; did you mean "{phrase}"?' if phrase else ""


def _phrases(way: Way) -> tuple[str, ...]:
    """Return the phrases accepted after the part's name: kind and variant, or the variant alone."""
    return (f"{way.kind} {way.how}", way.how) if way.how else (str(way.kind),)


def _plain(text: str) -> str:
    return " ".join(text.replace("(", " ").replace(")", " ").split())


def mistaken_number(rest: str, words: str, unit: str | None) -> str:
    """Return the error in the number that `rest` begins with; empty when it begins with none.

    `words` are the fault's first words, `unit` is its amount's: empty for a share, None without an amount.
    """
    said = _NUMBER.match(rest)
    if said is None:
        return ""
    word, value, given = said["word"], float(said["value"]), said["unit"]
    wanted = "s" if word in _TIMES else unit
    if wanted is None:
        return f"{words} has no amount, so leave out {said[0]}"
    number = value * _IN[given][1] if given in _IN and _IN[given][0] == wanted else value
    right = f'"{word} {number:g}{f" {wanted}" if wanted else ""}"'
    what = "times are" if word in _TIMES else f'the amount of "{words}" is'
    if not given:
        return f'"{said[0]}": {value:g} what? {what[0].upper()}{what[1:]} in {wanted}: {right}'
    return f'"{said[0]}": {what} {f"in {wanted}" if wanted else "a share and has no unit"}: {right}'
