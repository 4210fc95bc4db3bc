"""Tests of one command's replies."""

from companion.protocol import commands
from companion.protocol.check import Check, checks_of
from companion.protocol.telemetry import Answer, Reply
from companion.service.command_job import CommandJob


def test_progress_carries_the_checks_that_are_known_and_nothing_where_there_are_none() -> None:
    replies: list[Reply] = []
    command = commands.Preflight(verb="preflight", id="a", session="0" * 16, sent_s=0.0)
    job = CommandJob(command, replies.append)
    disk = Check("disk", True, "81 GB free")
    job.progress("waiting")
    job.progress("watching", [disk])
    assert [reply.answer for reply in replies] == [Answer.PROGRESS] * 2
    assert replies[0].data == {}
    assert checks_of(replies[1].data) == (disk,)
    assert job.text == "watching"
