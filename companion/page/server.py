"""Server of the page: its socket, its certificate, its address, and its end."""

import asyncio
import contextlib
import ipaddress
import logging
import os
import socket
import ssl
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil  # type: ignore[import-untyped]
import uvicorn
from starlette.types import ASGIApp

from companion.adapters.system.background import background, first_of
from companion.config.operator_config import PageConfig
from companion.core.errors import ConfigError
from companion.page.access import OneTimeToken
from companion.page.app import page_app
from companion.page.hub import Hub
from companion.page.login import Login
from companion.page.origins import own_names
from companion.page.page_commands import MOST_BYTES
from companion.page.passwords import PasswordHash
from companion.page.settings import PageSettings
from companion.page.vehicles import Vehicles
from companion.page.wire import BoundedHttp, BoundedWebSocket

LOG = logging.getLogger(__name__)

_NICE = 10
_ENDS_S = 1


class _Server(uvicorn.Server):
    """uvicorn's server, whose end is for its caller to say."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave the process's signals alone."""
        yield


async def serve_page(settings: PageSettings, announce: Callable[[str], None], stop: asyncio.Event) -> None:
    """Serve the page until `stop`; `announce` gets the lines that say where it is, before anything is waited for.

    Raises ConfigError for an address, a file or a certificate that cannot be used.
    """
    page = settings.page
    password = PasswordHash.read(Path(page.password_file)) if page.password_file is not None else None
    certificate = certificate_of(page)
    with _listening(page) as listener:
        _yield_to_flights()
        for line in lines_of(settings, listener.getsockname()[1]):
            announce(line)
        hub = Hub(password is not None)
        vehicles = Vehicles(settings.broker, settings.vehicles, hub)
        login = Login(password=password, token=OneTimeToken(settings.token), tls=certificate is not None)
        server = server_of(page_app(hub, vehicles, login, own_names(page.host)), certificate)
        async with background(_end_on(stop, server), "companion.page.end"):
            await first_of(vehicles.run(), server.serve([listener]))


def _yield_to_flights() -> None:
    """Let every other program go first, and the memory of this one be the first to be taken back."""
    os.setpriority(os.PRIO_PROCESS, 0, max(_NICE, os.getpriority(os.PRIO_PROCESS, 0)))
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("500", encoding="ascii")


async def _end_on(stop: asyncio.Event, server: uvicorn.Server) -> None:
    """Let the server close its connections and end."""
    await stop.wait()
    server.should_exit = True


def certificate_of(page: PageConfig) -> ssl.SSLContext | None:
    """Return the context of the page's certificate; None without one. ConfigError when it cannot be used."""
    if page.tls_cert is None:
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        context.load_cert_chain(page.tls_cert, page.tls_key, password=_no_password)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        files = f"the page's certificate {page.tls_cert} with its key {page.tls_key}"
        raise ConfigError(f"{files}: not in PEM, or not one of the other, or not to be read: {reason}") from error
    return context


def _no_password() -> str:
    raise ValueError("the key has a password: give one without")


@contextlib.contextmanager
def _listening(page: PageConfig) -> Iterator[socket.socket]:
    """Bind the page's socket; ConfigError when the address cannot be had."""
    where = f"the page on {page.host}, port {page.port}"
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            page.host, page.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        raise ConfigError(f"{where}: not an address of this computer: {error}") from error
    with socket.socket(family, kind, protocol) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(address)
            listener.listen()
        except OSError as error:
            reason = f"cannot be served there ({error.strerror}): {_remedy(error)}"
            raise ConfigError(f"{where}: {reason}") from error
        yield listener


def _remedy(error: OSError) -> str:
    if isinstance(error, PermissionError):
        return "give a port from 1024 on"
    return "is there another page? Give another port, or an address of this computer"


def lines_of(settings: PageSettings, port: int) -> list[str]:
    """Return the lines that say where the page is, and what it may."""
    page = settings.page
    scheme = "https" if page.tls_cert else "http"
    token = f"#token={settings.token}" if settings.token else ""
    urls = [f"{scheme}://{_in_url(host)}:{port}/{token}" for host in _addresses(page.host)]
    lines = [f"page: {' '.join(urls)}"]
    if page.password_file is None and not settings.token:
        lines.append("the page only looks: to command from it, give --page-password FILE")
    elif page.password_file is not None and page.tls_cert is None and not _is_local(page.host):
        lines.append("everyone on this network can read the page's password: give --tls-cert and --tls-key")
    return lines


def _addresses(host: str) -> list[str]:
    """Return where a page that listens on `host` can be opened."""
    try:
        everywhere = ipaddress.ip_address(host).is_unspecified
    except ValueError:
        everywhere = False
    if not everywhere:
        return [host]
    interfaces = psutil.net_if_addrs().values()
    found = [one.address for addresses in interfaces for one in addresses if one.family is socket.AF_INET]
    return sorted(found, key=lambda address: (address.startswith("127."), address)) or [socket.gethostname()]


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _is_local(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def server_of(app: ASGIApp, certificate: ssl.SSLContext | None) -> uvicorn.Server:
    """Return the server of an application."""
    config = uvicorn.Config(
        app,
        http=BoundedHttp,
        ws=BoundedWebSocket,
        ws_max_size=MOST_BYTES,
        ws_ping_interval=5.0,
        ws_ping_timeout=10.0,
        ws_per_message_deflate=False,  # it costs ten times what it saves on a local network
        lifespan="off",
        proxy_headers=False,
        server_header=False,
        access_log=False,
        log_config=None,
        timeout_graceful_shutdown=_ENDS_S,
    )
    config.load()
    config.ssl = certificate
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    return _Server(config)
