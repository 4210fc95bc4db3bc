"""Errors between an operator and the service; each message is one sentence, with the service's own reason."""

from typing import TYPE_CHECKING

from companion.core.errors import CompanionError

if TYPE_CHECKING:
    from companion.protocol.check import Check
    from companion.protocol.telemetry import Reply


class VehicleError(CompanionError):
    """A command that did not end as ordered, or a vehicle that cannot be reached."""


class NoServiceError(VehicleError):
    """Failure to find a broker, or a service on it; nothing was sent."""


class UnknownOutcomeError(VehicleError):
    """Loss of the replies to a command: it may have been carried out, and its end is not known."""


class TimedOutError(UnknownOutcomeError, TimeoutError):
    """Expiry of a time limit; the vehicle continues what it was ordered."""


class _RepliedError(VehicleError):
    """A negative reply of the service to a command."""

    def __init__(self, verb: str, reply: "Reply") -> None:
        super().__init__(reply.sentence(verb))
        self.verb, self.reason = verb, reply.text
        """Command, and the service's reason."""
        self._data = reply.data

    @property
    def checks(self) -> "tuple[Check, ...]":
        """Results of a preflight, in their order; empty for any other command."""
        from companion.protocol.check import checks_of  # noqa: PLC0415 - not for a command line's start

        return checks_of(self._data)


class RejectedError(_RepliedError):
    """Rejection by the service: the command was not begun, and nothing has changed."""


class FailedError(_RepliedError):
    """A command that was begun and not completed."""
