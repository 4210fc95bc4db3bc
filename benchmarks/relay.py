"""The least that can stand between mocap and autopilot: frame in, its pose as a setpoint out. No control, no state.

What the service takes longer than this is its own; what this takes is the machine's, Python's and the kernel's.
Run as `python -m benchmarks.relay PORT` with the port that takes the setpoints; prints the port it listens on.
"""

import socket
import struct
import sys
import time

from pymavlink.dialects.v20 import common as mavlink

_BODY = struct.Struct("<13f")
_BODY_AT = 8 + 16 + 8 + 8
"""After the packet's header, the frame's, the component's and the count of bodies."""


def main() -> None:
    """Answer every frame with a setpoint until the process is killed."""
    target = ("127.0.0.1", int(sys.argv[1]))
    codec = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as inward:
        inward.bind(("127.0.0.1", 0))
        print(inward.getsockname()[1], flush=True)
        outward = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        while True:
            outward.sendto(_setpoint(inward.recv(2048), codec), target)


def _setpoint(datagram: bytes, codec: mavlink.MAVLink) -> bytes:
    """The measured height as thrust, the rotation's last column as attitude: nonsense, but as many bytes."""
    pose = _BODY.unpack_from(datagram, _BODY_AT)
    message = mavlink.MAVLink_set_attitude_target_message(
        int(time.monotonic() * 1e3) & 0xFFFFFFFF, 1, 1, 7, [1.0, *pose[9:12]], 0.0, 0.0, 0.0, 1e-3 * pose[2]
    )
    return bytes(message.pack(codec))


if __name__ == "__main__":
    main()
