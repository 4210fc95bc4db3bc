"""The `companion` command; imports nothing slow before Ctrl-C is handled."""

import os
import signal
import sys
from types import FrameType

_INTERRUPTED = 130


def main() -> None:
    """Run the command line, see commands.run."""
    before = signal.signal(signal.SIGINT, _end)
    try:
        from companion.cli.commands import run  # noqa: PLC0415 - half a second in which the user may press Ctrl-C

        run()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(_INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, before)


def _end(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - a signal's handler
    """End the process at once: nothing has begun, and some modules turn a KeyboardInterrupt into another error."""
    os.write(2, b"interrupted\n")
    os._exit(_INTERRUPTED)


if __name__ == "__main__":
    main()
