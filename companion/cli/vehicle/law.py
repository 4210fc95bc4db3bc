"""`companion law`: the control law on the ground, for a vehicle whose [law] table says so."""

import asyncio
import logging
import signal
import sys
from typing import Annotated

import typer
import uvloop

from companion.adapters.system.instance_lock import law_lock
from companion.adapters.system.native_output import standard_output_to_log
from companion.adapters.system.realtime import lock_memory
from companion.adapters.system.systemd import Notifier, logging_to
from companion.cli.options import AllowUnstable, ControllerName, VehicleConfigFile, vehicle_settings
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.config.locations import vehicle_config_path
from companion.core.interfaces import ConfigError
from companion.flight.assembly import controller_of, margin_in, with_link
from companion.ground.ground_record import GroundRecorder, ground_recorder
from companion.ground.ground_service import serve_law

LOG = logging.getLogger("companion.law")


def law_command(
    config: VehicleConfigFile = None,
    controller: ControllerName = None,
    allow_unstable: AllowUnstable = False,
    record: Annotated[bool, typer.Option(help="Write a record of the ground's side of every flight.")] = True,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log all messages.")] = False,
) -> None:
    """Run the control law on this computer: motion capture in, commands to the vehicle out; until Ctrl-C.

    The vehicle's service needs runs_on = "ground" in its [law] table, and the same key. If this ends in flight, PX4
    lands. Exit codes: 0 after SIGTERM or Ctrl-C, 2 for a configuration that cannot be used, or when the vehicle refuses
    this law.
    """
    settings = vehicle_settings(config, logs=True)
    if not settings.law.on_ground:
        raise ConfigError(
            f'{config or vehicle_config_path()}: law.runs_on = "onboard": the vehicle\'s service runs the law; give '
            'runs_on = "ground" there and here (docs/split.md)'
        )
    link = settings.law.link
    link.secret()
    loaded = controller_of(settings, controller or settings.control.controller, allow_unstable)
    margin = margin_in(with_link(settings, link.delay_s), loaded)
    notifier = Notifier.from_environment()  # before there are children, which must not speak to systemd
    with (
        logging_to(sys.stderr, logging.DEBUG if verbose else logging.INFO),
        standard_output_to_log(),
        law_lock(link.host, link.port),
    ):
        LOG.info("configuration %s", config or vehicle_config_path())
        LOG.info("control law %s: %s", loaded.name, margin.says)
        lock_memory()
        vehicle = settings.operator.vehicle if settings.operator else "vehicle"
        with ground_recorder(settings, vehicle if record else "") as recorder:
            uvloop.run(_run(settings, loaded, recorder, notifier))


async def _run(
    settings: CompanionConfig, loaded: LoadedController, recorder: GroundRecorder | None, notifier: Notifier
) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    notifier.ready("the law waits for motion capture and the vehicle")
    await serve_law(settings, loaded, stop, notifier, recorder)
    notifier.stopping("ends")
