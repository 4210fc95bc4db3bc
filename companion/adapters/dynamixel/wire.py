"""The SDK's packet handlers with types: one instruction and its answer, or None. PortGoneError passes through.

The SDK's GroupSyncRead throws away the error field (with the alert bit) and what came before the first missing servo,
so here are its packets, put together differently.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from dynamixel_sdk import COMM_SUCCESS, Protocol1PacketHandler, Protocol2PacketHandler

from companion.adapters.dynamixel.port import BusPort
from companion.adapters.dynamixel.registers import MODEL_NUMBER, Answer, Block, Register

BROADCAST_ID = 0xFE
_PING = 1
_PING_ANSWER = 14
"""Bytes of the longer one, of Protocol 2.0."""
_SECOND_MS = 2.0
"""More than Return Delay Times differ by, 0.5 ms, and an adapter needs."""
_ERROR_AND_ID = 2
_CRC = 2
_ID_AND_ERROR = 2
_LENGTH_END = 7
_FIRST = 8
"""Place of the error field in a status packet of Protocol 2.0."""


class Wire:
    """One port, both protocols; for one thread."""

    def __init__(self, port: BusPort) -> None:
        self.port = port
        self.bad_packets = 0
        self._handlers: dict[int, Any] = {1: Protocol1PacketHandler(), 2: Protocol2PacketHandler()}

    def ping(self, protocol: int, servo_id: int) -> int | None:
        """Return the servo's model number, None when it does not answer.

        Read once more after the SDK's ping, which believes any answer of that ID, also a late one to another question.
        """
        try:
            _, result, _ = self._handlers[protocol].ping(self.port, servo_id)
        except IndexError:  # and takes two bytes of it that may not be there
            return None
        answer = self.read(protocol, servo_id, MODEL_NUMBER) if result == COMM_SUCCESS else None
        return int.from_bytes(answer.data, "little") if answer else None

    def ping_answers(self, protocol: int, servo_id: int) -> int:
        """Return how many status packets come from that ID after a bare ping, which every servo answers.

        After the first it waits on for as long as a second servo with another Return Delay Time may take.
        """
        instruction = [0, 0, servo_id, 2, _PING, 0] if protocol == 1 else [0, 0, 0, 0, servo_id, 3, 0, _PING, 0, 0]
        if self._handlers[protocol].txPacket(self.port, instruction) != COMM_SUCCESS:
            return 0
        self.port.setPacketTimeout(_PING_ANSWER)
        count = 0
        while (packet := self._packet(protocol)) is not None:
            if packet[0] == servo_id:
                count += 1
                self.port.setPacketTimeoutMillis(_SECOND_MS + _PING_ANSWER * self.port.tx_time_per_byte)
        return count

    @property
    def garbled(self) -> bool:
        """True when bytes followed the last instruction; without a valid packet they were replies that collided."""
        return self.port.heard > 0

    def broadcast_ping(self) -> dict[int, int]:
        """Return the model number by ID of all Protocol 2.0 servos; takes about a second."""
        found, _ = self._handlers[2].broadcastPing(self.port)
        return {int(servo_id): int(number) for servo_id, (number, _) in found.items()}

    def read(self, protocol: int, servo_id: int, block: Block) -> Answer | None:
        """Read one servo's block; None when no valid answer came.

        The SDK's own read takes the beginning of a longer, late answer to another question for its own.
        """
        if self._handlers[protocol].readTx(self.port, servo_id, block.start, block.length) != COMM_SUCCESS:
            return None
        while (packet := self._received(protocol)) is not None:
            if packet[:1] == bytes([servo_id]) and len(packet) == _ID_AND_ERROR + block.length:
                return Answer(block.start, packet[_ID_AND_ERROR:], packet[1])
        return None

    def write(self, protocol: int, servo_id: int, address: int, data: bytes) -> int | None:
        """Write registers and return the answer's error field, or None without an answer."""
        result, error = self._handlers[protocol].writeTxRx(self.port, servo_id, address, len(data), list(data))
        if result != COMM_SUCCESS:
            self.bad_packets += 1
            return None
        return int(error)

    def reboot(self, servo_id: int) -> None:
        """Reboot a servo (Protocol 2.0); it does not answer for a while, and may or may not confirm."""
        self._handlers[2].reboot(self.port, servo_id)

    def sync_write(self, protocol: int, register: Register, counts: Mapping[int, int]) -> None:
        """Write the same register of many servos; none answers."""
        params = [byte for servo_id, count in counts.items() for byte in (servo_id, *register.encoded(count))]
        self._handlers[protocol].syncWriteTxOnly(self.port, register.address, register.size, params, len(params))

    def sync_read(self, servo_ids: Sequence[int], block: Block) -> dict[int, Answer]:
        """Read one block of many servos (Protocol 2.0), each answering alone; return the answers that came."""
        answers = dict[int, Answer]()
        if not self._sync_read_sent(servo_ids, block, fast=False):
            return answers
        while len(answers) < len(servo_ids) and (packet := self._received(2)) is not None:
            if packet[0] in servo_ids and len(packet) == _ID_AND_ERROR + block.length:
                answers[packet[0]] = Answer(block.start, packet[_ID_AND_ERROR:], packet[1])
        return answers

    def fast_sync_read(self, servo_ids: Sequence[int], block: Block) -> dict[int, Answer]:
        """Read one block of many servos with all answers in one packet: all or none."""
        if not self._sync_read_sent(servo_ids, block, fast=True):
            return {}
        result = COMM_SUCCESS
        while result == COMM_SUCCESS:
            packet, result = self._handlers[2].rxPacket(self.port, True)
            if result == COMM_SUCCESS and packet[4] == BROADCAST_ID:
                answers = fast_answers(bytes(packet[_FIRST:]), block)
                if set(answers) == set(servo_ids):
                    return answers
        self.bad_packets += 1
        return {}

    def _sync_read_sent(self, servo_ids: Sequence[int], block: Block, fast: bool) -> bool:
        ids = list(servo_ids)
        sent = self._handlers[2].syncReadTx(self.port, block.start, block.length, ids, len(ids), fast)
        return bool(sent == COMM_SUCCESS)

    def _received(self, protocol: int) -> bytes | None:
        """Return the next status packet, see `_packet`; a missing one counts as bad."""
        cut = self._packet(protocol)
        if cut is None:
            self.bad_packets += 1
        return cut

    def _packet(self, protocol: int) -> bytes | None:
        """Return ID, error field and data of the next status packet; None when it is late or broken."""
        if protocol == 1:
            packet, result = self._handlers[1].rxPacket(self.port)
            cut = [packet[2], packet[4], *packet[5 : packet[3] + 3]] if result == COMM_SUCCESS else None
        else:
            packet, result = self._handlers[2].rxPacket(self.port, False)
            # its length counts from behind itself; what stands behind its end is left from the stuffing
            end = _LENGTH_END + packet[5] + 256 * packet[6] - _CRC if result == COMM_SUCCESS else 0
            cut = [packet[4], *packet[_FIRST:end]] if result == COMM_SUCCESS else None
        return bytes(cut) if cut is not None else None


def fast_answers(params: bytes, block: Block) -> dict[int, Answer]:
    """Return the answers in a Fast Sync Read's status packet (e-manual, Protocol 2.0); empty when lengths misfit."""
    one = _ERROR_AND_ID + block.length + _CRC
    if len(params) % one:
        return {}
    pieces = [params[start : start + one] for start in range(0, len(params), one)]
    return {piece[1]: Answer(block.start, piece[_ERROR_AND_ID:-_CRC], piece[0]) for piece in pieces}
