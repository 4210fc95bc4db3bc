"""Property tests on new random examples, round after round: `python -m tests.fuzz [--minutes N] [PYTEST ARGUMENTS]`.

`make test` draws the same examples on every run. This program looks for others, and ends at the first round that fails:
the example it prints is then added to its test with `@example`.
"""

import argparse
import os
import subprocess
import sys
import time
from secrets import randbits

_WHICH = "hypothesis and not realtime"


def main(arguments: list[str]) -> int:
    """Return 0 when every round passed within the time, pytest's exit code of the round that failed, 130 on Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__, allow_abbrev=False)
    parser.add_argument("--minutes", type=float, default=30.0, help="begin no round after this time (default 30)")
    options, rest = parser.parse_known_args(arguments)
    end_s, rounds = time.monotonic() + 60.0 * options.minutes, 0
    try:
        while rounds == 0 or time.monotonic() < end_s:
            rounds += 1
            code = _round(rounds, rest)
            if code:
                print(
                    f"round {rounds} failed: mend it, and add the example above to its test with @example", flush=True
                )
                return code
    except KeyboardInterrupt:
        print(f"interrupted in round {rounds}", flush=True)
        return 130
    print(f"{rounds} rounds, nothing found", flush=True)
    return 0


def _round(number: int, rest: list[str]) -> int:
    seed = randbits(32)
    print(f"round {number}, seed {seed}", flush=True)
    command = [sys.executable, "-m", "pytest", "-q", "-m", _WHICH, f"--hypothesis-seed={seed}", *rest]
    return subprocess.run(command, env={**os.environ, "HYPOTHESIS_PROFILE": "fuzz"}, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
