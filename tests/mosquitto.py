"""The real mosquitto on a port of this machine: with a test's own settings, or as a lab runs it (config/mosquitto/)."""

import getpass
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from companion.config.operator_config import OperatorConfig
from tests.packages import find_program, needs
from tests.ports import free_port

EXAMPLES = Path(__file__).parents[1] / "config" / "mosquitto"
FAR = "127.0.0.2"
"""This machine, but not where an embedded broker would be: operators speak MQTT 5 there."""
USERS = ("dauam-1", "dauam-2", "anna", "ben", "screen", "mocap-bridge")
"""Users of config/mosquitto/dauam.acl, and the vehicles that it is for."""
_PATIENCE_S = 15.0
needs_mosquitto = needs("mosquitto")


class Mosquitto:
    """A process that can be killed and begun again on its port."""

    def __init__(self, host: str, port: int, config: Path) -> None:
        self.host, self.port, self._config = host, port, config
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Returns once it accepts connections."""
        program = find_program("mosquitto")
        assert program is not None, "a test that starts mosquitto is marked with needs_mosquitto"
        self._process = subprocess.Popen([program, "-c", str(self._config)], stderr=subprocess.DEVNULL)
        end_s = time.monotonic() + _PATIENCE_S
        while True:
            try:
                return socket.create_connection((self.host, self.port)).close()
            except OSError:
                if self._process.poll() is not None or time.monotonic() > end_s:
                    self.stop()
                    raise
                time.sleep(0.02)

    def stop(self) -> None:
        """Kill the broker, as when its computer is switched off, except that the sockets are closed."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


@contextmanager
def mosquitto(folder: Path, *lines: str) -> Iterator[int]:
    """Run a broker; yield its port once it accepts connections. `lines` are added to its configuration in `folder`."""
    port = free_port()
    config = folder / "mosquitto.conf"
    config.write_text("\n".join(["per_listener_settings false", f"listener {port} 127.0.0.1", *lines, ""]))
    broker = Mosquitto("127.0.0.1", port, config)
    broker.start()
    try:
        yield port
    finally:
        broker.stop()


@dataclass(frozen=True)
class Lab:
    """A lab's broker, as the example files make it, and what its users need."""

    broker: Mosquitto
    folder: Path

    @property
    def ca_file(self) -> Path:
        """Return the certificate of the authority that signed the broker's."""
        return self.folder / "certs" / "ca.crt"

    @property
    def log(self) -> str:
        """Return the broker's log so far."""
        return (self.folder / "log").read_text(errors="replace")

    def password_file(self, user: str) -> Path:
        """Return the path of a user's password file."""
        return self.folder / f"password-{user}"

    def place(self, user: str, vehicle: str = "dauam-1") -> OperatorConfig:
        """Return the [operator] table for a user and a vehicle."""
        return OperatorConfig(
            host=self.broker.host,
            port=self.broker.port,
            vehicle=vehicle,
            user=user,
            password_file=str(self.password_file(user)),
            tls=True,
            ca_file=str(self.ca_file),
        )


@contextmanager
def lab(folder: Path) -> Iterator[Lab]:
    """Run a broker with the files of config/mosquitto/; only paths and the port are the test's."""
    make_certificates(folder / "certs", FAR)
    (folder / "dauam.passwd").touch(0o600)
    program = find_program("mosquitto_passwd")
    assert program is not None, "mosquitto_passwd comes with mosquitto"
    for user in USERS:
        (folder / f"password-{user}").touch(0o600)
        (folder / f"password-{user}").write_text(f"of {user}\n")
        subprocess.run([program, "-b", str(folder / "dauam.passwd"), user, f"of {user}"], check=True)
    shutil.copy(EXAMPLES / "dauam.acl", folder)
    (folder / "dauam.acl").chmod(0o600)
    port = free_port()
    text = (EXAMPLES / "dauam.conf").read_text(encoding="utf-8")
    for old, new in (("listener 8883", f"listener {port} {FAR}"), ("/etc/mosquitto/", f"{folder}/")):
        assert old in text, f"config/mosquitto/dauam.conf has no {old!r} any more"
        text = text.replace(old, new)
    # What Debian's own mosquitto.conf says besides, and that we are not root.
    text += f"\nlog_dest file {folder}/log\nuser {getpass.getuser()}\n"
    (folder / "dauam.conf").write_text(text, encoding="utf-8")
    broker = Mosquitto(FAR, port, folder / "dauam.conf")
    broker.start()
    try:
        yield Lab(broker, folder)
    finally:
        broker.stop()


def make_certificates(folder: Path, *names: str) -> None:
    """Run config/mosquitto/make-certificates.sh in a folder of the test."""
    script = EXAMPLES / "make-certificates.sh"
    made = subprocess.run([script, folder, *names], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stdout + made.stderr
