"""TCP ports for servers that tests begin."""

import random
import socket

_BELOW_CONNECTIONS = range(20_000, 32_000)
"""Linux gives 32768 to 60999 to connections (net.ipv4.ip_local_port_range): any of them may be taken meanwhile."""


def free_port() -> int:
    """Return a port that nobody listens on now, and that no connection takes before it is used."""
    for port in random.sample(_BELOW_CONNECTIONS, 100):
        with socket.socket() as free:
            free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                free.bind(("", port))
            except OSError:
                continue
            return port
    raise AssertionError("100 ports are taken")
