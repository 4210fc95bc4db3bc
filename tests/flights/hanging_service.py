"""A companion that takes off, hovers, and then hangs as a line on its standard input says; refused, it stays as it is.

It first waits for a line, so that importing all of it takes no time of a flight.
"""

import asyncio
import ctypes
import logging
import sys
import time
from collections.abc import Callable

import uvloop

from companion.adapters.system.watchdog_timer import KernelWatchdogTimer
from companion.config.companion_config import CompanionConfig, load_config
from companion.config.controller_config import load_controller
from companion.core.interfaces import FlightError
from companion.service.local_operator import open_local_operator
from tests.flights.command import ROOT

HEIGHT_M = 1.0
FOREVER_S = 60
PATIENT = {"coast_s": 0.2, "degraded_s": 0.3, "silent_s": 0.5, "delayed_s": 0.3, "slow_hz": 5.0}
"""A machine that is shared keeps frames waiting now and then; that is not what is tried here."""
HANGS: dict[str, Callable[[], object]] = {
    "block": lambda: time.sleep(FOREVER_S),
    "gil": lambda: ctypes.PyDLL(None).sleep(FOREVER_S),
}
"""In the event loop's thread; the second one keeps the interpreter's lock as a bad C extension would."""


def configured(url: str, qualisys_port: int) -> CompanionConfig:
    """The demo's configuration without arms, climbing briskly, on the ports of a test."""
    config = load_config(ROOT / "config" / "demo.toml")
    return config.model_copy(
        update={
            "px4": config.px4.model_copy(update={"url": url}),
            "mocap": config.mocap.model_copy(update={"port": qualisys_port}),
            "arms": None,
            "safety": config.safety.model_copy(update=PATIENT),
            "flight": config.flight.model_copy(update={"climb_speed_mps": 1.0, "spool_up_s": 0.5}),
        }
    )


async def fly_and_hang(config: CompanionConfig) -> None:
    """Hover, and hang when told."""
    law = load_controller("etnn", config.vehicle_model(), 0.01)
    watchdog_timer = KernelWatchdogTimer(config.safety.dead_man_s)
    async with open_local_operator(config, law, lambda _tick: None, watchdog_timer) as operator:
        try:
            await operator.do("arm")
        except FlightError as error:
            print(error, flush=True)
        else:
            await operator.do("takeoff", height_m=HEIGHT_M)
            print("hovering", flush=True)
        order = await asyncio.to_thread(sys.stdin.readline)
        print(f"hangs at {time.monotonic()}", flush=True)
        HANGS[order.strip()]()


def main() -> None:
    """hanging_service.py URL QUALISYS_PORT."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    config = configured(sys.argv[1], int(sys.argv[2]))
    sys.stdin.readline()
    uvloop.run(fly_and_hang(config))


if __name__ == "__main__":
    main()
