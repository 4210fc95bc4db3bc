"""The page docs/faults.md, from the list of all faults: `python -m tests.mock_autopilot.faults.document`."""

from mock_autopilot.faults.catalogue import WAYS, Part, Way
from mock_autopilot.faults.sentences import EXAMPLES

_TITLES = {
    Part.MOCAP: "Motion capture",
    Part.LINK: "The link (MAVLink between companion and autopilot)",
    Part.AUTOPILOT: "The autopilot",
    Part.SERVOS: "The servos",
    Part.BROKER: "The broker (MQTT)",
    Part.NETWORK: "The network (port pairs that the mock relays)",
}
_NOTES = {
    Part.MOCAP: "Frames go through the active faults in the order in which these began. In a fleet faults of a pose, "
    "and `mocap stuck`, concern one vehicle's body. There is one QTM: faults of the whole stream (off, slow, delayed, "
    "intermittent, packets, clock jump, out of order, no bodies) reach every client, whosever they are.",
    Part.LINK: "Without a direction a fault concerns both. The ground station's link is never affected.",
    Part.AUTOPILOT: "",
    Part.SERVOS: "All servos at once. For a single servo or other numbers use another command on standard "
    'input, `servo-fault {"kind": "overload", "id": 6}`, or `[[arms.bus.faults]]`.',
    Part.BROKER: "The mock runs no broker. It reports when such a fault begins and ends; the demo obeys. The "
    "demo refuses such a fault when its configuration has no `[operator]`.",
    Part.NETWORK: "Port pairs are `[[impairment.relays]]` of the mock's configuration, or `--impair` "
    "([mock.md](mock.md#a-bad-network)); without any the mock only reports when such a fault begins and ends. Up is "
    "from the client to the server. Without a direction a fault concerns both, and bursts cut both at the same times. "
    "A fault comes on top of the pair's own impairment. On a TCP pair loss becomes delay. In the demo it is the link "
    "between vehicle and ground, `--law-on ground`.",
}
_HEAD = f"""# Faults in the mock

Printed from `mock_autopilot/faults/catalogue.py` by `python -m tests.mock_autopilot.faults.document`. The kinds are
those of PX4's own system failure injection (MAVLink's `FAILURE_TYPE`): off, stuck, garbage, wrong, slow, delayed,
intermittent.

A fault is a sentence:

```
{chr(10).join(EXAMPLES)}
```

It begins with one of the phrases below, in a fleet (`--vehicles 2`) with the vehicle before it; without, it is the
first one's. Then, in any order, may follow

- an amount, where there is one: `by 0.5 m`, `to 20 Hz`; without, it is the one of the table;
- when: `at 12 s` counts from lift-off, the first time that its vehicle really leaves the ground; a phase counts from
  the first time it is reached: `on the ground` (the start), `armed`, `in the air`, `landing` (PX4 lands by itself, told
  to or by a failsafe; a landing in offboard mode is like any other flight to PX4), each with `after 3 s` or without.
  Without a time a fault from options or configuration begins at the start, one from standard input at once; a time
  that is past is now;
- how long: `for 2 s`; without, for ever. A fault that happens once has no length.

Faults are given to the demo, to the mock, or in the mock's configuration:

```console
$ make demo ARGS="--fault 'mocap stuck at 12 s for 2 s'"                # may be given again
$ .venv/bin/python -m mock_autopilot --config config/mock.toml --fault "link off at 20 s"
```

```toml
[[faults]]                              # in the mock's configuration
say = "mocap stuck at 12 s for 2 s"

[[faults]]                              # or with keys
part = "mocap"
kind = "wrong"
how = "jump"
amount = 0.5                            # in the table's unit
phase = "in the air"                    # or at_s = 3.0
after_s = 3.0
for_s = 2.0
```

With `--exit-with-stdin` the mock reads commands as lines on its standard input: `fault mocap stuck for 2 s` begins at
once. It reports on standard output when a fault begins and ends, on this machine's monotonic clock, and in the end
which of the scripted ones never began. The demo shows these lines in its own time, which counts from the start of the
motors, a second or two before lift-off.

Their random numbers come from the seed, and no other random number depends on them: the same seed, faults and
commands give the same flight in simulated time, and without faults a flight is not changed.
"""


def document() -> str:
    """Return the whole text of docs/faults.md."""
    return "\n".join([_HEAD, *(_section(part) for part in Part)])


def _section(part: Part) -> str:
    ways = [way for way in WAYS if way.part is part]
    rows = [f"| `{way.words}` | {_amount(way)} | {way.does} |" for way in ways]
    note = f"{_NOTES[part]}\n\n" if _NOTES[part] else ""
    return (
        f"## {_TITLES[part]}\n\n{note}| sentence | amount | what it does |\n| --- | --- | --- |\n"
        + "\n".join(rows)
        + "\n"
    )


def _amount(way: Way) -> str:
    amount = way.amount
    if amount is None:
        return "" if way.lasts else "once"
    unit = f" {amount.unit}" if amount.unit else ""
    least, most = (f"{value:.4g}" for value in (amount.least, amount.most))
    once = "" if way.lasts else ", once"
    return f"`{amount.text(amount.usual)}` ({least} to {most}{unit}){once}"


if __name__ == "__main__":
    print(document(), end="")
