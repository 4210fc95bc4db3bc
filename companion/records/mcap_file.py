"""MCAP files that may be cut off, damaged, or another program's, with memory bounded by what is really in them.

The MCAP library believes every length that it reads: one wrong byte asks it for 2**64 bytes. Here no read goes beyond
the end of the file, nothing is unpacked to more than it claims to be, and each chunk is held against its checksum.
https://mcap.dev/spec
"""

import os
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import Any, BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import Channel, Chunk, ChunkIndex, Footer, McapRecord, Message, Schema
from mcap.stream_reader import MAGIC_SIZE, StreamReader

from companion.records.errors import RecordError

MAGIC = b"\x89MCAP0\r\n"
BROKEN = (
    McapError, EOFError, struct.error, zstandard.ZstdError, ValueError, LookupError, TypeError, AttributeError,
    RuntimeError, ArithmeticError, MemoryError,
)  # fmt: skip
"""Exceptions that reading damaged bytes may raise."""
LARGEST_CHUNK = 256_000_000
"""Bytes of a chunk, unpacked: a hundred times half a second of the largest law's row."""
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_LARGEST_RECORD = 4 * 2**30
_WINDOW = 2**23
"""Bytes that unpacking may look back; the writer's own take 2 MB."""
_PIECE = 2**18


class DamagedChunkError(ValueError):
    """A chunk does not contain what it claims to."""


class BoundedFile:
    """A binary file that is never asked for more than is left in it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = os.fstat(file.fileno()).st_size

    def read(self, length: int) -> bytes:
        """Return exactly `length` bytes; EndOfFile where there are fewer."""
        if not 0 <= length <= self.size - self._file.tell():
            raise EndOfFile
        return self._file.read(length)

    def tell(self) -> int:
        """Return the place of the next byte."""
        return self._file.tell()

    def seek(self, at: int) -> None:
        """Go to a place; EndOfFile where the file has none."""
        if not 0 <= at <= self.size:
            raise EndOfFile
        self._file.seek(at)

    def reader(self, **how: Any) -> Iterator[McapRecord]:
        """Return the records from here on, chunks as they are."""
        stream: Any = self
        return iter(StreamReader(stream, emit_chunks=True, record_size_limit=_LARGEST_RECORD, **how).records)

    def chunk(self, at: int) -> Chunk:
        """Return the chunk whose record begins at a place."""
        self.seek(at + _RECORD.size)
        stream: Any = self
        chunk: Chunk = Chunk.read(ReadDataStream(stream))
        return chunk

    def summary(self) -> bytes:
        """Return the summary's records as they are; nothing where the file has none. Raises one of BROKEN."""
        end = self.size - FOOTER_SIZE - MAGIC_SIZE
        self.seek(end)
        footer = next(self.reader(skip_magic=True))
        if not isinstance(footer, Footer) or footer.summary_start == 0:
            return b""
        self.seek(footer.summary_start)
        return self.read(end - footer.summary_start)


def places(data: bytes, opcode: int) -> list[int]:
    """Return the places of the contents of one kind of record, without looking into any. Raises one of BROKEN."""
    return [at for kind, at, _ in _records_in(data) if kind == opcode]


