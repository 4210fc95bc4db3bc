"""The demo's page: how long it stays, its broker, and where it is opened."""

import asyncio
import math
import sys
import webbrowser
from types import SimpleNamespace
from typing import Any

import pytest

from companion.cli.demo import page
from companion.cli.demo.mock_process import free_tcp_port, is_free_tcp_port
from companion.cli.demo.page import stays_s, with_broker
from companion.cli.demo.stay import Gate, stay
from companion.config.companion_config import CompanionConfig
from companion.config.operator_config import OperatorConfig, PageConfig
from companion.core.errors import ConfigError
from companion.supervisor.flight_state import Phase


def test_it_stays_until_ctrl_c_on_a_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: False)
    assert (stays_s(True, None), stays_s(True, 5.0), stays_s(False, None)) == (0.0, 5.0, 0.0)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert (stays_s(True, None), stays_s(False, None)) == (math.inf, 0.0)
    with pytest.raises(ConfigError, match="--stay is for the page: give --page as well"):
        stays_s(False, 5.0)


def test_it_has_a_broker_of_its_own_unless_one_is_configured() -> None:
    own = with_broker(CompanionConfig(), free_ports=True).operator
    assert own is not None
    assert (own.embedded, own.port != 1883) == (True, True)
    configured = CompanionConfig(operator=OperatorConfig(host="lab"))
    assert with_broker(configured, free_ports=True) is configured


def test_a_port_in_use_is_not_in_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = CompanionConfig()
    configured = CompanionConfig(page=PageConfig(port=8081))
    assert is_free_tcp_port(free_tcp_port())
    for free in (True, False):
        monkeypatch.setattr(page, "is_free_tcp_port", lambda _, free=free: free)
        assert page._page(usual, free_ports=False).port == (8080 if free else 0)
        assert page._page(configured, free_ports=False).port == 8081
        assert page._page(configured, free_ports=True).port == 0


@pytest.mark.parametrize(
    ("terminal", "display", "browser", "opens"),
    [
        (True, ":0", object, True),
        (False, ":0", object, False),
        (True, "", object, False),
        (True, ":0", "of the terminal", False),
    ],
)
def test_it_is_opened_where_there_is_a_desktop(
    monkeypatch: pytest.MonkeyPatch, terminal: bool, display: str, browser: Any, opens: bool
) -> None:
    opened: list[str] = []
    made = webbrowser.GenericBrowser("lynx") if browser == "of the terminal" else SimpleNamespace()
    monkeypatch.setattr(made, "open", opened.append, raising=False)
    monkeypatch.setattr("companion.cli.demo.page.webbrowser.get", lambda: made)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    page._open("http://x/")
    assert opened == (["http://x/"] if opens else [])


class Service:
    """A vehicle that flies on from the page."""

    def __init__(self) -> None:
        self.ticking = asyncio.get_running_loop().create_future()
        self.phase, self.landed = Phase.HOLD, False

    async def land(self) -> None:
        """Land."""
        self.landed, self.phase = True, Phase.DISARMED


@pytest.mark.parametrize("phase", [Phase.HOLD, Phase.DISARMED])
async def test_what_flies_when_the_time_is_over_lands(phase: Phase) -> None:
    service, reported = Service(), False
    service.phase = phase

    async def report() -> None:
        nonlocal reported
        reported = True

    await stay(service, 0.01, report)  # type: ignore[arg-type]
    assert (reported, service.landed) == (True, phase is Phase.HOLD)


async def test_a_loop_that_has_failed_ends_the_stay() -> None:
    service = Service()
    service.ticking.set_result(None)

    async def report() -> None:
        return

    async with asyncio.timeout(5.0):
        await stay(service, math.inf, report)  # type: ignore[arg-type]


def test_a_closed_gate_lets_no_tick_through() -> None:
    taken: list[Any] = []
    tick: Any = SimpleNamespace()
    sink: Any = taken.append
    gate = Gate(sink)
    gate(tick)
    gate.sink = None
    gate(tick)
    assert taken == [tick]
