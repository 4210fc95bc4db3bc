"""Packets printed in the ROBOTIS e-manual, byte for byte.

https://emanual.robotis.com/docs/en/dxl/protocol1/ (servos RX-64) and https://emanual.robotis.com/docs/en/dxl/protocol2/
(servos XM430-W210, firmware 38), "Instruction Details".
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Example:
    """An instruction of the manual, taken apart, and the answers printed with it."""

    name: str
    protocol: int
    id: int
    instruction: int
    params: str
    request: str
    answers: tuple[str, ...] = ()

    @property
    def request_bytes(self) -> bytes:
        """Return the host's packet as bytes."""
        return bytes.fromhex(self.request)

    @property
    def param_bytes(self) -> bytes:
        """Return the parameters of the host's packet."""
        return bytes.fromhex(self.params)

    @property
    def answer_bytes(self) -> list[bytes]:
        """Return the servos' packets in order."""
        return [bytes.fromhex(answer) for answer in self.answers]


_DONE = "FF FF FD 00 01 04 00 55 00 A1 0C"
_DONE_1 = "FF FF 01 02 00 FC"

PROTOCOL_1 = (
    Example("ping", 1, 1, 0x01, "", "FF FF 01 02 01 FB", (_DONE_1,)),
    Example("read", 1, 1, 0x02, "2B 01", "FF FF 01 04 02 2B 01 CC", ("FF FF 01 03 00 20 DB",)),
    Example("write", 1, 0xFE, 0x03, "03 01", "FF FF FE 04 03 03 01 F6"),
    Example("reg write", 1, 1, 0x04, "1E F4 01", "FF FF 01 05 04 1E F4 01 E2", (_DONE_1,)),
    Example("action", 1, 0xFE, 0x05, "", "FF FF FE 02 05 FA"),
    Example("factory reset", 1, 0, 0x06, "", "FF FF 00 02 06 F7"),
    Example(
        "sync write",
        1,
        0xFE,
        0x83,
        "1E 04 00 10 00 50 01 01 20 02 60 03",
        "FF FF FE 0E 83 1E 04 00 10 00 50 01 01 20 02 60 03 67",
    ),
    Example(
        "bulk read",
        1,
        0xFE,
        0x92,
        "00 02 01 1E 02 02 24",
        "FF FF FE 09 92 00 02 01 1E 02 02 24 1D",
        ("FF FF 01 04 00 00 80 7A", "FF FF 02 04 00 00 80 79"),
    ),
)

PROTOCOL_2 = (
    Example("ping", 2, 1, 0x01, "", "FF FF FD 00 01 03 00 01 19 4E", ("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",)),
    Example(
        "broadcast ping",
        2,
        0xFE,
        0x01,
        "",
        "FF FF FD 00 FE 03 00 01 31 42",
        ("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D", "FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D"),
    ),
    Example(
        "read",
        2,
        1,
        0x02,
        "84 00 04 00",
        "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",
        ("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",),
    ),
    Example("write", 2, 1, 0x03, "74 00 00 02 00 00", "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89", (_DONE,)),
    Example("reg write", 2, 1, 0x04, "68 00 C8 00 00 00", "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E", (_DONE,)),
    Example("action", 2, 1, 0x05, "", "FF FF FD 00 01 03 00 05 02 CE", (_DONE,)),
    Example("factory reset", 2, 1, 0x06, "01", "FF FF FD 00 01 04 00 06 01 A1 E6"),
    Example("reboot", 2, 1, 0x08, "", "FF FF FD 00 01 03 00 08 2F 4E", (_DONE,)),
    Example("clear", 2, 1, 0x10, "01 44 58 4C 22", "FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC", (_DONE,)),
    Example(
        "sync read",
        2,
        0xFE,
        0x82,
        "84 00 04 00 01 02",
        "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
        ("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0", "FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE"),
    ),
    Example(
        "sync write",
        2,
        0xFE,
        0x83,
        "74 00 04 00 01 96 00 00 00 02 AA 00 00 00",
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
    Example(
        "bulk read",
        2,
        0xFE,
        0x92,
        "01 90 00 02 00 02 92 00 01 00",
        "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
        ("FF FF FD 00 01 06 00 55 00 77 00 C3 69", "FF FF FD 00 02 05 00 55 00 24 8B A9"),
    ),
    Example(
        "bulk write",
        2,
        0xFE,
        0x93,
        "01 20 00 02 00 A0 00 02 1F 00 01 00 50",
        "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
    ),
)

FAST_SYNC_READ_ANSWER = bytes.fromhex(
    "FF FF FD 00 FE 19 00 55 00 03 A6 00 00 00 84 08 00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E"
)
"""IDs 3, 7 and 4 at 166, 2079 and 1023."""
