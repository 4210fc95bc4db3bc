"""The live page beside a demo: a broker for it, its address at once, and a login for this computer's browser."""

import math
import os
import secrets
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue

from rich.console import Console

from companion.cli.demo.mock_process import is_free_tcp_port, usual_tcp_port
from companion.config.companion_config import CompanionConfig
from companion.config.operator_config import OperatorConfig, PageConfig
from companion.core.errors import ConfigError
from companion.service.page_process import PageOptions, page_process

_PATIENCE_S = 20.0
_ADDRESS = "page: "
_BROKER_PORT = OperatorConfig.model_fields["port"].default


def stays_s(page: bool, stay_s: float | None) -> float:
    """Return how long the page stays after the landing, s: unless said, until Ctrl-C where there is a terminal."""
    if stay_s is not None and not page:
        raise ConfigError("--stay is for the page: give --page as well")
    if not page:
        return 0.0
    return stay_s if stay_s is not None else math.inf if sys.stdout.isatty() else 0.0


def with_broker(config: CompanionConfig, free_ports: bool) -> CompanionConfig:
    """Return the configuration with a broker: its own, or an embedded one on MQTT's usual port if that is free."""
    if config.operator is not None:
        return config
    port = usual_tcp_port(_BROKER_PORT, free_ports)
    return config.model_copy(update={"operator": OperatorConfig(embedded=True, port=port)})


@contextmanager
def page_of_demo(config: CompanionConfig, free_ports: bool, console: Console) -> Iterator[None]:
    """Serve the page and print its address; ConfigError when it cannot be served.

    One browser of this computer may command: the login is in the printed address, and works once.
    """
    assert config.operator is not None
    lines: SimpleQueue[str] = SimpleQueue()
    options = PageOptions(config.operator, _page(config, free_ports), secrets.token_urlsafe(16), quiet=True)
    with page_process(options, lines.put):
        try:
            line = lines.get(timeout=_PATIENCE_S)
        except Empty:
            raise ConfigError(f"the page was not served within {_PATIENCE_S:g} s") from None
        if not line.startswith(_ADDRESS):
            raise ConfigError(line)
        console.print(line, style="bold", markup=False, highlight=False, soft_wrap=True)
        _open(line.removeprefix(_ADDRESS).split()[0])
        yield


def _page(config: CompanionConfig, free_ports: bool) -> PageConfig:
    """Return the page's address: as configured, else its usual port if that is free."""
    page = config.page
    taken = "page" not in config.model_fields_set and not is_free_tcp_port(page.port)
    return page.model_copy(update={"port": 0}) if free_ports or taken else page


def _open(url: str) -> None:
    """Open the page where there is a desktop to see it on."""
    if not sys.stdout.isatty() or not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return
    with suppress(webbrowser.Error):
        browser = webbrowser.get()
        if type(browser) is not webbrowser.GenericBrowser:  # that one would draw into this terminal
            browser.open(url)
