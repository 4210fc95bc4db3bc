"""`companion serve`: the service that flies the vehicle and takes commands over MQTT."""

import logging
import sys
from pathlib import Path
from typing import Annotated

import typer
import uvloop

from companion import __version__
from companion.adapters.realtime import lock_memory
from companion.adapters.record_process import RecordSink
from companion.adapters.systemd import Notifier, logging_to
from companion.cli.options import AllowUnstable, ControllerName, settings_of
from companion.config import CompanionConfig
from companion.config_controller import LoadedController, controller_path, load_controller
from companion.serving import Serving, serve


def serve_command(
    config: Annotated[Path | None, typer.Option(help="Companion configuration; config/lab.toml if not given.")] = None,
    controller: ControllerName = None,
    allow_unstable: AllowUnstable = False,
    record: Annotated[bool, typer.Option(help="Write a record of every flight.")] = True,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log everything the parts say.")] = False,
) -> None:
    """Fly the vehicle: take commands over MQTT, tell what happens, record every flight; until Ctrl-C, which lands.

    Waits for motion capture and autopilot while they are not there. Exit code 0 after SIGTERM or Ctrl-C, 2 for a
    configuration or broker that cannot be used.
    """
    settings = settings_of(config, "lab.toml")
    name = controller or settings.control.controller
    law = load_controller(name, settings.vehicle_model(), 1.0 / settings.control.rate_hz, allow_unstable)
    notifier = Notifier.from_environment()
    with logging_to(sys.stderr, logging.DEBUG if verbose else logging.INFO):
        lock_memory()
        recorder = _recorder(settings, law, seed=None) if record else None
        try:
            folder = Path(settings.records.folder) if recorder is not None else None
            uvloop.run(serve(Serving(settings, law, notifier, recorder, folder)))
        finally:
            if recorder is not None:
                recorder.close()


def _recorder(settings: CompanionConfig, law: LoadedController, seed: int | None) -> RecordSink:
    vehicle = settings.operator.vehicle if settings.operator else "vehicle"
    recorder = RecordSink(settings.records, vehicle)
    recorder.begin(
        {
            "config": settings.model_dump(mode="json"),
            "controller": {"name": law.name, "file": controller_path(law.name).read_text(encoding="utf-8")},
            "versions": {"companion": __version__},
            "seed": seed,
        }
    )
    return recorder
