"""The far end of the arms' bus and of motion capture: simulated servos on a pty, and 100 datagrams a second.

Run as `python -m benchmarks.servo_end PORT`. Prints the pty's path; from then on sends its clock (s, monotonic) to UDP
PORT at 100 Hz, until standard input ends. Both come from one process beside the one that is measured, as they would
come from outside the computer; the servos' simulation takes its share of the machine, which real servos do not.
"""

import asyncio
import socket
import struct
import sys
import time

from mock_autopilot.servos.bus import ServoBus
from mock_autopilot.servos.config import DynamixelConfig

RATE_HZ = 100.0
STAMP = struct.Struct("<d")
_STEP_S = 0.002


class Servos:
    """The bus, with simulated time following the clock whenever something is asked."""

    def __init__(self) -> None:
        self.bus = ServoBus(DynamixelConfig(), self.catch_up)
        self._time_s = time.monotonic()

    def catch_up(self) -> None:
        """Bring the servos to the present."""
        now_s = time.monotonic()
        while self._time_s < now_s:
            self._time_s += _STEP_S
            self.bus.servos.step(_STEP_S)


async def _send_frames(port: int, servos: Servos) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as frames:
        due_s = time.monotonic()
        while True:
            due_s += 1.0 / RATE_HZ
            await asyncio.sleep(due_s - time.monotonic())
            servos.catch_up()
            frames.sendto(STAMP.pack(time.monotonic()), ("127.0.0.1", port))


async def _serve(port: int) -> None:
    servos = Servos()
    servos.bus.open()
    sending = asyncio.create_task(_send_frames(port, servos))
    try:
        print(servos.bus.path, flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    finally:
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)
        servos.bus.close()


if __name__ == "__main__":
    asyncio.run(_serve(int(sys.argv[1])))
