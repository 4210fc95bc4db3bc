"""MAVSDK's UDP socket hears one sender; what everybody else sends is heard here.

MAVSDK takes frames from every sender to its port, and sends its own to all of them. The kernel can divide the
datagrams of one port among several sockets by a small program (SO_REUSEPORT and SO_ATTACH_REUSEPORT_CBPF, socket(7),
Linux 4.5): here those of the accepted sender go to MAVSDK's socket, and all others to a second one. Broadcasts go to
both, so that a filter on MAVSDK's socket (SO_ATTACH_FILTER) drops what is not the sender's. No code of this
process is in between. A sender is identified by address and port, which can be forged on the same network.
"""

import ctypes
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

Endpoint = tuple[str, int]
"""Address and port."""

_SO_ATTACH_FILTER, _SO_ATTACH_REUSEPORT_CBPF = 26, 51
_NETWORK_HEADER = 0xFFF00000
"""SKF_NET_OFF of linux/filter.h, as an unsigned number: what follows is an offset in the IP header."""
_LOAD_BYTE, _LOAD_HALF, _LOAD_WORD, _JUMP_EQUAL, _RETURN = 0x30, 0x28, 0x20, 0x15, 0x06
_MAVSDK, _OURS = 0, 1
"""Places in the port's group, in the order of their entry."""
_DROP, _WHOLE = 0, 0xFFFFFFFF
"""Bytes of a datagram that the filter keeps."""
_BUFFER_BYTES = 65536
_DATAGRAM_BYTES = 512
_MOST = 50
"""Datagrams at a time: a flood must not hold up the control loop."""


class SenderFilter:
    """The second socket on MAVSDK's port."""

    def __init__(self, host: str, port: int) -> None:
        """Join the UDP socket that MAVSDK has in this process on `port`.

        Until a sender is accepted MAVSDK receives nothing. Raises OSError where the kernel cannot do it.
        """
        self._theirs = _udp_socket(port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._join(host, port)
            self._attach(((_RETURN, 0, 0, _DROP),), ((_RETURN, 0, 0, _OURS),))
        except OSError:
            self.close()
            raise

    def _join(self, host: str, port: int) -> None:
        for one in (self._theirs, self._socket):
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        self._socket.bind((host, port))
        for one in (self._theirs, self._socket):  # a later program must not take the port over
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)

    def accept(self, sender: Endpoint) -> None:
        """Let MAVSDK hear this sender alone from now on."""
        self._attach(_is_from(sender, _WHOLE, _DROP), _is_from(sender, _MAVSDK, _OURS))

    def others(self) -> Iterator[tuple[Endpoint, bytes]]:
        """Return what others sent since the last time, with who sent it; not all of a flood. Never waits."""
        for _ in range(_MOST):
            try:
                data, sender = self._socket.recvfrom(_DATAGRAM_BYTES, socket.MSG_DONTWAIT)
            except OSError:
                return
            yield sender, data

    def close(self) -> None:
        """Leave the port; MAVSDK's socket keeps its filter until it is closed."""
        self._socket.close()
        self._theirs.close()

    def _attach(self, keep: "_Program", place: "_Program") -> None:
        _set_program(self._theirs, _SO_ATTACH_FILTER, keep)
        _set_program(self._socket, _SO_ATTACH_REUSEPORT_CBPF, place)


_Program = tuple[tuple[int, int, int, int], ...]
"""Lines of classic BPF: operation, jumps if true and if not, operand."""


def _is_from(sender: Endpoint, yes: int, no: int) -> _Program:
    """Return a program that says `yes` to a datagram of this sender, and `no` to every other."""
    (address,) = struct.unpack("!I", socket.inet_aton(sender[0]))
    return (
        (_LOAD_BYTE, 0, 0, _NETWORK_HEADER),
        (_JUMP_EQUAL, 0, 5, 0x45),  # IPv4 with a header of 20 bytes
        (_LOAD_WORD, 0, 0, _NETWORK_HEADER + 12),
        (_JUMP_EQUAL, 0, 3, address),
        (_LOAD_HALF, 0, 0, _NETWORK_HEADER + 20),
        (_JUMP_EQUAL, 0, 1, sender[1]),
        (_RETURN, 0, 0, yes),
        (_RETURN, 0, 0, no),
    )


def _set_program(one: socket.socket, option: int, program: _Program) -> None:
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in program))
    one.setsockopt(socket.SOL_SOCKET, option, struct.pack("HxxxxxxQ", len(program), ctypes.addressof(code)))


def _udp_socket(port: int) -> socket.socket:
    """Return another handle of this process's UDP socket on the port; OSError when there is none."""
    for entry in Path("/proc/self/fd").iterdir():
        found = _socket_of(int(entry.name))
        if found is None:
            continue
        udp = found.family == socket.AF_INET and found.type == socket.SOCK_DGRAM
        if udp and found.getsockname()[1] == port:
            return found
        found.close()
    raise OSError(f"MAVSDK has no UDP socket on port {port}")


def _socket_of(number: int) -> socket.socket | None:
    try:
        handle = os.dup(number)
    except OSError:
        return None
    try:
        return socket.socket(fileno=handle)
    except OSError:
        os.close(handle)
        return None
