"""Topics, and which of them may be answered to."""

import pytest

from companion.protocol.topics import Topics

TOPICS = Topics("lab-2", "dauam_1")


def test_topics_hold_prefix_version_and_vehicle() -> None:
    assert TOPICS.command == "lab-2/v1/dauam_1/command"
    assert TOPICS.reply("me") == "lab-2/v1/dauam_1/reply/me"
    assert TOPICS.is_reply(TOPICS.reply("a-B_7"))


@pytest.mark.parametrize(
    "topic",
    [
        "", "me", "lab-2/v1/dauam_1/reply/", "lab-2/v1/dauam_1/reply/a/b", "lab-2/v1/dauam_1/reply/+",
        "lab-2/v1/dauam_1/reply/#", "lab-2/v1/dauam_2/reply/me", "lab-2/v2/dauam_1/reply/me", "lab-2/v1/dauam_1/status",
        "lab-2/v1/dauam_1/command", "lab-2/v1/dauam_1/reply/" + "x" * 65, "lab-2/v1/dauam_1/reply/n\u00e4h",
        "$SYS/lab-2/v1/dauam_1/reply/me",
        "lab-2/v1/dauam_1/reply/-", "lab-2/v1/dauam_1/reply/a\x00",
    ],
)  # fmt: skip
def test_nothing_else_is_answered_to(topic: str) -> None:
    assert not TOPICS.is_reply(topic)
