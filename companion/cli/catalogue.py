"""Every command of `companion`: where it is, its line in the list, and examples for its --help.

Nothing is imported here: --help, --version and completion read this table alone.
"""

from companion.cli.lazy import Command, Group

_NUMBERS_MAY_BE_NEGATIVE = {"ignore_unknown_options": True}
"""-1.5 is a coordinate, not an option."""

_OPERATE: dict[str, Command | Group] = {
    "status": Command(
        "operator.status:status",
        "Show phase, position, error, battery, arms and faults, live.",
        ("status", "status --once --json"),
    ),
    "watch": Command(
        "operator.status:watch",
        "Print phases, faults, commands and replies as they happen.",
        ("watch", "watch --broker mqtt://192.168.1.20"),
    ),
    "arm": Command(
        "operator.commands:arm", "Check everything, fold the arms, idle the motors.", ("arm", "arm --timeout 60")
    ),
    "takeoff": Command("operator.commands:takeoff", "Climb and hold.", ("takeoff", "takeoff --height 0.5")),
    "hold": Command("operator.commands:hold", "Brake and hover; end the trajectory.", ("hold",)),
    "goto": Command(
        "operator.commands:goto",
        "Fly to a position, then hold.",
        ("goto 0.3 0 0.8", "goto 0 -1 1.2 --yaw 1.57"),
        settings=_NUMBERS_MAY_BE_NEGATIVE,
    ),
    "track": Command(
        "operator.commands:track",
        "Fly a trajectory, then hold at its end.",
        ("track ellipse --laps 1 --size 0.3 --period 20", "track waypoints.csv --arms swing"),
    ),
    "controller": Command(
        "operator.commands:controller", "Fly with another control law from now on.", ("controller pid",)
    ),
    "land": Command("operator.commands:land", "Fold the arms, land where it is, disarm.", ("land",)),
    "abort": Command("operator.commands:abort", "Land now, or stop the motors on the ground.", ("abort",)),
    "resume": Command(
        "operator.commands:resume", "Take the vehicle back from PX4 or its pilot, and hover.", ("resume",)
    ),
    "kill": Command(
        "operator.commands:kill", "Stop the motors at once: in the air the vehicle FALLS.", ("kill", "kill --yes")
    ),
    "disarm": Command("operator.commands:disarm", "Stop the motors, on the ground only.", ("disarm",)),
    "params": Command(
        "operator.commands:params",
        "Print configuration, gains and PX4 parameters in force.",
        ("params", "params --json"),
    ),
}

_SERVICE: dict[str, Command | Group] = {
    "serve": Command(
        "vehicle.serve:serve_command",
        "Fly the vehicle: the service that takes the commands above.",
        ("serve --config config/demo.toml", "serve --config lab.toml --controller pid"),
    ),
    "page": Command(
        "operator.page:page",
        "Serve a live page of all vehicles, for a browser.",
        ("page", "page --host 0.0.0.0 --page-password page.hash"),
    ),
    "page-password": Command(
        "operator.page:page_password",
        "Set the password without which the page only looks.",
        ("page-password page.hash",),
    ),
    "law": Command(
        "vehicle.law:law_command",
        "Run the control law on the ground, for a split deployment.",
        ("law --config ground.toml", "law --config ground.toml --controller pid"),
    ),
    "law-key": Command(
        "vehicle.law_key:law_key",
        "Make the key that a law on the ground and its vehicle share.",
        ("law-key law.key",),
    ),
    "mocap-bridge": Command(
        "vehicle.mocap_bridge:mocap_bridge",
        "Forward motion capture from QTM to the broker.",
        ("mocap-bridge --config lab.toml",),
    ),
}

