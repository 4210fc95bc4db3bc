"""`companion page` and `companion page-password`: the live page, and its password."""

import asyncio
import getpass
import logging
import signal
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
import uvloop

from companion.adapters.system.systemd import logging_to
from companion.cli.operator.exit_codes import names_of
from companion.cli.operator.options import with_place
from companion.client.endpoint import EndpointOptions, endpoint_of
from companion.config.operator_config import OperatorConfig, PageConfig
from companion.config.toml_files import read_toml, validate
from companion.core.errors import ConfigError
from companion.page.passwords import PasswordHash, objection_to
from companion.page.server import serve_page
from companion.page.settings import PageSettings
from companion.protocol.topics import ALL


@with_place
def page(
    place: EndpointOptions,
    host: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Serve on this address; 0.0.0.0: for the network.  [default: 127.0.0.1]"),
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="TCP port; 0: a free one.  [default: 8080]")
    ] = None,
    page_password: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Let those command who know the password in FILE (`page-password`)."),
    ] = None,
    tls_cert: Annotated[
        str | None, typer.Option(metavar="FILE", help="Serve encrypted, with this certificate, PEM.")
    ] = None,
    tls_key: Annotated[str | None, typer.Option(metavar="FILE", help="Key of the certificate, PEM.")] = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log all messages.")] = False,
) -> None:
    """Serve a live page of all vehicles for phone, tablet and desktop, until Ctrl-C.

    Vehicles of the broker are found by themselves; --vehicle A,B restricts the page to those. Without --page-password
    the page only looks. A file given by --config may have all of this in [page]. Exit codes: 0 after Ctrl-C or SIGTERM,
    2 for an address or a file that cannot be used.
    """
    given = {"host": host, "port": port, "password_file": page_password, "tls_cert": tls_cert, "tls_key": tls_key}
    broker, vehicles = _place(place)
    settings = PageSettings(broker=broker, vehicles=vehicles, page=_page(given, place.config))
    with logging_to(sys.stderr, logging.DEBUG if verbose else logging.INFO):
        uvloop.run(_until_stopped(settings))


def _page(given: dict[str, Any], config: Path | None) -> PageConfig:
    """Return the page's address and secrets: options override the file's [page]; ConfigError for what cannot be."""
    table = read_toml(config).get("page", {}) if config is not None else {}
    options = {name: value for name, value in given.items() if value is not None}
    return validate(PageConfig, table | options, config or Path("the page's options"), "page" if config else "")


def page_password(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to write; one that is there is replaced.")],
) -> None:
    """Ask for a new password of the page, twice, and write its hash into FILE, readable for you alone.

    Give the file to `companion page --page-password FILE`. Without a terminal the password is one line of standard
    input. Exit code 2 if nothing was written.
    """
    password = _asked() if sys.stdin.isatty() else sys.stdin.readline().rstrip("\r\n")
    objection = objection_to(password)
    if objection:
        raise ConfigError(f"{objection}: nothing was written")
    try:
        PasswordHash.of(password).write(file)
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written: {error.strerror}") from error
    typer.echo(f"wrote {file}: give it to `companion page --page-password {file}`", err=True)


def _asked() -> str:
    try:
        password = getpass.getpass("new password of the page: ")
        if password and getpass.getpass("once more: ") != password:
            raise ConfigError("the two differ: nothing was written")
    except EOFError:
        raise ConfigError("no password was given: nothing was written") from None
    return password


def _place(given: EndpointOptions) -> tuple[OperatorConfig, tuple[str, ...]]:
    """Return the broker, and the vehicles that were named; a name in the environment or the file restricts nothing."""
    if given.vehicle is None:
        return endpoint_of(replace(given, vehicle="unnamed")), ()  # the environment may name several
    prefix, slash, listed = given.vehicle.rpartition("/")
    if listed == ALL:
        return endpoint_of(replace(given, vehicle=f"{prefix}{slash}unnamed")), ()
    names = names_of(listed, "vehicle") if listed else ()
    if not names:
        raise ConfigError(f"--vehicle {given.vehicle!r}: give VEHICLE, A,B or PREFIX/A,B")
    places = [endpoint_of(replace(given, vehicle=f"{prefix}{slash}{name}")) for name in names]
    return places[0], names


async def _until_stopped(settings: PageSettings) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    await serve_page(settings, typer.echo, stop)
