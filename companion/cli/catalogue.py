"""Every command of `companion`: where it is, its line in the list, and examples for its --help.

Nothing is imported here: --help, --version and completion read this table alone.
"""

from companion.cli.lazy import Command, Group

_NUMBERS_MAY_BE_NEGATIVE = {"ignore_unknown_options": True}
"""-1.5 is a coordinate, not an option."""

_OPERATE: dict[str, Command | Group] = {
    "status": Command(
        place="companion.cli.operator.status:status",
        summary="Show phase, position, error, battery, arms and faults, live.",
        examples=("status", "status --once --json"),
    ),
    "watch": Command(
        place="companion.cli.operator.status:watch",
        summary="Print phases, faults, commands and replies as they happen.",
        examples=("watch", "watch --broker mqtt://192.168.1.20"),
    ),
    "arm": Command(
        place="companion.cli.operator.commands:arm",
        summary="Check everything, fold the arms, idle the motors.",
        examples=("arm", "arm --timeout 60"),
    ),
    "takeoff": Command(
        place="companion.cli.operator.commands:takeoff",
        summary="Climb and hold.",
        examples=("takeoff", "takeoff --height 0.5"),
    ),
    "hold": Command(
        place="companion.cli.operator.commands:hold",
        summary="Brake and hover; end the trajectory.",
        examples=("hold",),
    ),
    "goto": Command(
        place="companion.cli.operator.commands:goto",
        summary="Fly to a position, then hold.",
        examples=("goto 0.3 0 0.8", "goto 0 -1 1.2 --yaw 1.57"),
        settings=_NUMBERS_MAY_BE_NEGATIVE,
    ),
    "track": Command(
        place="companion.cli.operator.commands:track",
        summary="Fly a trajectory, then hold at its end.",
        examples=("track ellipse --laps 1 --size 0.3 --period 20", "track waypoints.csv --arms swing"),
    ),
    "controller": Command(
        place="companion.cli.operator.commands:controller",
        summary="Fly with another control law from now on.",
        examples=("controller pid",),
    ),
    "land": Command(
        place="companion.cli.operator.commands:land",
        summary="Fold the arms, land where it is, disarm.",
        examples=("land",),
    ),
    "abort": Command(
        place="companion.cli.operator.commands:abort",
        summary="Land now, or stop the motors on the ground.",
        examples=("abort",),
    ),
    "resume": Command(
        place="companion.cli.operator.commands:resume",
        summary="Take the vehicle back from PX4 or its pilot, and hover.",
        examples=("resume",),
    ),
    "kill": Command(
        place="companion.cli.operator.commands:kill",
        summary="Stop the motors at once: in the air the vehicle FALLS.",
        examples=("kill", "kill --yes"),
    ),
    "disarm": Command(
        place="companion.cli.operator.commands:disarm",
        summary="Stop the motors, on the ground only.",
        examples=("disarm",),
    ),
    "params": Command(
        place="companion.cli.operator.commands:params",
        summary="Print configuration, gains and PX4 parameters in force.",
        examples=("params", "params --json"),
    ),
}

_SERVICE: dict[str, Command | Group] = {
    "serve": Command(
        place="companion.cli.vehicle.serve:serve_command",
        summary="Fly the vehicle: the service that takes the commands above.",
        examples=("serve --config config/demo.toml", "serve --config lab.toml --controller pid"),
    ),
    "mocap-bridge": Command(
        place="companion.cli.vehicle.mocap_bridge:mocap_bridge",
        summary="Forward motion capture from QTM to the broker.",
        examples=("mocap-bridge --config lab.toml",),
    ),
}

_ARMS_ON_THE_BENCH: dict[str, Command | Group] = {
    "ping": Command(
        place="companion.cli.arms.commands:ping",
        summary="List every servo, or what is missing or wrong.",
        examples=("arms ping --config lab.toml", "arms ping --port /dev/ttyUSB1"),
    ),
    "read": Command(
        place="companion.cli.arms.commands:read",
        summary="Show the state of every servo, live.",
        examples=("arms read --config lab.toml", "arms read --once --json"),
    ),
    "home": Command(
        place="companion.cli.arms.commands:home",
        summary="Move both arms to the pose they work from, claws closed.",
        examples=("arms home --config lab.toml", "arms home --dry-run --plot home.png"),
    ),
    "stow": Command(
        place="companion.cli.arms.commands:stow",
        summary="Fold both arms as for take-off and landing.",
        examples=("arms stow --config lab.toml", "arms stow --dry-run --from home"),
    ),
    "play": Command(
        place="companion.cli.arms.commands:play",
        summary="Play a motion; the arms move to its start first.",
        examples=("arms play swing --config lab.toml", "arms play reach --dry-run --plot reach.png"),
    ),
    "grip": Command(
        place="companion.cli.arms.commands:grip",
        summary="Open or close both claws.",
        examples=("arms grip open --config lab.toml",),
    ),
    "torque": Command(
        place="companion.cli.arms.commands:torque",
        summary="Hold every joint, or let all go limp: the arms FALL.",
        examples=("arms torque off --config lab.toml",),
    ),
    "clear": Command(
        place="companion.cli.arms.commands:clear",
        summary="Clear latched faults, and say what is still wrong.",
        examples=("arms clear --config lab.toml",),
    ),
}