_ARMS_ON_THE_BENCH: dict[str, Command | Group] = {
    "ping": Command(
        "arms.commands:ping",
        "List every servo, or what is missing or wrong.",
        ("arms ping --config lab.toml", "arms ping --port /dev/ttyUSB1"),
    ),
    "read": Command(
        "arms.commands:read",
        "Show the state of every servo, live.",
        ("arms read --config lab.toml", "arms read --once --json"),
    ),
    "home": Command(
        "arms.commands:home",
        "Move both arms to the pose they work from, claws closed.",
        ("arms home --config lab.toml", "arms home --dry-run --plot home.png"),
    ),
    "stow": Command(
        "arms.commands:stow",
        "Fold both arms as for take-off and landing.",
        ("arms stow --config lab.toml", "arms stow --dry-run --from home"),
    ),
    "play": Command(
        "arms.commands:play",
        "Play a motion; the arms move to its start first.",
        ("arms play swing --config lab.toml", "arms play reach --dry-run --plot reach.png"),
    ),
    "grip": Command("arms.commands:grip", "Open or close both claws.", ("arms grip open --config lab.toml",)),
    "torque": Command(
        "arms.commands:torque",
        "Hold every joint, or let all go limp: the arms FALL.",
        ("arms torque off --config lab.toml",),
    ),
    "clear": Command(
        "arms.commands:clear", "Clear latched faults, and say what is still wrong.", ("arms clear --config lab.toml",)
    ),
}

_ARMS_LIVE: dict[str, Command | Group] = {
    "ready": Command(
        "arms.live:ready", "Switch torque on and fold the arms; on the ground only.", ("arms live ready",)
    ),
    "stow": Command("arms.live:stow", "Fold both arms.", ("arms live stow",)),
    "play": Command("arms.live:play", "Play a motion, in flight also during hold.", ("arms live play swing",)),
    "hold": Command("arms.live:hold", "Stop the arms and hold them there, torque on.", ("arms live hold",)),
    "limp": Command("arms.live:limp", "Switch torque off, on the ground only: the arms FALL.", ("arms live limp",)),
    "clear": Command("arms.live:clear", "Clear the servos' faults.", ("arms live clear",)),
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
        "vehicle.mocap:mocap",
        "Show motion capture alone: position, heading, rate, age.",
        ("mocap --config lab.toml", "mocap --config lab.toml --seconds 10 --json"),
    ),
    "preflight": Command(
        "operator.preflight:preflight",
        "Check everything that must be right before arming.",
        ("preflight", "preflight --config lab.toml --trajectory ellipse", "preflight --by-hand"),
    ),
    "dry-run": Command(
        "vehicle.dry_run:dry_run",
        "Run everything live, disarmed, and send nothing.",
        ("dry-run --config lab.toml", "dry-run --config lab.toml --trajectory ellipse --seconds 40"),
    ),
    "arms": _ARMS,
}

_AFTER: dict[str, Command | Group] = {
    "records": Command(
        "records.records:records",
        "List flights; write one as CSV.",
        ("records", "records flights/FLIGHT.mcap --csv tables"),
    ),
    "records merge": Command(
        "records.merge:merge_command",
        "Join the records of a vehicle and its ground law.",
        ("records merge flights/FLIGHT.mcap flights/FLIGHT-ground-SESSION.mcap",),
    ),
    "replay": Command(
        "records.replay:replay_command",
        "Feed a flight through the control law again, and compare.",
        ("replay flights/FLIGHT.mcap", "replay flights/FLIGHT.mcap --controller pid --plot pid.png"),
    ),
    "report": Command(
        "records.report:report",
        "Make a page of flights: errors, figures, faults.",
        ("report flights/FLIGHT.mcap", "report flights/A.mcap flights/B.mcap --figures paper"),
    ),
    "calibrate": Command(
        "records.calibrate:calibrate_command",
        "Find hover thrust, attitude loop and delays in a hover.",
        ("calibrate flights/FLIGHT.mcap",),
    ),
}

_WITHOUT: dict[str, Command | Group] = {
    "demo": Command(
        "demo.command:demo",
        "Fly against the mocks, over the real protocols.",
        ("demo", "demo --trajectory figure8 --compare pid", "demo --fault 'mocap stuck at 12 s'"),
    ),
    "simulate": Command(
        "studies.simulate:simulate",
        "Fly one experiment in virtual time.",
        ("simulate figure8 --seeds 1:5", "simulate --demo --controller pid --out flights"),
    ),
    "experiments": Command(
        "studies.experiments:experiments",
        "Fly the paper's experiments beside the paper's numbers.",
        ("experiments", "experiments --controllers practical,mine.toml --seeds 1:20"),
    ),
    "sweep": Command(
        "studies.sweep:sweep",
        "Fly many vehicles that differ from the configuration.",
        ("sweep --vehicles 100", "sweep --controller mine.toml"),
    ),
    "tune": Command(
        "studies.tune:tune",
        "Search gains of the ET-NN law.",
        ("tune --write mine.toml", "tune --generations 5 --population 8 --out flights/try"),
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
