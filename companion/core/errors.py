"""Exceptions that reach an operator; imports nothing, so that a command line starts at once."""


class CompanionError(Exception):
    """An error whose message is one sentence for the operator: what is wrong, where, and what to do."""


class ConfigError(CompanionError):
    """A configuration or trajectory file that cannot be used."""


class MocapError(CompanionError):
    """A motion-capture source that cannot be reached, or that does not know the body."""


class AutopilotError(CompanionError):
    """An autopilot that cannot be reached, or that rejects a command."""


class FlightError(CompanionError):
    """A flight that did not do what was commanded; the message says why."""


class ArmError(CompanionError):
    """A servo bus that cannot be reached, a missing or wrong servo, or a rejected motion of the arms."""
