"""Vehicle as a script sees it: its newest state, and streams of what it says."""

import asyncio
import math
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from typing import TYPE_CHECKING, TypeVar

from companion.client.client import Console
from companion.client.errors import NoServiceError, TimedOutError
from companion.client.pending_command import known_of
from companion.protocol.telemetry import Happened, State

if TYPE_CHECKING:
    from companion.core.types import Array

SILENCE_S = 15.0
"""Time without a state after which a stream ends with an error; within it a broken connection may come back."""
M = TypeVar("M", State, Happened)


class VehicleView:
    """Everything of a vehicle that commands nothing."""

    def __init__(self, console: Console) -> None:
        self.console = console
        """Connection to the broker, for what this class does not offer."""
        self.timeout_s = math.inf
        """Time limit of a command or a wait that has none of its own."""

    @property
    def name(self) -> str:
        """Name of the vehicle on the broker."""
        return self.console.vehicle

    @property
    def state(self) -> State:
        """Newest state, ten times a second; `state_age_s` tells how old it is."""
        state = self.console.state
        assert state is not None, "connect waits for the first one"
        return state

    @property
    def state_age_s(self) -> float:
        """Age of the newest state, s: more than 1 means that the vehicle is not heard."""
        return self.console.state_age_s()

    @property
    def position_w_m(self) -> "Array":
        """Newest position in W, m, (3,); NaN while it is not known."""
        return _vector(self.state.position_w_m)

    @property
    def velocity_w_mps(self) -> "Array":
        """Newest velocity in W, m/s, (3,); NaN while it is not known."""
        return _vector(self.state.velocity_w_mps)

    @property
    def reference_w_m(self) -> "Array":
        """Newest position of the reference in W, m, (3,); NaN while there is none."""
        return _vector(self.state.reference_w_m)

    def states(self, *, silence_s: float = SILENCE_S) -> AsyncGenerator[State, None]:
        """Yield every state from now on, ten a second; NoServiceError when none comes for `silence_s`."""
        return self._stream(State, silence_s)

    def events(self, *, silence_s: float = SILENCE_S) -> AsyncGenerator[Happened, None]:
        """Yield phases, faults, commands and replies as they happen; NoServiceError as with `states`."""
        return self._stream(Happened, silence_s)

    async def wait_until(self, condition: Callable[[State], bool], *, timeout_s: float | None = None) -> State:
        """Return the first state, from the newest one on, with a true `condition`; TimedOutError when none comes."""
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        try:
            async with asyncio.timeout(None if math.isinf(limit_s) else limit_s) as limit:
                return await self._first(condition)
        except TimeoutError as error:
            if not limit.expired():
                raise  # the condition's own
            known = known_of(self.console)
            raise TimedOutError(f"{self.name}: what was waited for did not come in {limit_s:g} s; {known}") from error

    async def _first(self, condition: Callable[[State], bool]) -> State:
        async with aclosing(self.states()) as states:
            if condition(self.state):
                return self.state
            async for state in states:
                if condition(state):
                    return state
        raise AssertionError("the states never end")

    async def _stream(self, kind: type[M], silence_s: float) -> AsyncGenerator[M, None]:
        loop = asyncio.get_running_loop()
        with self.console.inbox() as inbox:
            heard_s = loop.time()
            while True:
                message = await inbox.next(max(0.0, heard_s + silence_s - loop.time()))
                if isinstance(message, State):
                    heard_s = loop.time()
                if isinstance(message, kind):
                    yield message
                elif message is None:
                    known = known_of(self.console)
                    raise NoServiceError(f"{self.name}: no state for {silence_s:g} s; {known}")


def _vector(value: tuple[float, float, float] | None) -> "Array":
    import numpy as np  # noqa: PLC0415 - a command line starts without it

    return np.full(3, np.nan) if value is None else np.array(value)
