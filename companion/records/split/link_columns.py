"""Columns of the link to a law on the ground: names, and their values in the same order."""

import math
from typing import Any

from companion.core.types import Array
from companion.flight.remote_step import LinkTick

NUMBERS = (
    "link_session", "link_epoch", "link_connected", "link_blind", "link_failed",
    "link_law", "link_command", "link_yaw_rad", "link_command_age_s",
    "link_silence_s", "link_age_s", "link_received", "link_missing", "link_late", "link_foreign",
    "link_messages", "link_events", "link_again", "link_beats", "link_lost", "link_bytes", "link_messages_received",
    "link_bytes_received", "link_messages_down", "link_bytes_down",
    "link_clock_offset_s", "link_message_sent_ground_s", "link_message_sent_s", "link_message_arrived_s",
    "link_command_sent_ground_s", "link_command_sent_s", "link_command_arrived_s", "link_capture_ago_s",
)  # fmt: skip
"""Session and command in use, then state and counts of the last second, counts of the session, and times."""
ACCEL = "link_accel_w_mps2"
"""Acceleration of the command in use, (3,)."""
LINK = {"/link": (" ".join(NUMBERS), ACCEL)}


def link_numbers(link: LinkTick) -> tuple[Any, ...]:
    """Return the values of NUMBERS."""
    command, status, counts, times = link.command, link.status, link.counts, link.times
    message, brought = times.message, times.command
    yaw_rad = math.nan if command.yaw_rad is None else command.yaw_rad
    return (
        times.session, link.epoch, status.connected, status.blind, status.failed,
        times.law, command.number, yaw_rad, command.age_s,
        status.silence_s, status.age_s, status.received, status.missing, status.late, status.foreign,
        counts.messages, counts.events, counts.again, counts.beats, counts.lost, counts.sent_bytes, counts.received,
        counts.received_bytes, link.messages_down, link.bytes_down,
        times.clock_offset_s, message.sent_ground_s, message.sent_s, message.arrived_s,
        brought.sent_ground_s, brought.sent_s, brought.arrived_s, times.capture_ago_s,
    )  # fmt: skip


def link_accel(link: LinkTick) -> Array:
    """Return the value of ACCEL."""
    return link.command.accel_w_mps2
