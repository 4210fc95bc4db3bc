"""The page's web application: static files, login, and a WebSocket for each open page."""

import mimetypes
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from companion.page.guarded import Guarded
from companion.page.hub import Hub
from companion.page.login import Login, from_this_page
from companion.page.page_socket import Commands, PageSocket

STATIC = Path(__file__).parent / "static"
MOST_PAGES = 500
"""Open pages at one time."""
_FOR_OPERATORS = 20
"""Further ones, for pages that are logged in: those that only look cannot keep an operator out."""

for ending, kind in ((".js", "text/javascript"), (".mjs", "text/javascript"), (".css", "text/css")):
    mimetypes.add_type(kind, ending)  # not what the computer's own table has: with nosniff a wrong one is not run


def page_app(hub: Hub, commands: Commands, login: Login, names: frozenset[str]) -> ASGIApp:
    """Return the application; `names` are the computer's own."""

    async def index(_: Request) -> FileResponse:
        return FileResponse(STATIC / "index.html")

    async def open_page(socket: WebSocket) -> None:
        if not from_this_page(socket):
            await socket.send_denial_response(PlainTextResponse("403: not from this page\n", 403))
            return
        can_command = login.can_command(socket)
        if hub.pages >= MOST_PAGES + (_FOR_OPERATORS if can_command else 0):
            await socket.send_denial_response(PlainTextResponse(f"503: {hub.pages} pages are open\n", 503))
            return
        with hub.page(can_command) as outlet:
            await socket.accept()
            page = PageSocket(socket, outlet, commands, lambda: hub.vehicles)
            await page.run(lambda: login.can_command(socket))

    app = Starlette(
        routes=[
            Route("/", index),
            Route("/login", login.log_in, methods=["POST"]),
            Route("/logout", login.log_out, methods=["POST"]),
            WebSocketRoute("/ws", open_page),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
    )
    return Guarded(app, names)
