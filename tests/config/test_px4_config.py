"""px4.url is looked at when the file is read: every mistake gets the right form."""

import pytest

from companion.config.px4_config import Px4Config, url_fault


@pytest.mark.parametrize(
    "url",
    [
        "serial:///dev/ttyACM0:921600",
        "serial:///dev/serial/by-id/usb-Auterion_PX4_FMU_v6C.x_0-if00:57600",
        "serial:///dev/serial/by-path/pci-0000:00:14.0-usb-0:3:1.0-port0:921600",
        "serial_flowcontrol:///dev/ttyTHS1:921600",
        "udpin://0.0.0.0:14540",
        "udpin://vehicle.lab:14540",
        "udpout://192.168.0.3:14550",
        "udp://:14540",
        "tcpout://127.0.0.1:5760",
    ],
)
def test_what_mavsdk_takes_is_taken(url: str) -> None:
    assert url_fault(url) == ""
    assert Px4Config(url=url).url == url


@pytest.mark.parametrize(
    ("url", "right"),
    [
        ("/dev/ttyACM0", "must be serial:///dev/ttyACM0:921600"),
        ("/dev/ttyACM0:57600", "must be serial:///dev/ttyACM0:57600"),
        ("com3", "name of Windows: on Linux it is such as serial:///dev/ttyUSB0:921600"),
        ("serial://dev/ttyACM0:921600", "three slashes before the device: serial:///dev/ttyACM0:921600"),
        ("serial://COM3:921600", "serial:///dev/ttyUSB0:921600"),
        ("serial:/dev/ttyACM0:57600", "must be a connection URL such as"),
        ("serial:///dev/ttyACM0", "PX4's baud rate, such as serial:///dev/ttyACM0:921600"),
        ("serial:///dev/ttyACM0:", "PX4's baud rate, such as serial:///dev/ttyACM0:921600"),
        ("serial:///dev/ttyACM0:0", "PX4's baud rate"),
        ("udpin://:14540", "such as udpin://127.0.0.1:14540"),
        ("udpin://127.0.0.1", "address and port, such as udpin://127.0.0.1:14540"),
        ("udpin://127.0.0.1:70000", "a port from 1 to 65535, such as udpin://127.0.0.1:14540"),
        ("udpin://127.0.0.1:x", "a port from 1 to 65535"),
        ("udpout://0.0.0.0:14540", "no address to send to"),
        ("UDPIN://127.0.0.1:14540", "in small letters"),
        (" udpin://127.0.0.1:14540", "without a space"),
        ("raw://", "must begin with udpin://"),
        ("http://127.0.0.1:80", "must begin with udpin://"),
        ("", "must be a connection URL such as"),
        ("14540", "must be a connection URL such as"),
    ],
)
def test_what_mavsdk_does_not_take_is_told_with_the_right_form(url: str, right: str) -> None:
    assert right in url_fault(url)
    with pytest.raises(ValueError, match="1 validation error"):
        Px4Config(url=url)
