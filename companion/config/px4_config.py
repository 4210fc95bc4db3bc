"""The autopilot's link: `[px4]`."""

import re

from pydantic import Field, field_validator

from companion.config.toml_files import Section

_SERIAL = "serial:///dev/ttyUSB0:921600"
_NETWORK = "udpin://127.0.0.1:14540"
_SCHEMES = ("udpin", "udpout", "udp", "tcpin", "tcpout", "tcp", "serial", "serial_flowcontrol")
"""Schemes that MAVSDK 4.1 knows (cli_arg.cpp)."""
_PORTS = range(1, 65536)


class Px4Config(Section):
    """The autopilot's link."""

    url: str = Field(
        _NETWORK,
        description="MAVSDK URL: serial:///DEVICE:BAUD, or udpin://ADDRESS:PORT to listen on, where 127.0.0.1 "
        "hears this computer alone and 0.0.0.0 every sender",
    )
    system_id: int | None = Field(
        None, ge=1, le=255, description="PX4's MAV_SYS_ID; none: the first autopilot heard, and no other may be there"
    )
    battery_id: int | None = Field(
        None, ge=0, le=255, description="battery that carries the vehicle: 0 for PX4's BAT1; none: the lowest heard"
    )
    connect_timeout_s: float = Field(10.0, gt=0.0, le=120.0, description="longest wait for the first HEARTBEAT, s")
    answer_timeout_s: float = Field(
        5.0, gt=0.0, le=60.0, description="longest wait until a command shows in PX4's state, s"
    )
    arm_timeout_s: float = Field(
        15.0, gt=0.0, le=120.0, description="time for which arming is asked for again while PX4 refuses, s"
    )
    attitude_delay_s: float = Field(
        0.002,
        ge=0.0,
        le=0.1,
        description="from the instant of PX4's attitude to its arrival, s; a serial line may take 0.005",
    )
    vision_rate_hz: float = Field(
        50.0, ge=0.0, le=100.0, description="rate at which PX4 is sent the mocap pose; 0: never"
    )

    @field_validator("url")
    @classmethod
    def _connects(cls, url: str) -> str:
        wrong = url_fault(url)
        if wrong:
            raise ValueError(wrong)
        return url


def url_fault(url: str) -> str:
    """Return what is wrong with a connection URL and the right form of it; empty when MAVSDK takes it."""
    scheme, separator, rest = url.partition("://")
    if not separator:
        return _without_scheme(url)
    if scheme not in _SCHEMES:
        return (
            f"must begin with {', '.join(f'{known}://' for known in _SCHEMES[:-1])} in small letters, without a space"
        )
    place, _, number = rest.rpartition(":")
    if scheme.startswith("serial"):
        return _serial_fault(rest, place, number)
    return _network_fault(scheme, place, number)


def _network_fault(scheme: str, place: str, number: str) -> str:
    if not place and scheme not in {"udp", "tcp"}:
        return f"must name address and port, such as {scheme}://127.0.0.1:14540"
    if not number.isdecimal() or int(number) not in _PORTS:
        return f"must end with a port from 1 to 65535, such as {scheme}://{place or '127.0.0.1'}:14540"
    if scheme.endswith("out") and place == "0.0.0.0":  # noqa: S104 - nothing is bound here
        return "0.0.0.0 is no address to send to: name the autopilot's, or listen with udpin:// or tcpin://"
    return ""


def _without_scheme(url: str) -> str:
    if re.fullmatch(r"com\d+.*", url, re.IGNORECASE):
        return f"is a name of Windows: on Linux it is such as {_SERIAL}; `ls /dev/serial/by-id` shows what is there"
    if url.startswith("/dev/"):
        device, _, baud = url.partition(":")
        return f"must be serial://{device}:{baud if baud.isdecimal() else '921600'}, with PX4's baud rate at its end"
    return f"must be a connection URL such as {_SERIAL} or {_NETWORK}"


def _serial_fault(rest: str, place: str, number: str) -> str:
    device, baud = (place, number) if number.isdecimal() and place else (rest.rstrip(":"), "")
    if not device.startswith("/"):
        path = f"/{device}" if device.startswith("dev/") else "/dev/ttyUSB0"
        return f"must have three slashes before the device: serial://{path}:{baud or '921600'}"
    if not baud or int(baud) == 0:
        return f"must end with PX4's baud rate, such as serial://{device}:921600"
    return ""
