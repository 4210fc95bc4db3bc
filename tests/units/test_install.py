"""The installer, into a folder in place of the system."""

import os
import re
import shutil
import stat
import subprocess
from pathlib import Path

import pytest

from companion.config.companion_config import load_config
from companion.config.controller_config import controller_path
from tests.packages import needs
from tests.units.tools import ROOT, SYSTEMD, said

INSTALL, UNINSTALL = SYSTEMD / "install.sh", SYSTEMD / "uninstall.sh"
VEHICLE = {
    "etc/dauam/companion.toml",
    "etc/systemd/system/dauam-companion.service",
    "etc/systemd/system/dauam-companion.service.d/network.conf",
    "etc/sysusers.d/dauam.conf",
    "etc/udev/rules.d/99-dauam-u2d2.rules",
}
needs_sysusers = needs("systemd-sysusers")
USERS = {"etc/passwd", "etc/group", "etc/shadow", "etc/gshadow", "etc/.pwd.lock", "etc/passwd-", "etc/group-"}


def install(root: Path, *words: str) -> str:
    """Run the installation without the Python packages, which take a minute."""
    return said(INSTALL, *words, "--root", root, "--no-venv")


def files(root: Path) -> dict[str, tuple[int, bytes]]:
    """Return mode and content by name; without config/, a copy, and files of systemd-sysusers."""
    found = {}
    for path in root.rglob("*"):
        name = str(path.relative_to(root))
        if path.is_file() and not name.startswith("opt/dauam/config/") and name not in USERS | {"etc/shadow-"}:
            found[name] = (stat.S_IMODE(path.stat().st_mode), path.read_bytes())
    return found


@needs_sysusers
def test_the_onboard_computer_gets_service_rule_user_and_configuration(tmp_path: Path) -> None:
    out = install(tmp_path)
    found = files(tmp_path)
    assert set(found) == VEHICLE
    assert {mode for mode, _ in found.values()} == {0o644}
    for name in VEHICLE:
        assert f"wrote {tmp_path}/{name}" in out
    assert "dauam:x:" in (tmp_path / "etc/passwd").read_text()
    groups = (tmp_path / "etc/group").read_text().splitlines()
    assert any(line.startswith("dialout:") and line.endswith(":dauam") for line in groups)


@needs_sysusers
def test_again_changes_nothing_and_keeps_what_is_the_users(tmp_path: Path) -> None:
    install(tmp_path)
    configuration = tmp_path / "etc/dauam/companion.toml"
    network = tmp_path / "etc/systemd/system/dauam-companion.service.d/network.conf"
    configuration.write_text("mine")
    network.write_text("mine, too")
    (tmp_path / "etc/systemd/system/dauam-companion.service").write_text("an older one")
    (tmp_path / "opt/dauam/config/controllers/gone.toml").write_text("of an older version")
    out = install(tmp_path)
    assert f"left {configuration} as it is" in out
    assert f"left {network} as it is" in out
    first = files(tmp_path)
    assert first["etc/dauam/companion.toml"][1] == b"mine"
    unit = (SYSTEMD / "dauam-companion.service").read_bytes()
    assert first["etc/systemd/system/dauam-companion.service"] == (0o644, unit)
    assert not (tmp_path / "opt/dauam/config/controllers/gone.toml").exists()
    install(tmp_path)
    assert files(tmp_path) == first


@needs_sysusers
def test_the_first_configuration_is_one_the_service_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path)
    config = load_config(tmp_path / "etc/dauam/companion.toml")
    assert config.records.folder == "/var/lib/dauam/flights"
    assert config.preflight.state_folder == "/var/lib/dauam"
    assert config.arms is not None
    assert config.arms.port == "/dev/dauam-arms"
    monkeypatch.chdir(tmp_path / "opt/dauam")  # where the service stands
    assert controller_path(config.control.controller).is_relative_to(tmp_path)


@needs_sysusers
def test_the_grounds_first_configuration_is_one_the_law_takes_and_is_kept(tmp_path: Path) -> None:
    install(tmp_path, "law")
    path, key = tmp_path / "etc/dauam/ground.toml", tmp_path / "law.key"
    key.write_text("0123456789abcdef\n")
    key.chmod(0o600)
    path.write_text(path.read_text().replace("/etc/dauam/law.key", str(key)))
    config = load_config(path)
    assert config.law.on_ground
    assert config.records.folder == "/var/lib/dauam/flights"
    assert f"left {path} as it is" in install(tmp_path, "law")


@needs_sysusers
def uncommented(text: str) -> str:
    """Return lines of TOML without the sign that makes them comments."""
    return re.sub(r"(?m)^# (?=\[?[\w.]+\]?(?: = |\n))", "", text)


