"""The service as the process that is measured: takes off, says so, hovers until standard input ends.

Run as `python -m benchmarks.subject JSON`. Prints "flying" once it hovers, and at the end one line of JSON: for each
cycle that used a frame and sent a setpoint, when the one came and the other left (s, monotonic).
"""

import asyncio
import json
import sys
from dataclasses import replace

import numpy as np
import uvloop
from pydantic import BaseModel

from companion.adapters.system.watchdog_timer import KernelWatchdogTimer
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController, load_controller
from companion.control.etnn import Etnn
from companion.records.recorder import Recorder
from companion.service.local_operator import open_local_operator


class Task(BaseModel):
    """Flight that the child process flies, read from its arguments."""

    config: CompanionConfig
    controller: str
    every_cycle: bool
    """Send in every cycle, event or not."""

    def law(self) -> LoadedController:
        """Return the control law of the flight."""
        loaded = load_controller(self.controller, self.config.vehicle_model(), 1.0 / self.config.control.rate_hz)
        if self.every_cycle and isinstance(loaded.law, Etnn):
            gains = loaded.law.gains.model_copy(update={"every_cycle": True})
            return replace(loaded, law=replace(loaded.law, gains=gains))
        return loaded


def main() -> None:
    """Fly the task of the first argument."""
    uvloop.run(_fly(Task.model_validate_json(sys.argv[1])))


async def _fly(task: Task) -> None:
    recorder = Recorder()
    watchdog_timer = KernelWatchdogTimer(task.config.safety.dead_man_s)
    async with open_local_operator(task.config, task.law(), recorder, watchdog_timer) as operator:
        await operator.do("arm")
        await operator.do("takeoff")
        print("flying", flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    columns = recorder.arrays()
    times = np.stack((columns["frame_received_s"], columns["sent_s"]), axis=-1)
    print(json.dumps(times[np.isfinite(times).all(axis=-1)].tolist()), flush=True)


if __name__ == "__main__":
    main()
