"""One open page: what it is sent, and the commands it gives."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import suppress
from typing import Protocol

from starlette.websockets import WebSocket, WebSocketDisconnect

from companion.adapters.system.background import first_of
from companion.client.command_draft import CommandDraft
from companion.client.errors import UnknownOutcomeError
from companion.core.errors import CompanionError
from companion.page import frames
from companion.page.outlet import Outlet
from companion.page.page_commands import AFTER_S, MOST_BYTES, UNTIL_S, NotAcceptedError, Order, PageCommands, Question
from companion.protocol.commands import AT_ONCE
from companion.protocol.telemetry import Answer, Reply

LOG = logging.getLogger(__name__)

_UNREAD_S = 5.0
"""A page that does not read for so long is given up."""
_MOST_WAITING, _MOST_AT_ONCE = 8, 32
"""Commands of one page under way; those that make a vehicle safe have more room."""
_MOST_NOT_ACCEPTED = 100
"""Messages that are not accepted, after which a page is given up."""
_TOO_BIG, _POLICY, _TRY_AGAIN = 1009, 1008, 1013
"""Codes with which a WebSocket is closed (RFC 6455, 7.4.1, and its registry)."""


class Commands(Protocol):
    """Vehicles that take commands."""

    def execute(self, vehicle: str, draft: CommandDraft) -> AsyncIterator[Reply]:
        """Send a command and yield its replies to the last; raise CompanionError when its end is not known."""


class PageSocket:
    """Session of one open page, from its acceptance to its end."""

    def __init__(self, socket: WebSocket, outlet: Outlet, commands: Commands, vehicles: Callable[[], Collection[str]]):
        self._socket, self._outlet, self._commands, self._vehicles = socket, outlet, commands, vehicles
        self._reader = PageCommands()
        self._tasks: set[asyncio.Task[None]] = set()
        self._not_accepted = 0
        self._code = 0
        """Why the page is given up; 0 while it is not, or when it is gone."""

    async def run(self, can_command: Callable[[], bool]) -> None:
        """Send and read until the page is gone or given up; what it has commanded goes on, unheard, once it was sent.

        `can_command`: logged in still.
        """
        try:
            with suppress(WebSocketDisconnect):
                await first_of(self._send(), self._read(can_command))
                if self._code:
                    async with asyncio.timeout(_UNREAD_S):
                        await self._socket.close(self._code)
        except TimeoutError:
            return
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _send(self) -> None:
        while not self._outlet.overrun:
            frame = await self._outlet.next()
            try:
                async with asyncio.timeout(_UNREAD_S):
                    await self._socket.send_text(frame)
            except (TimeoutError, RuntimeError):  # the latter when uvicorn has closed it: no pong, a broken frame
                return
        self._code = _TRY_AGAIN

    async def _read(self, can_command: Callable[[], bool]) -> None:
        while True:
            message = await self._socket.receive()
            text = message.get("text")
            if message["type"] == "websocket.disconnect":
                return
            if isinstance(text, str) and len(text.encode(errors="replace")) > MOST_BYTES:
                self._code = _TOO_BIG
            elif isinstance(text, str):
                self._take(text, can_command())
            if not isinstance(text, str) or self._not_accepted > _MOST_NOT_ACCEPTED:
                self._code = _POLICY
            if self._code:
                return

    def _take(self, text: str, can_command: bool) -> None:
        try:
            what = self._reader.take(text, self._vehicles(), can_command, time.monotonic())
            if isinstance(what, Order):
                self._begin(what)
        except NotAcceptedError as error:
            self._not_accepted += 1
            self._outlet.put(frames.error(error.ref, str(error)))
            return
        if isinstance(what, Question):
            self._outlet.put(frames.confirm(what.vehicle, what.ref, what.nonce, AFTER_S, UNTIL_S))

    def _begin(self, order: Order) -> None:
        verb = order.draft.verb
        if len(self._tasks) >= (_MOST_AT_ONCE if verb in AT_ONCE else _MOST_WAITING):
            raise NotAcceptedError(order.ref, f"{verb}: {len(self._tasks)} commands of this page are under way: wait")
        LOG.info("the page of %s commands %s of %s", self._peer, verb, order.vehicle)
        task = asyncio.create_task(self._carry_out(order), name=f"companion.page.{verb}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    @property
    def _peer(self) -> str:
        return self._socket.client.host if self._socket.client is not None else "an unknown address"

    async def _carry_out(self, order: Order) -> None:
        try:
            async for reply in self._commands.execute(order.vehicle, order.draft):
                self._reply(order, reply)
        except CompanionError as error:
            answer = Answer.FAILED if isinstance(error, UnknownOutcomeError) else Answer.REFUSED
            self._reply(order, Reply(id=order.draft.id, answer=answer, time_s=time.time(), text=str(error)))
        except Exception:
            LOG.exception("%s of %s from a page", order.draft.verb, order.vehicle)
            text = f"{order.draft.verb}: the page's server failed, and it is not known how this ends"
            self._reply(order, Reply(id=order.draft.id, answer=Answer.FAILED, time_s=time.time(), text=text))

    def _reply(self, order: Order, reply: Reply) -> None:
        self._outlet.put(frames.reply(order.vehicle, order.ref, order.draft.verb, reply))