def test_what_is_a_comment_in_the_first_configuration_may_be_uncommented(tmp_path: Path) -> None:
    """Each table stands there once: a second one of its name is no TOML."""
    install(tmp_path)
    path = tmp_path / "etc/dauam/companion.toml"
    key = tmp_path / "law.key"
    key.write_text("0123456789abcdef\n")
    key.chmod(0o600)
    first = path.read_text().replace("/etc/dauam/law.key", str(key))
    before, operator, after = re.split(r"(?m)^(# \[operator\]\n(?:# .*\n)+)", first)
    without_files = re.sub(r"(?m)^# \w+_file = .*\n", "", operator)
    begin, separation, rest = re.split(r"(?m)^(# \[separation\]\n(?:# .*\n)+)", before)
    path.write_text(begin + uncommented(separation) + rest)
    assert load_config(path).separation.order == ("dauam", "dauam-2")
    text = uncommented(begin + rest + without_files + after)  # its frames come over the broker, which has one body's
    path.write_text(text)
    config = load_config(path)
    assert config.operator is not None
    assert config.operator.vehicle == "dauam-1"
    assert config.preflight.state_folder == "/var/lib/dauam"
    assert config.preflight.by_hand_within_h == 24.0
    assert config.law.on_ground
    assert config.law.link.key_file == str(key)
    assert "# " + "battery" not in text, "it was uncommented"


@needs_sysusers
def test_each_computer_of_the_room_gets_its_own_part(tmp_path: Path) -> None:
    install(tmp_path / "room", "room")
    install(tmp_path / "law", "law")
    install(tmp_path / "page", "page")
    install(tmp_path / "broker", "broker")
    assert set(files(tmp_path / "room")) == {
        "etc/dauam/companion.toml",
        "etc/systemd/system/dauam-mocap-bridge.service",
        "etc/sysusers.d/dauam.conf",
    }
    assert set(files(tmp_path / "law")) == {
        "etc/dauam/ground.toml",
        "etc/systemd/system/dauam-law.service",
        "etc/sysusers.d/dauam.conf",
    }
    assert set(files(tmp_path / "page")) == {
        "etc/dauam/page.toml",
        "etc/systemd/system/dauam-page.service",
        "etc/sysusers.d/dauam.conf",
    }
    ground = (tmp_path / "law/etc/dauam/ground.toml").read_text()
    assert 'folder = "/var/lib/dauam/flights"  ' in ground, "where the unit may write"
    assert set(files(tmp_path / "broker")) == {"etc/systemd/system/mosquitto.service.d/dauam.conf"}


@needs_sysusers
@pytest.mark.parametrize("part", ["vehicle", "room", "law", "page", "broker"])
def test_uninstalling_leaves_configuration_records_and_user(tmp_path: Path, part: str) -> None:
    install(tmp_path, part)
    record = tmp_path / "var/lib/dauam/flights/one.mcap"
    record.parent.mkdir(parents=True)
    record.write_bytes(b"flown")
    command = tmp_path / "usr/local/bin/companion"
    command.parent.mkdir(parents=True)
    command.symlink_to("/opt/dauam/bin/companion")
    out = said(UNINSTALL, "--root", tmp_path)
    left = {"var/lib/dauam/flights/one.mcap"}
    left |= {"law": {"etc/dauam/ground.toml"}, "page": {"etc/dauam/page.toml"}}.get(part, set())
    left |= {name for name in VEHICLE if name.endswith((".conf", ".toml")) and "sysusers" not in name}
    assert set(files(tmp_path)) <= left
    assert record.exists()
    assert not command.is_symlink()
    assert not (tmp_path / "opt/dauam").exists()
    assert f"left {tmp_path}/var/lib/dauam: yours" in out
    if part == "vehicle":
        assert f"left {tmp_path}/etc/dauam: yours" in out
        assert "dauam:x:" in (tmp_path / "etc/passwd").read_text()
    said(UNINSTALL, "--root", tmp_path)


@needs("setpriv")
@pytest.mark.parametrize("script", [INSTALL, UNINSTALL])
def test_without_root_nothing_is_touched(script: Path, tmp_path: Path) -> None:
    nobody: list[str | Path] = []
    if os.geteuid() == 0:
        nobody = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
        shutil.copytree(SYSTEMD, tmp_path / "systemd")
        for folder in (tmp_path, *tmp_path.parents[:-2]):
            if folder.stat().st_uid == os.geteuid():
                folder.chmod(folder.stat().st_mode | 0o555)
        script = tmp_path / "systemd" / script.name
    out = said(*nobody, "sh", script, code=1)
    assert f"say 'sudo make {script.stem}'" in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["vehicel"], "'vehicel' is unknown"),
        (["--root"], "--root wants a folder"),
        (["--help"], "'--help' is unknown; it is: install.sh [vehicle|room|law|page|broker]"),
    ],
)
def test_a_wrong_word_is_answered_with_the_right_ones(words: list[str], says: str) -> None:
    assert says in said(INSTALL, *words, code=2)


@needs_sysusers
def test_a_python_that_the_service_cannot_run_is_refused(tmp_path: Path) -> None:
    old = tmp_path / "old-python"
    old.write_text("#!/bin/sh\nexit 1\n")
    old.chmod(0o755)
    command = [str(INSTALL), "--root", str(tmp_path / "root")]
    done = subprocess.run(command, env={**os.environ, "PYTHON": str(old)}, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert f"'{old}' is older than Python 3.11" in done.stderr


@needs("shellcheck")
def test_the_scripts_are_sound() -> None:
    scripts = [INSTALL, UNINSTALL, SYSTEMD / "try.sh", ROOT / ".ci/run", ROOT / ".ci/fresh-machine"]
    said("shellcheck", *scripts)