def _records_in(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield each record's kind, and where its content begins and ends; EndOfFile where the last one is cut off."""
    at = 0
    while at < len(data):
        kind, length = _RECORD.unpack_from(data, at)
        begin, at = at + _RECORD.size, at + _RECORD.size + length
        if at > len(data):
            raise EndOfFile
        yield kind, begin, at


def stream_at(data: bytes, at: int) -> ReadDataStream:
    """Return what a record's own `read` takes."""
    return ReadDataStream(BytesIO(data[at:]))


class McapFile:
    """All records of an MCAP file in their order, the chunks unpacked, as far as they can be read.

    A damaged chunk is left out. Where the chain of records is broken, reading goes on at the next chunk that the
    summary names; a file that was cut off has no summary.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = BoundedFile(file)
        self.damage: list[str] = []
        """In words, the parts that could not be read; nothing where the file is only cut off."""
        self.truncated = False
        """The file ends in the middle, or nothing after a damaged part can be read."""

    def __iter__(self) -> Iterator[McapRecord]:
        """Read the whole file and return the flight; call it once."""
        reader = self._file.reader()
        while True:
            at = self._file.tell()
            try:
                record = next(reader)
            except StopIteration:
                return
            except BROKEN as error:
                if not isinstance(error, EndOfFile):
                    self.note(at, _in_words(error))
                later = self._next_chunk(at)
                if later is None:
                    self.truncated = True
                    return
                if not self.damage:
                    self.note(at, "a wrong length")
                self._file.seek(later)
                reader = self._file.reader(skip_magic=True)
                continue
            yield from self._unpacked(record, at)

    def note(self, at: int, what: str) -> None:
        """Remember a part that cannot be read."""
        self.damage.append(f"{what} at byte {at}")

    def tell(self) -> int:
        """Return the place up to which it was read."""
        return self._file.tell()

    def _unpacked(self, record: McapRecord, at: int) -> list[McapRecord]:
        if not isinstance(record, Chunk):
            return [record]
        try:
            return unpacked(record)
        except BROKEN as error:
            self.note(at, _in_words(error))
            return []

    def _next_chunk(self, at: int) -> int | None:
        try:
            summary = self._file.summary()
            indexes = [ChunkIndex.read(stream_at(summary, place)) for place in places(summary, Opcode.CHUNK_INDEX)]
        except BROKEN:
            return None
        offsets = [one.chunk_start_offset for one in indexes]
        return min((offset for offset in offsets if at < offset < self._file.size), default=None)


def unpacked(chunk: Chunk) -> list[McapRecord]:
    """Return what is in a chunk; DamagedChunkError, or one of BROKEN, where it is not what it claims to be.

    Messages are taken apart here: the library reads number by number, which takes four times as long.
    """
    data = content(chunk)
    found: list[McapRecord] = []
    for kind, begin, end in _records_in(data):
        if kind == Opcode.MESSAGE:
            if end - begin < _MESSAGE.size:
                raise EndOfFile
            channel_id, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(data, begin)
            found.append(Message(channel_id, log_ns, data[begin + _MESSAGE.size : end], publish_ns, sequence))
        elif kind in {Opcode.CHANNEL, Opcode.SCHEMA}:
            record = Channel if kind == Opcode.CHANNEL else Schema
            found.append(record.read(stream_at(data, begin)))
    return found


def content(chunk: Chunk) -> bytes:
    """Return the records in a chunk as they are; DamagedChunkError, or one of BROKEN, where it is damaged."""
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise DamagedChunkError(f"a chunk of {size} bytes")
    data = _decompressed(chunk, size)
    if len(data) != size or (chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc):
        raise DamagedChunkError("a chunk whose checksum is not its content's")
    return data


def _decompressed(chunk: Chunk, size: int) -> bytes:
    """Unpack at most one byte more than `size`."""
    if chunk.compression == "":
        return chunk.data
    if chunk.compression == "lz4":
        data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        return data
    if chunk.compression != "zstd":
        raise DamagedChunkError(f"a chunk packed as {chunk.compression!r}")
    pieces, left = [], size + 1
    with zstandard.ZstdDecompressor(max_window_size=_WINDOW).stream_reader(chunk.data) as reader:
        while left > 0 and (piece := reader.read(min(left, _PIECE))):
            pieces.append(piece)
            left -= len(piece)
    return b"".join(pieces)


def _in_words(error: BaseException) -> str:
    if isinstance(error, RecordLengthLimitExceeded):
        return "an impossible length"
    return str(error) if isinstance(error, DamagedChunkError) else f"an unreadable part ({error})"


def check_readable(path: Path) -> None:
    """Raise RecordError with one sentence where a path is no ordinary file: a pipe would be waited for forever."""
    try:
        there = path.stat()
    except OSError as error:
        raise cannot_read(path, error) from error
    if S_ISDIR(there.st_mode):
        raise RecordError(f"{path}: is a folder, not a record")
    if not S_ISREG(there.st_mode):
        raise RecordError(f"{path}: is a pipe, a device or a socket, not a record")


def cannot_read(path: Path, error: OSError) -> RecordError:
    """Return the sentence for what the system says about a file."""
    return RecordError(f"{path}: cannot be read: {error.strerror or error}")
