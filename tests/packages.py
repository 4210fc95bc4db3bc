"""Programs of the system that pip cannot install: finding them, marking the tests that need them, installing them."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

PACKAGES = {
    "chromium": "chromium",
    "jq": "jq",
    "mosquitto": "mosquitto",
    "mosquitto_passwd": "mosquitto",
    "mosquitto_rr": "mosquitto-clients",
    "openssl": "openssl",
    "setpriv": "util-linux",
    "shellcheck": "shellcheck",
    "systemd-analyze": "systemd",
    "systemd-sysusers": "systemd",
    "udevadm": "udev",
}
"""Debian's (and Ubuntu's) package of each program that a test runs."""
HIDE = "TESTS_WITHOUT_PACKAGES"
"""Environment variable: when set, no program of PACKAGES is found, as on a machine where none is installed."""
SKIPPED = "not installed: "
"""Beginning of the reason of every test that is skipped because a program is missing; the packages follow."""
_POLICY = Path("/usr/sbin/policy-rc.d")


def find_program(name: str) -> str | None:
    """Return the path of a program of PACKAGES, None where it is not installed."""
    if os.environ.get(HIDE):
        return None
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


def needs(*programs: str) -> pytest.MarkDecorator:
    """Mark a test that runs these programs: it is skipped where one is missing, and fails in CI."""
    return pytest.mark.needs(*programs)


def missing_packages(programs: tuple[str, ...]) -> list[str]:
    """Return the packages to install so that all `programs` are found, sorted."""
    return sorted({PACKAGES[name] for name in programs if find_program(name) is None})


def install_missing() -> None:
    """Install what is missing where we may (root, and apt-get is there); print one line either way.

    A failing installation is no failure here: the tests concerned are then skipped with their reason.
    """
    missing = missing_packages(tuple(PACKAGES))
    if not missing or os.geteuid() != 0 or shutil.which("apt-get") is None:
        return
    print(f"installing Debian packages that tests need: {' '.join(missing)} ...", flush=True)
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    install = ["apt-get", "install", "-y", "-qq", "--no-install-recommends", *missing]
    with _no_service_starts():
        for command in (["apt-get", "update", "-qq"], install):
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
                print(f"{' '.join(command[:2])} failed ({last}): tests that need them are skipped", flush=True)
                return


@contextmanager
def _no_service_starts() -> Iterator[None]:
    """Keep a package's service (mosquitto's) from starting on installation; tests start their own."""
    if _POLICY.exists():
        yield
        return
    _POLICY.write_text("#!/bin/sh\nexit 101\n", encoding="utf-8")
    _POLICY.chmod(0o755)
    try:
        yield
    finally:
        with suppress(FileNotFoundError):
            _POLICY.unlink()
