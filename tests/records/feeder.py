"""A service that does nothing but record: `python -m tests.records.feeder FOLDER` at 100 Hz until it is killed.

Prints the writer's process, then the number of every tick.
"""

import sys
import time

from companion.config.records_config import RecordsConfig
from companion.records.record_process import RecordSink
from tests.records.flown import flight
from tests.records.writer_process import wait_until_it_reads


def main() -> None:
    sink = RecordSink(RecordsConfig(folder=sys.argv[1], live_port=0, min_free_mb=0.0), "one")
    wait_until_it_reads(sink)
    print(sink.pid, flush=True)
    due_s = time.monotonic()
    for number, tick in enumerate(flight(track_s=60.0)):
        sink(tick)
        print(number, flush=True)
        due_s += 0.01
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main()
