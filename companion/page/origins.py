"""Names under which a browser may ask for the page, and origins that may speak to it."""

import ipaddress
import re
import socket

_HOST = re.compile(r"(?:\[(?P<v6>[0-9A-Fa-f:.]{2,45})\]|(?P<name>[A-Za-z0-9._-]{1,253}))(?::(?P<port>[0-9]{1,5}))?")


def own_names(host: str) -> frozenset[str]:
    """Return the names of this computer, in small letters, and that by which the page was told to listen."""
    name = socket.gethostname().lower()
    short = name.partition(".")[0]
    return frozenset({"localhost", name, short, f"{short}.local", host.lower()})


def is_own_host(header: str, names: frozenset[str]) -> bool:
    """Return whether a Host header is an address, or a name of this computer.

    A name that an attacker's name server points at this computer is neither (DNS rebinding).
    """
    found = _HOST.fullmatch(header)
    if found is None:
        return False
    address = found["v6"] or found["name"]
    try:
        ipaddress.ip_address(address)
    except ValueError:
        return found["v6"] is None and address.lower().rstrip(".") in names
    return True


def is_same_origin(origin: str | None, scheme: str, host: str) -> bool:
    """Return whether a request comes from a page of this server; `scheme` is http or https, `host` the Host header."""
    return origin is not None and origin.lower() == f"{scheme}://{host}".lower()
