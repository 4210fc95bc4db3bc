"""Real packets made bad, the same way for every protocol: cut short, changed, glued together, repeated, or replaced."""

import asyncio
import gc
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

from hypothesis import strategies as st

_EXTREMES = (0, 1, 2, 3, 4, 7, 8, 0x7F, 0x80, 0xFE, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF)


@st.composite
def one_bad(draw: st.DrawFn, packets: Sequence[bytes]) -> bytes:
    """Generate one packet, whole, cut or changed."""
    said = bytearray(draw(st.sampled_from(packets)))
    at = draw(st.integers(0, len(said) - 1))
    match draw(st.sampled_from(["as it is", "cut", "bits", "number", "splice", "garbage"])):
        case "cut":
            del said[at:]
        case "bits":
            for _ in range(draw(st.integers(1, 4))):
                said[draw(st.integers(0, len(said) - 1))] ^= 1 << draw(st.integers(0, 7))
        case "number":
            width = draw(st.sampled_from([1, 2, 4]))
            number = draw(st.sampled_from(_EXTREMES)) & (256**width - 1)
            said[at : at + width] = number.to_bytes(width, draw(st.sampled_from(["little", "big"])))
        case "splice":
            other = draw(st.sampled_from(packets))
            said[at:] = other[draw(st.integers(0, len(other) - 1)) :]
        case "garbage":
            said = bytearray(draw(st.binary(min_size=1, max_size=80)))
    return bytes(said)


def bad_stream(packets: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Generate a few such packets in a row."""
    return st.lists(one_bad(packets), min_size=1, max_size=8).map(b"".join)


@asynccontextmanager
async def nothing_escapes() -> AsyncIterator[None]:
    """Fail on any exception in a callback or an unobserved task: it would have passed the adapter into the loop."""
    loop, escaped = asyncio.get_running_loop(), list[dict[str, Any]]()
    before = loop.get_exception_handler()
    loop.set_exception_handler(lambda _, context: escaped.append(context))
    gc.freeze()  # what was there before need not be walked each time
    try:
        yield
        gc.collect()  # asyncio tells of what nobody looked at when it is thrown away
        await asyncio.sleep(0)
    finally:
        gc.unfreeze()
        loop.set_exception_handler(before)
    assert not escaped, escaped
