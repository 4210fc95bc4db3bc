"""A network namespace of this process's own, with one interface whose packets a relay carries (Linux, TUN).

So Linux' own TCP, with its retransmissions, and every other protocol run over a link that user space impairs. Root may
do this, and so may others where user namespaces are allowed.
"""

import ctypes
import fcntl
import os
import socket
import struct
from pathlib import Path

GROUND, VEHICLE = "10.77.0.1", "10.77.0.2"
"""Addresses of the two ends."""
_NETMASK = "255.255.255.252"
_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_SIOCSIFADDR, _SIOCSIFNETMASK, _SIOCSIFFLAGS, _IFF_UP = 0x8916, 0x891C, 0x8914, 0x1
_NAME = b"link0"
CONGESTION_CONTROL = "reno"
"""The one that every kernel has and lets a namespace choose. A stream as thin as this one never leaves the part of
CUBIC, Linux' default, that behaves like it; a machine's own default may be another (BBR)."""
_CONGESTION_CONTROL = Path("/proc/sys/net/ipv4/tcp_congestion_control")


class NamespaceError(RuntimeError):
    """There can be no network namespace here; the message is one sentence for a person."""


def enter(address: str) -> int:
    """Move this process, which has no threads yet, into a new namespace; return the packets' file descriptor.

    Each read gives one IP packet that the process sends; each write is one that it receives. Raises NamespaceError.
    """
    _unshare()
    try:
        _CONGESTION_CONTROL.write_text(CONGESTION_CONTROL, encoding="ascii")
        tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH", _NAME, _IFF_TUN | _IFF_NO_PI))
    except OSError as error:
        raise NamespaceError(f"this kernel gives no TUN interface with {CONGESTION_CONTROL} ({error})") from error
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        _set_address(control, _SIOCSIFADDR, address)
        _set_address(control, _SIOCSIFNETMASK, _NETMASK)
        for name in (_NAME, b"lo"):
            fcntl.ioctl(control, _SIOCSIFFLAGS, struct.pack("16sH14x", name, _IFF_UP))
    return tun


def _unshare() -> None:
    user, group = os.geteuid(), os.getegid()
    flags = _CLONE_NEWNET if user == 0 else _CLONE_NEWNET | _CLONE_NEWUSER
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(flags) != 0:
        raise NamespaceError(
            f"this machine allows no network namespace ({os.strerror(ctypes.get_errno())}): run it as root, or allow "
            "user namespaces"
        )
    if flags & _CLONE_NEWUSER:  # without a mapping nobody is root in it
        Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1", encoding="ascii")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1", encoding="ascii")


def _set_address(control: socket.socket, request: int, address: str) -> None:
    fcntl.ioctl(control, request, struct.pack("16sHH4s8x", _NAME, socket.AF_INET, 0, socket.inet_aton(address)))
