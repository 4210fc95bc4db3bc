"""Tests of the outbox: order, bound, and messages that break every connection."""

import asyncio

from companion.adapters.mqtt.outbox import Outbox, OutboxMessage


async def test_of_too_many_the_oldest_are_dropped() -> None:
    box = Outbox(3)
    for number in range(5):
        box.put(OutboxMessage(str(number), b""))
    assert [(await box.next()).topic for _ in range(3)] == ["2", "3", "4"]
    assert not len(box)


async def test_what_could_not_be_said_comes_first_again_three_times() -> None:
    box = Outbox(3)
    box.put(OutboxMessage("bad", b""))
    box.put(OutboxMessage("good", b""))
    for _ in range(3):
        letter = await box.next()
        assert letter.topic == "bad"
        box.not_published(letter)
    assert (await box.next()).topic == "good"


async def test_what_could_not_be_said_is_the_oldest_when_there_is_no_room() -> None:
    box = Outbox(2)
    box.put(OutboxMessage("old", b""))
    old = await box.next()
    box.put(OutboxMessage("new", b""))
    box.put(OutboxMessage("newer", b""))
    box.not_published(old)
    assert [(await box.next()).topic for _ in range(2)] == ["new", "newer"]


async def test_empty_is_when_all_is_said_or_given_up() -> None:
    box = Outbox(3)
    await asyncio.wait_for(box.empty(), 1.0)
    box.put(OutboxMessage("a", b""))
    waiting = asyncio.create_task(box.empty())
    for _ in range(3):
        letter = await box.next()
        assert not waiting.done()
        box.not_published(letter)
        await asyncio.sleep(0)
    await asyncio.wait_for(waiting, 1.0)
    box.put(OutboxMessage("b", b""))
    await box.next()
    box.published()
    await asyncio.wait_for(box.empty(), 1.0)
