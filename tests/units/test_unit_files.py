"""The units and the udev rule, as systemd's own tools judge them."""

import configparser
import re
import shutil
from pathlib import Path

import pytest

from tests.packages import needs
from tests.units.tools import SYSTEMD, said

UNITS = {
    # Exposure by `systemd-analyze security`, 0 to 10; docs/install.md gives the scores and what makes them up.
    "dauam-companion.service": 2.2,
    "dauam-law.service": 1.5,
    "dauam-mocap-bridge.service": 1.3,
    "dauam-page.service": 1.3,
}
needs_analyze = needs("systemd-analyze")
OURS = sorted(path.name for path in SYSTEMD.glob("*.service"))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Create a system root with all that the units need."""
    places = dict.fromkeys(OURS, "etc/systemd/system") | {"mosquitto.service.d": "etc/systemd/system"}
    places["dauam-companion.service.d"] = "etc/systemd/system"
    for name, place in places.items():
        (tmp_path / place).mkdir(parents=True, exist_ok=True)
        source, there = SYSTEMD / name, tmp_path / place / name
        shutil.copytree(source, there) if source.is_dir() else shutil.copy(source, there)
    command = tmp_path / "opt/dauam/bin/companion"
    command.parent.mkdir(parents=True)
    command.write_text("#!/bin/sh\n")
    command.chmod(0o755)
    for target in ("network-online", "network", "multi-user", "sysinit", "basic", "shutdown"):
        (tmp_path / f"etc/systemd/system/{target}.target").write_text("[Unit]\n")
    broker = tmp_path / "usr/sbin/mosquitto"
    broker.parent.mkdir(parents=True)
    shutil.copy(command, broker)
    return tmp_path


def settings(unit: str) -> configparser.RawConfigParser:
    parser = configparser.RawConfigParser(strict=False)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(SYSTEMD / unit)
    return parser


@needs_analyze
@pytest.mark.parametrize("unit", OURS)
def test_systemd_finds_no_fault(unit: str, root: Path) -> None:
    out = said("systemd-analyze", "verify", f"--root={root}", "--recursive-errors=no", unit)
    assert out == ""


@needs_analyze
def test_systemd_would_find_a_fault(root: Path) -> None:
    unit = root / "etc/systemd/system/dauam-companion.service"
    unit.write_text(unit.read_text().replace("WatchdogSec=5", "WatchdogSecs=5"))
    assert "WatchdogSecs" in said("systemd-analyze", "verify", f"--root={root}", unit.name)


@needs_analyze
@pytest.mark.parametrize(("unit", "limit"), UNITS.items())
def test_no_more_rights_than_were_agreed(unit: str, limit: float, root: Path) -> None:
    threshold = f"--threshold={round(10 * limit)}"
    out = said("systemd-analyze", "security", "--offline=true", f"--root={root}", "--no-pager", threshold, unit)
    assert "Overall exposure level" in out


@needs_analyze
def test_the_brokers_drop_in_takes_rights_away(root: Path) -> None:
    debian = root / "etc/systemd/system/mosquitto.service"
    debian.write_text("[Service]\nType=notify\nExecStart=/usr/sbin/mosquitto -c /etc/mosquitto/mosquitto.conf\n")
    command = ["systemd-analyze", "security", "--offline=true", f"--root={root}", "--no-pager", "--threshold=18"]
    said(*command, "mosquitto.service")
    assert said(command[0], "verify", f"--root={root}", "--recursive-errors=no", "mosquitto.service") == ""
    shutil.rmtree(debian.with_name("mosquitto.service.d"))
    said(*command, "mosquitto.service", code=1)


def test_a_whole_landing_fits_between_sigterm_and_sigkill() -> None:
    from companion.config.companion_config import load_config

    config = load_config(SYSTEMD.parent / "config/lab.toml")
    assert config.arms is not None
    assert config.fence is not None
    down_s = config.fence.top_m / config.flight.descent_speed_mps
    service = settings("dauam-companion.service")["Service"]
    assert config.arms.stow_time_s + down_s + 30.0 < float(service["TimeoutStopSec"])


def test_the_recorder_may_close_its_file_and_a_crash_is_followed_by_a_new_service() -> None:
    unit = settings("dauam-companion.service")
    assert unit["Service"]["KillMode"] == "control-group"
    assert unit["Service"]["Restart"] == "on-failure"
    assert int(unit["Unit"]["StartLimitBurst"]) > 1


def rules() -> list[list[tuple[str, str, str]]]:
    """Return key, operator and value of every rule that is not a comment."""
    lines = (SYSTEMD / "99-dauam-u2d2.rules").read_text().splitlines()
    written = [line for line in lines if line and not line.startswith("# ")]
    parsed = []
    for line in written:
        parts = line.removeprefix("#").split(", ")
        found = [re.fullmatch(r'([A-Z]+(?:\{[\w/]+\})?)(==|!=|\+=|:=|=)"([^"]*)"', part) for part in parts]
        assert all(found), line
        if not line.startswith("#"):
            parsed.append([(match[1], match[2], match[3]) for match in found if match])
    return parsed


def test_the_rule_makes_the_u2d2_quick_and_gives_it_a_name() -> None:
    (rule,) = rules()
    assert ("ATTRS{idVendor}", "==", "0403") in rule
    assert ("ATTRS{idProduct}", "==", "6014") in rule
    assert ("ATTR{device/latency_timer}", "=", "1") in rule
    assert ("GROUP", "=", "dialout") in rule
    assert ("SYMLINK", "+=", "dauam-arms") in rule


@needs("udevadm")
def test_udev_takes_the_rule() -> None:
    if int(said("udevadm", "--version").split()[0]) < 254:
        pytest.skip("this udevadm cannot verify rules; from systemd 254 on it can")
    said("udevadm", "verify", SYSTEMD / "99-dauam-u2d2.rules")
