"""Measurement of a law's stability margins in a separate process.

Half a second of Python in a thread of the flight process delays its ticks by 40 ms and starves the arms' bus.
"""

import json
import subprocess
import sys
from dataclasses import asdict

from companion.adapters.system.realtime import beside_the_loop
from companion.config.controller_config import LoadedController, load_controller
from companion.config.law_margin import measured
from companion.control.controller import VehicleModel
from companion.control.margin import Margin, Verdict
from companion.core.interfaces import ConfigError

_WITHIN_S = 7.0
"""Timeout, below the 8 s within which a command is answered; an idle computer needs 1.5 s."""


class MarginUnknownError(ConfigError):
    """Error of a measurement that has not come to its end; nothing is known of the law."""


def measure_apart(loaded: LoadedController, vehicle: VehicleModel, period_s: float) -> Margin | str:
    """Return the law's margins, or why there are none; blocks for one to two seconds, so call it in a thread.

    Raises MarginUnknownError when the process fails. A user's own law may be too slow.
    """
    asked = json.dumps({"name": loaded.name, "vehicle": asdict(vehicle), "period_s": period_s})
    command = [sys.executable, "-m", "companion.service.margin_process"]
    try:
        ran = subprocess.run(  # noqa: S603 - this program, with our arguments
            command, input=asked, capture_output=True, text=True, timeout=_WITHIN_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        if loaded.own_file is not None and isinstance(error, subprocess.TimeoutExpired):
            return f"{_WITHIN_S:.0f} s on this computer were not enough for it"
        raise MarginUnknownError(
            f"{loaded.name}: its stability margin could not be measured, try again: {_why(error)}"
        ) from error
    if ran.returncode != 0:
        why = (ran.stderr.strip().splitlines() or [f"exit code {ran.returncode}"])[-1]
        raise MarginUnknownError(f"{loaded.name}: its stability margin could not be measured, try again: {why}")
    found = json.loads(ran.stdout.strip().splitlines()[-1])
    return found if isinstance(found, str) else Margin(**found | {"verdict": Verdict(found["verdict"])})


def _why(error: Exception) -> str:
    """Return the reason of a failure, without the command line."""
    late = isinstance(error, subprocess.TimeoutExpired)
    return f"{_WITHIN_S:.0f} s were not enough, this computer is busy" if late else str(error)


def main() -> None:
    """Read a request from standard input and print its result as JSON on standard output."""
    beside_the_loop()
    asked = json.load(sys.stdin)
    vehicle, period_s = VehicleModel(**asked["vehicle"]), asked["period_s"]
    loaded = load_controller(asked["name"], vehicle, period_s, allow_unstable=True)
    found = measured(loaded, vehicle, period_s)
    print(json.dumps(found if isinstance(found, str) else asdict(found)))


if __name__ == "__main__":
    main()