_ARMS_LIVE: dict[str, Command | Group] = {
    "ready": Command(
        place="companion.cli.arms.live:ready",
        summary="Switch torque on and fold the arms; on the ground only.",
        examples=("arms live ready",),
    ),
    "stow": Command(place="companion.cli.arms.live:stow", summary="Fold both arms.", examples=("arms live stow",)),
    "play": Command(
        place="companion.cli.arms.live:play",
        summary="Play a motion, in flight also during hold.",
        examples=("arms live play swing",),
    ),
    "hold": Command(
        place="companion.cli.arms.live:hold",
        summary="Stop the arms and hold them there, torque on.",
        examples=("arms live hold",),
    ),
    "limp": Command(
        place="companion.cli.arms.live:limp",
        summary="Switch torque off, on the ground only: the arms FALL.",
        examples=("arms live limp",),
    ),
    "clear": Command(
        place="companion.cli.arms.live:clear",
        summary="Clear the servos' faults.",
        examples=("arms live clear",),
    ),
}

_ARMS = Group(
    summary="Look at the arms' servos and move them.",
    about="""Look at the arms' servos and move them, on the bench; or, with `live`, through the running service.

    On the bench: for a vehicle on the ground, disarmed, its propellers off, while no service has the servos' bus:
    these commands do not see the autopilot or the flight. Exit codes: 0 done, 1 failed on the way, 2 could not be
    started, 130 interrupted.
    """,
    panels={
        "On the bench": _ARMS_ON_THE_BENCH,
        "Through the running service": {
            "live": Group(
                summary="Move the arms of the running service, in flight too.",
                about="Move the arms while the service runs and has their bus: commands over MQTT, in flight too.",
                panels={"Commands": _ARMS_LIVE},
                examples=("arms live play swing",),
            )
        },
    },
    examples=("arms ping --config lab.toml", "arms live play swing"),
)

_ROOM: dict[str, Command | Group] = {
    "mocap": Command(
        place="companion.cli.vehicle.mocap:mocap",
        summary="Show motion capture alone: position, heading, rate, age.",
        examples=("mocap --config lab.toml", "mocap --config lab.toml --seconds 10 --json"),
    ),
    "preflight": Command(
        place="companion.cli.operator.preflight:preflight",
        summary="Check everything that must be right before arming.",
        examples=("preflight", "preflight --config lab.toml --trajectory ellipse", "preflight --by-hand"),
    ),
    "dry-run": Command(
        place="companion.cli.vehicle.dry_run:dry_run",
        summary="Run everything live, disarmed, and send nothing.",
        examples=("dry-run --config lab.toml", "dry-run --config lab.toml --trajectory ellipse --seconds 40"),
    ),
    "arms": _ARMS,
}

_AFTER: dict[str, Command | Group] = {
    "records": Command(
        place="companion.cli.records.records:records",
        summary="List flights; write one as CSV.",
        examples=("records", "records flights/FLIGHT.mcap --csv tables"),
    ),
    "replay": Command(
        place="companion.cli.records.replay:replay_command",
        summary="Feed a flight through the control law again, and compare.",
        examples=("replay flights/FLIGHT.mcap", "replay flights/FLIGHT.mcap --controller pid --plot pid.png"),
    ),
    "report": Command(
        place="companion.cli.records.report:report",
        summary="Make a page of flights: errors, figures, faults.",
        examples=("report flights/FLIGHT.mcap", "report flights/A.mcap flights/B.mcap --figures paper"),
    ),
    "calibrate": Command(
        place="companion.cli.records.calibrate:calibrate_command",
        summary="Find hover thrust, attitude loop and delays in a hover.",
        examples=("calibrate flights/FLIGHT.mcap",),
    ),
}

_WITHOUT: dict[str, Command | Group] = {
    "demo": Command(
        place="companion.cli.demo.command:demo",
        summary="Fly against the mocks, over the real protocols.",
        examples=("demo", "demo --trajectory figure8 --compare pid", "demo --fault 'mocap stuck at 12 s'"),
    ),
    "simulate": Command(
        place="companion.cli.studies.simulate:simulate",
        summary="Fly one experiment in virtual time.",
        examples=("simulate figure8 --seeds 1:5", "simulate --demo --controller pid --out flights"),
    ),
    "experiments": Command(
        place="companion.cli.studies.experiments:experiments",
        summary="Fly the paper's experiments beside the paper's numbers.",
        examples=("experiments", "experiments --controllers practical,mine.toml --seeds 1:20"),
    ),
    "sweep": Command(
        place="companion.cli.studies.sweep:sweep",
        summary="Fly many vehicles that differ from the configuration.",
        examples=("sweep --vehicles 100", "sweep --controller mine.toml"),
    ),
    "tune": Command(
        place="companion.cli.studies.tune:tune",
        summary="Search gains of the ET-NN law.",
        examples=("tune --write mine.toml", "tune --generations 5 --population 8 --out flights/try"),
    ),
}

ROOT = Group(
    summary="",
    about="Flight software of a dual-arm aerial manipulator.",
    panels={
        "Operate (over MQTT, from any machine)": _OPERATE,
        "The service": _SERVICE,
        "The vehicle and its room": _ROOM,
        "After a flight": _AFTER,
        "Without a vehicle": _WITHOUT,
    },
)
"""All commands, in the order of `companion --help`."""
COMMANDS = {name: entry for panel in ROOT.panels.values() for name, entry in panel.items()}
