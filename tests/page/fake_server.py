"""A server that speaks the page's protocol and has a room of fake vehicles; the tests move it by hand."""

import asyncio
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

import companion
from tests.page.fake_vehicle import STEP_S, FakeVehicle
from tests.ports import free_port

STATIC = Path(companion.__file__).parent / "page" / "static"
PASSWORD = "beside the net"
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
_START_X_M, _APART_M = 0.0, 1.6


class FakeServer:
    """State of the server. Tests call it from their own thread; what it does happens in the server's."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        self.can_command, self.password = True, False
        self.silent = False
        """Nothing at all is sent, and the connections stay open."""
        self.refusing = False
        """No connection is taken."""
        self.publishing = True
        """States are sent; without, only beats."""
        self.commands: list[dict[str, Any]] = []
        self.asked = 0
        """Questions before a kill."""
        self.vehicles: dict[str, FakeVehicle] = {}
        self.history: list[dict[str, Any]] = []
        self.sockets: set[WebSocket] = set()
        self.loop: asyncio.AbstractEventLoop | None = None
        self.port = free_port()
        self.reset()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/"

    def reset(self) -> None:
        """Put fresh vehicles on the ground."""
        count = len(self.names)
        self.commands.clear()
        self.asked = 0
        self.history.clear()
        self.can_command, self.password, self.silent, self.refusing = True, False, False, False
        self.publishing = True
        self.vehicles = {
            name: FakeVehicle(name, np.array([_START_X_M, _APART_M * (i - (count - 1) / 2), 0.0]), time_s=time.time())
            for i, name in enumerate(self.names)
        }

    def vehicle(self, index: int = 0) -> FakeVehicle:
        """Return a vehicle by its place."""
        return self.vehicles[self.names[index]]

    def fly(self, seconds: float) -> None:
        """Advance all vehicles at once, and send every state on the way."""
        self._inside(self._fly(seconds))

    def send(self, message: dict[str, Any]) -> None:
        """Send a message to every page."""
        self._inside(self._send(message))

    def drop(self) -> None:
        """Close every connection."""
        self._inside(self._drop())

    def _inside(self, work: Any) -> None:
        assert self.loop is not None
        asyncio.run_coroutine_threadsafe(work, self.loop).result(10.0)

    async def _fly(self, seconds: float) -> None:
        steps = round(seconds / STEP_S)
        for left in range(steps, 0, -1):
            for vehicle in self.vehicles.values():
                vehicle.step()
            await self._publish(age_s=(left - 1) * STEP_S)

    async def _drop(self) -> None:
        for socket in tuple(self.sockets):
            await socket.close()

    async def _send(self, message: dict[str, Any]) -> None:
        if message["type"] == "event":
            self.history.append({**message, "old": True})
        if self.silent:
            return
        for socket in tuple(self.sockets):
            with suppress(Exception):
                await socket.send_text(json.dumps(message))

    async def _publish(self, age_s: float = 0.0) -> None:
        for vehicle in self.vehicles.values():
            events, vehicle.events = vehicle.events, []  # tests add some meanwhile
            replies, vehicle.replies = vehicle.replies, []
            for event in events:
                await self._send({"type": "event", "vehicle": vehicle.name, "event": event})
            for reply in replies:
                await self._send({"type": "reply", "vehicle": vehicle.name, **reply})
            state = {"type": "state", "vehicle": vehicle.name, "age_s": age_s, "state": vehicle.state()}
            await self._send({**state, "arms_b_m": vehicle.arms_b_m()})

    async def tick(self) -> None:
        """Send beats and the present states until cancelled; the vehicles only move by `fly`."""
        self.loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(STEP_S)
            await self._send({"type": "beat", "time_s": time.time()})
            if self.publishing:
                await self._publish()

    async def serve(self, socket: WebSocket) -> None:
        """Serve one page."""
        if self.refusing:
            await socket.close()
            return
        await socket.accept()
        greeting = {"vehicles": list(self.vehicles), "can_command": self._may(socket), "password": self.password}
        await socket.send_json({"type": "hello", **greeting, "version": "0.1.0", "time_s": time.time()})
        await socket.send_json({"type": "broker", "linked": True})
        for vehicle in self.vehicles.values():
            await socket.send_json({"type": "about", "vehicle": vehicle.name, "about": vehicle.about()})
            await socket.send_json({"type": "presence", "vehicle": vehicle.name, "presence": vehicle.presence()})
        for old in self.history[-200:]:
            await socket.send_json(old)
        self.sockets.add(socket)
        try:
            while True:
                await self._take(socket, await socket.receive_json())
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            self.sockets.discard(socket)

    def _may(self, socket: WebSocket | Request) -> bool:
        return socket.cookies.get("in") == "yes" if self.password else self.can_command

    async def _take(self, socket: WebSocket, message: dict[str, Any]) -> None:
        if not self._may(socket):
            await socket.send_json({"type": "error", "ref": message["ref"], "text": "read-only: log in first"})
        elif message["verb"] == "kill" and "nonce" not in message:
            self.asked += 1
            confirm = {"vehicle": message["vehicle"], "nonce": "n1", "after_s": 1.5, "until_s": 10}
            await socket.send_json({"type": "confirm", "ref": message["ref"], **confirm})
        else:
            self.commands.append(message)
            self.vehicles[message["vehicle"]].obey(message)
            await self._publish()

    async def login(self, request: Request) -> Response:
        """Take the password."""
        if (await request.json()).get("password") != PASSWORD:
            return JSONResponse({"error": "wrong password"}, 401)
        answer = JSONResponse({})
        answer.set_cookie("in", "yes", httponly=True, samesite="strict")
        return answer

    async def logout(self, _: Request) -> Response:
        """Forget the login."""
        answer = JSONResponse({})
        answer.delete_cookie("in")
        return answer

    async def index(self, _: Request) -> Response:
        """Return the page."""
        return FileResponse(STATIC / "index.html", headers={"Content-Security-Policy": CSP})

    def app(self) -> Starlette:
        """Return the application."""
        return Starlette(
            routes=[
                Route("/", self.index),
                Route("/login", self.login, methods=["POST"]),
                Route("/logout", self.logout, methods=["POST"]),
                WebSocketRoute("/ws", self.serve),
                Mount("/static", StaticFiles(directory=STATIC)),
            ]
        )


@contextmanager
def fake_server(*names: str) -> Iterator[FakeServer]:
    """Run a server in a thread of its own until the block ends."""
    fake = FakeServer(names)
    server = uvicorn.Server(
        uvicorn.Config(fake.app(), "127.0.0.1", fake.port, log_level="error", ws="websockets-sansio")
    )

    async def run() -> None:
        ticking = asyncio.create_task(fake.tick())
        await server.serve()
        ticking.cancel()
        await asyncio.gather(ticking, return_exceptions=True)

    thread = threading.Thread(target=lambda: asyncio.run(run()), name="fake page server", daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield fake
    finally:
        server.should_exit = True
        thread.join(10.0)
