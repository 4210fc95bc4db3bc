"""The live page's process beside the service or the demo; whatever becomes of it, they go on."""

import contextlib
import json
import logging
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from companion.config.operator_config import OperatorConfig, PageConfig

LOG = logging.getLogger(__name__)

_END_S = 3.0
_NOT_SERVED = "error: "
"""Beginning of the line by which the process says why it cannot serve the page."""


@dataclass(frozen=True)
class PageOptions:
    """Settings of the page's process."""

    broker: OperatorConfig
    page: PageConfig
    token: str = ""
    """One-time login for a browser on this computer; empty: none."""
    vehicles: tuple[str, ...] = ()
    """Vehicles to show; empty: all of the broker."""
    quiet: bool = False
    """Only errors are written to standard error."""

    def line(self) -> bytes:
        """Return it as a line of JSON, as companion.page.settings reads it."""
        models = {"broker": self.broker.model_dump(mode="json"), "page": self.page.model_dump(mode="json")}
        rest = {"token": self.token, "vehicles": self.vehicles, "quiet": self.quiet}
        return json.dumps(models | rest).encode() + b"\n"


@contextmanager
def page_process(settings: PageOptions, hear: Callable[[str], None]) -> Iterator[None]:
    """Run the page; `hear` gets each line of it, from a thread: where it is, or why it is not there any more."""
    process, ending = _begin(settings, hear), threading.Event()
    if process is None:
        yield
        return
    reader = threading.Thread(target=_read, args=(process, hear, ending), name="companion.page", daemon=True)
    reader.start()
    try:
        yield
    finally:
        ending.set()
        _end(process)
        reader.join(_END_S)


def _begin(settings: PageOptions, hear: Callable[[str], None]) -> "subprocess.Popen[bytes] | None":
    try:
        process = subprocess.Popen(
            [sys.executable, "-m", "companion.page"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C ends what we are beside, which then ends it
        )
    except OSError as error:
        hear(f"the page is not served: {error.strerror}")
        return None
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(settings.line())
        process.stdin.flush()
    return process


def _read(process: "subprocess.Popen[bytes]", hear: Callable[[str], None], ending: threading.Event) -> None:
    """Pass each line on, and say so when the process ends too early."""
    assert process.stdout is not None
    said = ""
    with process.stdout:
        for line in process.stdout:
            said = line.decode(errors="replace").strip()
            hear(f"the page is not served: {said.removeprefix(_NOT_SERVED)}" if said.startswith(_NOT_SERVED) else said)
    code = process.wait()
    if not ending.is_set() and not said.startswith(_NOT_SERVED):
        hear(f"the page has ended by itself ({code}): `companion page` starts another one")


def _end(process: "subprocess.Popen[bytes]") -> None:
    assert process.stdin is not None
    with contextlib.suppress(OSError):
        process.stdin.close()
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def log_page(line: str) -> None:
    """Log a line of the page: a warning unless it says where the page is."""
    LOG.log(logging.INFO if line.startswith(("page: ", "the page only looks")) else logging.WARNING, "%s", line)
