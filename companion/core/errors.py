"""The few exceptions that reach an operator; imports nothing, so that a command line can begin at once."""


class CompanionError(Exception):
    """A sentence for the operator: what is wrong, where, and what would be right."""


class ConfigError(CompanionError):
    """A configuration or trajectory file cannot be used."""


class MocapError(CompanionError):
    """The motion-capture source cannot be reached, or does not know the body."""


class AutopilotError(CompanionError):
    """The autopilot cannot be reached, or refuses."""


class FlightError(CompanionError):
    """A flight did not do what was asked; says why."""


class ArmError(CompanionError):
    """The servo bus cannot be reached, a servo is missing or wrong, or a motion of the arms is refused."""
