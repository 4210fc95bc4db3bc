"""The writer as a test sees it from outside."""

import time

from companion.records.record_process import RecordSink


def wait_until_it_reads(sink: RecordSink) -> None:
    """Wait until the writer accepts messages, so that nothing is dropped."""
    end_s = time.monotonic() + 30.0
    while not sink.ready:
        assert time.monotonic() < end_s, "the writer did not start"
        time.sleep(0.01)
