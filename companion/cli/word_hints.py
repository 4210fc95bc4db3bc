"""Hints for words that people type and that are no commands."""

_STOP = """To stop now:
  companion hold     brake and hover where it is
  companion land     fold the arms, land where it is, disarm
  companion abort    land now; on the ground, stop the motors
  companion kill     stop the motors at once: in the air the vehicle FALLS
The service lands before it ends: Ctrl-C, or systemctl stop dauam-companion."""
_START = """To begin:
  companion demo     a whole flight against the mocks, without a vehicle
  companion serve    the service that flies the vehicle
  companion arm      the first command of a flight, while the service runs"""
_FLY = """To fly, while the service runs:
  companion arm                  check everything, motors at idle
  companion takeoff --height 1   climb and hold
  companion goto X Y Z           fly to a position
  companion track ellipse        fly a trajectory
  companion land                 land and disarm"""
_RETURN = """There is no way home: the room has no launch point. Instead:
  companion goto X Y Z    fly to a position
  companion land          land where it is, disarm"""
_LOOK = """To look:
  companion status       the vehicle, live
  companion watch        what happens, as it happens
  companion preflight    what must be right before arming
  companion mocap        motion capture alone
  companion dry-run      everything live, and nothing sent"""
_RECORDS = """Flights are recorded automatically:
  companion records               list them
  companion report FLIGHT.mcap    errors, figures and faults of one
  journalctl -u dauam-companion   the log of the installed service"""
_CONFIGURE = """Settings are in a TOML file (config/lab.toml, docs/own-room.md):
  companion preflight --config lab.toml    what is wrong in it and in the room
  companion params                         settings of the running service"""
_LAW = """Control laws:
  companion controller pid         change the law of the running service
  companion demo --controller pid  fly the mocks with it"""
_ARMS = """The arms:
  companion arms ping         every servo, on the bench
  companion arms live play    a motion through the running service"""

_HINTS = {
    _STOP: "stop emergency emergency-stop estop e-stop halt panic quit exit off shutdown terminate cancel pause brake",
    _START: "start run launch begin up on",
    _FLY: "fly go move flight up-and-away take-off liftoff",
    _RETURN: "rtl rth return return-home home back",
    _LOOK: "info state show monitor look check checks health diagnose doctor connect test qtm telemetry",
    _RECORDS: "log logs record list ls flights plot analyze analyse export csv journal",
    _CONFIGURE: "config configure configuration settings setup init set get param install",
    _LAW: "law laws pid etnn gains",
    _ARMS: "servos servo arm-motion gripper grip claw claws",
    "`companion resume` takes the vehicle back from PX4 or its pilot and hovers.": "continue unpause offboard",
    "The trajectory is an argument: `companion track ellipse`, figure8, or a CSV file.": (
        "ellipse figure8 trajectory path waypoints mission"
    ),
    "The version: `companion --version`.": "version",
}
_BY_WORD = {word: hint for hint, words in _HINTS.items() for word in words.split()}


def hint_for(word: str) -> str:
    """Return the hint for `word`, in whole lines; empty when there is none."""
    return _BY_WORD.get(word.strip("!?.-_").lower().replace("_", "-"), "")
