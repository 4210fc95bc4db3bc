"""TCP keep-alive: a far side that has lost its power says nothing any more, not even goodbye."""

import asyncio
import socket

_IDLE_S, _BETWEEN_S, _PROBES = 2, 1, 3
"""Idle time, interval and count of TCP keepalive probes: 5 s in all."""


def keep_alive(transport: asyncio.BaseTransport) -> None:
    """Let the kernel probe the far side of a TCP connection, and end it when dead; others stay as they are."""
    sock = transport.get_extra_info("socket")
    if sock is None or sock.family not in {socket.AF_INET, socket.AF_INET6}:
        return
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _IDLE_S)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _BETWEEN_S)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _PROBES)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 1000 * (_IDLE_S + _BETWEEN_S * _PROBES))
