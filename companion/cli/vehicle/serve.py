"""`companion serve`: the service that flies the vehicle and takes commands over MQTT."""

import logging
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer
import uvloop

from companion import __version__
from companion.adapters.system.instance_lock import service_lock
from companion.adapters.system.last_resort import LastResort
from companion.adapters.system.native_output import standard_output_to_log, unraisable_to_log
from companion.adapters.system.realtime import lock_memory
from companion.adapters.system.systemd import Notifier, logging_to
from companion.cli.options import AllowUnstable, ControllerName, VehicleConfigFile, vehicle_settings
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import ON_GROUND, ErrorLimits, LoadedController, controller_text
from companion.config.locations import vehicle_config_path
from companion.config.operator_config import OperatorConfig
from companion.control.remote_law import RemoteLaw
from companion.core.errors import ConfigError
from companion.flight.assembly import controller_of, margin_in
from companion.records.record_process import RecordSink
from companion.service.daemon import DaemonSettings, serve
from companion.service.page_process import PageOptions, log_page, page_process
from companion.supervisor.without_frames import off_sentence

LOG = logging.getLogger("companion.serve")


def serve_command(
    config: VehicleConfigFile = None,
    controller: ControllerName = None,
    allow_unstable: AllowUnstable = False,
    record: Annotated[bool, typer.Option(help="Write a record of every flight.")] = True,
    page: Annotated[
        bool,
        typer.Option("--page", help="Serve the live page, too: [page] says where, else http://127.0.0.1:8080/."),
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log all messages.")] = False,
) -> None:
    """Fly the vehicle: take commands over MQTT, publish telemetry, record every flight; until Ctrl-C, which lands.

    Waits for motion capture and autopilot. Exit codes: 0 after SIGTERM or Ctrl-C, 2 for a configuration or broker that
    cannot be used.
    """
    settings = vehicle_settings(config, logs=True)
    law, of_law = _law(settings, controller, allow_unstable)
    notifier = Notifier.from_environment()
    place = settings.operator or OperatorConfig(embedded=True)
    vehicle = "" if place.embedded else f"{place.prefix}/{place.vehicle}"
    with (
        logging_to(sys.stderr, logging.DEBUG if verbose else logging.INFO),
        service_lock(place.host, place.port, vehicle),  # before anything is bound or begun
    ):
        LOG.info("configuration %s", config or vehicle_config_path())
        LOG.info("control law %s: %s", law.name, of_law)
        if not settings.law.onboard_mocap:
            LOG.warning("%s: `companion preflight` names the faults", off_sentence())
        lock_memory()
        recorder = _recorder(settings) if record else None
        last_resort = LastResort()
        folder = Path(settings.records.folder) if recorder is not None else None
        what = DaemonSettings(
            config=settings,
            controller=law,
            notifier=notifier,
            recorder=recorder,
            records=folder,
            note_law=_note_law(recorder, "" if settings.law.on_ground else law.name),
            last_resort=last_resort,
        )
        try:
            with (
                standard_output_to_log(),
                unraisable_to_log(last_resort.lacks_memory),
                page_process(PageOptions(place, settings.page), log_page) if page else nullcontext(),
            ):
                uvloop.run(serve(what))
        finally:
            if recorder is not None:
                recorder.close()
            last_resort.close()


def _note_law(recorder: RecordSink | None, first: str) -> Callable[[str], None]:
    """Return a function that adds a law's file to the record, as a replay needs it."""
    texts: dict[str, str] = {}

    def note(name: str) -> None:
        texts[name] = controller_text(name)
        if recorder is not None:
            recorder.begin({"laws": texts})

    if first:
        note(first)
    return note


def _law(settings: CompanionConfig, name: str | None, allow_unstable: bool) -> tuple[LoadedController, str]:
    """Return the law, and a sentence about it; for a law on the ground a stand-in that holds its commands."""
    if settings.law.on_ground:
        if name is not None or allow_unstable:
            given = "--controller" if name is not None else "--allow-unstable"
            raise ConfigError(f'{given}: law.runs_on = "ground": give it to `companion law`, which runs the law')
        link = settings.law.link
        link.secret()
        waits = f"on the ground: `companion law` there; waits for it on {link.listen}, UDP port {link.port}"
        return LoadedController(ON_GROUND, RemoteLaw(), ErrorLimits()), waits
    law = controller_of(settings, name or settings.control.controller, allow_unstable)
    return law, margin_in(settings, law).says


def _recorder(settings: CompanionConfig) -> RecordSink:
    vehicle = settings.operator.vehicle if settings.operator else "vehicle"
    recorder = RecordSink(settings.records, vehicle)
    recorder.begin(
        {
            "config": settings.model_dump(mode="json"),
            "versions": {"companion": __version__},
            "off": "" if settings.law.onboard_mocap else off_sentence(),
        }
    )
    return recorder
