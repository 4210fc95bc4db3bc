"""Sentences for the radio between a law on the ground and its vehicle."""

from companion.core.interfaces import ConfigError
from mock_autopilot.impairment.sentences import Directions, ImpairmentError, parse_directions


def radio_named(sentence: str | None) -> Directions:
    """Return the impairments of both directions, none without a sentence; ConfigError for one that is none."""
    if sentence is None:
        return Directions()
    try:
        return parse_directions(sentence)
    except ImpairmentError as error:
        raise ConfigError(f"--link {sentence!r}: {error}") from None


def words_of(radio: Directions) -> str:
    """Return the sentence of a radio."""
    return str(radio.up) if radio.up == radio.down else f"up {radio.up}; down {radio.down}"
