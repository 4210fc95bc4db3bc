"""uvicorn's protocols with bounds: connections in all, time for a request, and an end for those that do not read."""

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

MOST_CONNECTIONS = 640
"""Connections of any kind at one time; more are closed at once."""
_REQUEST_S = 10.0
"""Time for a whole request to arrive; a browser's takes milliseconds."""
_CLOSE_S = 2.0
"""Time for the last bytes to leave; then the connection is cut."""


class BoundedHttp(H11Protocol):
    """HTTP connection that must ask for something soon."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, or close it when there are too many."""
        super().connection_made(transport)
        if len(self.connections) > MOST_CONNECTIONS:
            transport.abort()
            return
        self.loop.call_later(_REQUEST_S, self._end_unless_asked)

    def _end_unless_asked(self) -> None:
        cycle: Any = self.cycle  # None before the first request, whatever its type says
        if cycle is None and self in self.connections:
            self.transport.abort()


class BoundedWebSocket(WebSocketsSansIOProtocol):
    """WebSocket that is cut when its last bytes do not leave."""

    async def run_asgi(self) -> None:
        """Run the application for this connection to its end."""
        try:
            await super().run_asgi()
        finally:
            transport: Any = self.transport
            self.loop.call_later(_CLOSE_S, transport.abort)
