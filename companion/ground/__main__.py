"""Law on the ground as a child process: settings as JSON on standard input, which ends it when it is closed."""

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import uvloop

from companion.adapters.system.systemd import logging_to
from companion.config.companion_config import CompanionConfig
from companion.flight.assembly import controller_of
from companion.ground.ground_record import GroundRecorder, ground_recorder
from companion.ground.ground_service import serve_law


def main() -> None:
    """Read one line of settings, run the law, end with standard input; raises what `serve_law` raises."""
    asked = json.loads(sys.stdin.readline())
    config = CompanionConfig.model_validate_json(json.dumps(asked["config"]))
    with logging_to(sys.stderr, asked["level"]), ground_recorder(config, asked["record"]) as recorder:
        uvloop.run(_run(config, asked, recorder))
    if recorder is not None and recorder.file and not recorder.flew:
        Path(recorder.file).unlink(missing_ok=True)


async def _run(config: CompanionConfig, asked: dict[str, Any], recorder: GroundRecorder | None) -> None:
    stop = asyncio.Event()
    law = controller_of(config, asked["controller"], asked["allow_unstable"])
    asyncio.get_running_loop().add_reader(sys.stdin.fileno(), stop.set)  # nothing but its end comes there
    await serve_law(config, law, stop, recorder=recorder)


if __name__ == "__main__":
    main()
