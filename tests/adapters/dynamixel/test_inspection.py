"""Everything that can be wrong with the eight servos when connecting, and the sentence that says so; simulated time."""

from collections.abc import Callable
from typing import Any

import pytest

from companion.adapters.dynamixel.bus_cycle import BusCycle
from companion.adapters.dynamixel.faults import FaultLog
from companion.adapters.dynamixel.inspection import Inspected, inspect
from companion.adapters.dynamixel.joint import joints_of
from companion.adapters.dynamixel.port import PortGoneError
from companion.adapters.dynamixel.torque import torque_on
from companion.adapters.dynamixel.wire import Wire
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ArmError
from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind
from mock_autopilot.servos.rack import ServoRack
from tests.adapters.dynamixel.rig import servos
from tests.adapters.dynamixel.virtual_port import VirtualPort

XM, AX, SHOULDER = "right.elbow_pitch (ID 2)", "right.claw (ID 4)", "right.shoulder_pitch (ID 1)"
HEADLINE = "the arms on /dev/ttyUSB0 cannot be used:\n  "


class Clock:
    """Time that passes only while the port waits."""

    time_s = 100.0

    def now_s(self) -> float:
        return self.time_s

    def wait(self, for_s: float) -> None:
        self.time_s += for_s


class Bench:
    """The mock's servos at the end of a virtual port, and the driver's bus_cycle."""

    def __init__(self, config: ArmsConfig | None = None, **mock: Any) -> None:
        self.config, self.clock = config or ArmsConfig(), Clock()
        self.rack = ServoRack(DynamixelConfig.model_validate(mock))
        self.port = VirtualPort(self.config, self.rack, self.clock)
        self.port.patience_ms = 20.0
        self.bus_cycle = BusCycle(joints_of(self.config), Wire(self.port), FaultLog(), self.config, self.clock)

    def put(self, servo_id: int, register: str, value: int) -> "Bench":
        self.rack.servo(servo_id).table.put(register, value)
        return self

    def fault(self, kind: FaultKind, servo_id: int | None = None) -> "Bench":
        self.rack.inject(Fault(kind=kind, id=servo_id))
        return self

    def inspect(self) -> Inspected:
        return inspect(self.bus_cycle, self.config, lambda: False)

    def refusal(self) -> list[str]:
        """Return the lines of the error that connecting ends with."""
        with pytest.raises(ArmError) as caught:
            self.inspect()
        return str(caught.value).removeprefix(HEADLINE).split("\n  ")


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"id2": {"model": "XM430-W210"}}, f"{XM} is XM430-W210, and should be XM430-W350"),
        ({"id2": {"firmware": 37}}, f"{XM} has firmware 37, and should have 38 or newer"),
        ({"id2": {"return_delay_us": 500}}, f"{XM} waits 500 us before it answers, and should wait 0"),
        ({"id4": {"return_delay_us": 500}}, f"{AX} waits 500 us before it answers, and should wait 0"),
        ({"id2": {"operating_mode": 4}}, f"{XM} is in extended position control (Operating Mode 4), and should be in"),
        ({"id2": {"start_position_rad": 6.2}}, f"{XM} stands at 3.06 rad, and should be within -0.2 to 2.6"),
        ({"id4": {"start_position_rad": 0.0}}, f"{AX} stands at -2.62 rad, and should be within 0 to 1"),
    ],
)
def test_a_servo_that_is_set_wrong(changes: dict[str, Any], wanted: str) -> None:
    [said] = Bench(servos=servos(**changes)).refusal()
    assert said.startswith(wanted)


@pytest.mark.parametrize(
    ("servo_id", "register", "value", "wanted"),
    [
        (2, "drive_mode", 1, f"{XM} has Drive Mode 1, and should have 0"),
        (2, "drive_mode", 4, f"{XM} has Drive Mode 4, and should have 0"),
        (2, "drive_mode", 8, f"{XM} has Drive Mode 8, and should have 0"),
        (4, "ccw_angle_limit", 0, f"{AX} is in wheel mode, and should be in joint mode"),
        (4, "ccw_angle_limit", 600, f"{AX} accepts -2.62 to 0.45 rad, and should accept the joint's limits 0 to 1"),
        (2, "max_position_limit", 3000, f"{XM} accepts -3.14 to 1.46 rad, and should accept"),
        (
            2,
            "status_return_level",
            1,
            f"{XM} has Status Return Level 1, and should have 2 (answer everything): restart",
        ),
        (4, "status_return_level", 1, f"{AX} has Status Return Level 1, and should have 2 (answer everything): set it"),
        (2, "secondary_id", 3, f"{XM} has right.elbow_roll's ID 3 as its Secondary ID and moves with it: set that to"),
        (
            2,
            "bus_watchdog",
            -1,
            f"{XM} takes no goals (its Bus Watchdog has struck) after another program: restart its",
        ),
        (
            2,
            "status_return_level",
            0,
            f"{XM} answers pings but no reads: Status Return Level 0, and should be 2: restart its power",
        ),
        (
            4,
            "status_return_level",
            0,
            f"{AX} answers pings but no reads: Status Return Level 0, and should be 2: set it with DYNAMIXEL Wizard",
        ),
        (
            2,
            "protocol_type",
            1,
            f"{XM} does not answer at 1000000 bits/s: it speaks Protocol 1.0, so set its Protocol Type to 2 with",
        ),
    ],
)
def test_a_register_that_is_wrong(servo_id: int, register: str, value: int, wanted: str) -> None:
    [said] = Bench().put(servo_id, register, value).refusal()
    assert said.startswith(wanted)


@pytest.mark.parametrize("register", [(2, "baud_rate", 1, 57_600), (4, "baud_rate", 16, 117_647)])
def test_a_baud_rate_that_is_set_but_not_yet_taken(register: tuple[int, str, int, int]) -> None:
    servo_id, name, value, said_baud = register
    bench = Bench()
    kind = type(bench.rack.servo(servo_id))
    bench.rack.servo(servo_id).__class__ = type("Stubborn", (kind,), {"baud": 1_000_000})
    [said] = bench.put(servo_id, name, value).refusal()
    assert f"is set to {said_baud} bits/s, and should be to 1000000" in said


XM_BAUDS = (9_600, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
AX_BAUDS = (9_600, 19_200, 57_600, 115_200, 200_000, 250_000, 400_000, 500_000)


@pytest.mark.parametrize(("servo_id", "baud"), [*((3, baud) for baud in XM_BAUDS), *((4, baud) for baud in AX_BAUDS)])
def test_a_servo_at_any_other_baud_rate_it_can_have_is_found(servo_id: int, baud: int) -> None:
    [said] = Bench(servos=servos(**{f"id{servo_id}": {"baud": baud}})).refusal()
    assert said.endswith(
        f"does not answer at 1000000 bits/s: it answers at {baud}, so set its Baud Rate with DYNAMIXEL Wizard 2.0"
    )


def test_a_baud_rate_that_the_adapter_does_not_have_is_left_out_of_the_search() -> None:
    bench = Bench(servos=servos(id3={"baud": 4_500_000}))
    change_baud: Callable[[int], None] = bench.port.change_baud

    def change(baud: int) -> None:
        if baud > 2_000_000:
            raise PortGoneError("Failed to set custom baud rate")
        change_baud(baud)

    bench.port.change_baud = change  # type: ignore[method-assign]
    [said] = bench.refusal()
    assert said.endswith("does not answer at 1000000 bits/s: look at its cable, its supply and its ID")


def test_two_servos_with_one_id_that_answer_together() -> None:
    [said] = Bench().fault(FaultKind.TWIN, 2).refusal()
    assert said == (
        f"{XM} answers in broken packets: two servos have ID 2, so take all others off the bus and give one of them "
        "another with DYNAMIXEL Wizard 2.0; or its cable is bad"
    )


def test_two_servos_with_one_id_that_answer_one_after_the_other() -> None:
    bench = Bench()
    answer = bench.rack.answer
    bench.rack.answer = lambda packet, baud=None: [  # type: ignore[method-assign]
        twice for said in answer(packet, baud) for twice in ([said, said] if said.ids == (2,) else [said])
    ]
    assert bench.refusal() == [
        f"{XM} is there 2 times: give all but one another ID than 2 with DYNAMIXEL Wizard 2.0",
    ]


def test_a_claw_with_the_factorys_id_is_found() -> None:
    said = Bench(servos=servos(id8={"id": 11})).refusal()
    assert said == [
        "left.claw (ID 8) does not answer at 1000000 bits/s: look at its cable, its supply and its ID",
        "ID 11 answers by Protocol 1.0, AX-12A, but no joint of that protocol has that ID: correct arms.servos or the "
        "servo's ID",
    ]


def test_a_model_that_this_driver_does_not_know_is_named() -> None:
    assert (
        Bench()
        .put(1, "model_number", 1120)
        .refusal()[0]
        .startswith(f"{SHOULDER} is XM540-W270, and should be XM430-W350")
    )
    assert "is an unknown model 4711, and" in Bench().put(1, "model_number", 4711).refusal()[0]


def test_low_voltage_and_heat() -> None:
    said = Bench(ArmsConfig(max_temperature_c=60.0), voltage_v=9.7, ambient_c=60.0).refusal()
    assert sum("has 9.7 V, and should have 10 V or more: charge the battery" in line for line in said) == 8
    assert sum("has 65 degrees C, and should have 60 or less: let it cool down" in line for line in said) == 8


def test_an_error_that_is_latched_from_before() -> None:
    bench = Bench()
    for servo_id in (2, 4):
        bench.rack.servo(servo_id).motor.power(on=True)
        bench.fault(FaultKind.OVERLOAD, servo_id)
    said = bench.refusal()
    assert said[0].startswith(f"{XM} reports overload, latched from before: restart its power")
    assert said[1].startswith(f"{AX} reports overload, latched from before: restart its power")


def test_one_error_names_all_that_is_missing_or_wrong() -> None:
    bench = Bench(servos=servos(id1={"firmware": 30}, id6={"operating_mode": 5}))
    lines = bench.put(7, "status_return_level", 0).fault(FaultKind.MISSING, 3).fault(FaultKind.MISSING, 8).refusal()
    assert [line.split()[0] for line in lines] == [
        "right.shoulder_pitch", "left.elbow_pitch", "left.elbow_roll", "right.elbow_roll", "left.claw",
    ]  # fmt: skip
    assert lines[3].startswith("right.elbow_roll (ID 3) does not answer at 1000000 bits/s: look at its cable")


def test_missing_servos_are_looked_for_at_other_baud_rates_ids_and_protocols() -> None:
    elsewhere = servos(id1={"baud": 57_600}, id2={"model": "AX-12A"}, id3={"id": 12})
    said = "\n".join(Bench(servos=elsewhere).refusal())
    assert "(ID 1) does not answer at 1000000 bits/s: it answers at 57600, so set its Baud Rate" in said
    assert f"{XM} does not answer at 1000000 bits/s: AX-12A answers there by Protocol 1.0, and it should be" in said
    assert "ID 12 answers, XM430-W350, but no joint has that ID" in said


def test_a_bus_without_power_names_every_joint() -> None:
    bench = Bench().fault(FaultKind.SILENT_BUS)
    assert ["does not answer" in line for line in bench.refusal()] == [True] * 8
    assert bench.clock.time_s < 110.0, "eight servos are looked for at seven other baud rates within some seconds"


@pytest.mark.parametrize(
    ("servo_id", "register", "value", "wanted"),
    [
        (1, "homing_offset", 1000, "has Homing Offset 1000 (+1.53 rad), which is in all its angles and lost by a"),
        (1, "homing_offset", -3000, "has Homing Offset -3000, which position control ignores: set it to 0 with"),
        (1, "shutdown", 0, "keeps its torque on overheating, overload (Shutdown 0) and can burn: set it to 52 with"),
        (1, "shutdown", 4, "keeps its torque on overload (Shutdown 4) and can burn: set it to 52 with DYNAMIXEL"),
        (4, "shutdown", 0x20, "keeps its torque on overheating (Shutdown 32) and can burn: set it to 36 with"),
        (1, "temperature_limit", 50, "switches off above 50 degrees C (Temperature Limit), and may fly at up to 65:"),
        (4, "temperature_limit", 50, "switches off above 50 degrees C (Temperature Limit), and may fly at up to 65:"),
        (1, "startup_configuration", 1, "switches its torque on by itself when it gets power (Startup Configuration)"),
        (1, "bus_watchdog", 5, "stops when the bus is quiet for 0.1 s (Bus Watchdog), left by another program:"),
        (1, "velocity_limit", 50, "has Velocity Limit 1.20 rad/s, less than its joint's 3: raise it with DYNAMIXEL"),
        (1, "pwm_limit", 443, "may use 50% of its voltage (PWM Limit, Goal PWM) and be too weak for its arm: set PWM"),
        (1, "goal_pwm", 177, "may use 20% of its voltage (PWM Limit, Goal PWM) and be too weak for its arm: set PWM"),
        (1, "position_p_gain", 200, "has position gains P, I, D and feedforward 200, 0, 0, 0, 0 instead of 800, 0, 0,"),
        (1, "feedforward_2nd_gain", 50, "has position gains P, I, D and feedforward 800, 0, 0, 0, 50 instead of 800,"),
    ],
)
def test_a_setting_that_somebody_left_in_a_servo_is_a_warning(
    servo_id: int, register: str, value: int, wanted: str
) -> None:
    [said] = Bench().put(servo_id, register, value).inspect().remarks
    assert said.startswith(f"{SHOULDER if servo_id == 1 else AX} {wanted}")


@pytest.mark.parametrize(
    ("register", "value"), [("moving_threshold", 300), ("secondary_id", 40), ("indirect_address_1", 116), ("led", 1)]
)
def test_settings_that_change_nothing_for_us_are_passed_over(register: str, value: int) -> None:
    inspected = Bench().put(1, register, value).inspect()
    assert (inspected.remarks, inspected.complaints) == ((), ())


def test_factory_settings_bring_no_warning_and_no_bad_packet() -> None:
    bench = Bench()
    assert bench.inspect().remarks == ()
    assert bench.bus_cycle.wire.bad_packets == 0


def test_a_limp_joint_turned_past_the_end_of_its_servos_turn_is_named_as_when_connecting() -> None:
    bench = Bench()
    bench.inspect()
    bench.rack.servo(2).motor.angle_rad = -0.08
    with pytest.raises(ArmError) as caught:
        list(torque_on(bench.bus_cycle))
    assert str(caught.value) == (
        f"torque is not on everywhere:\n  {XM} stands at -3.22 rad, and should be within -0.2 to 2.6: move it there by "
        "hand, or correct zero_rad and direction"
    )
    assert [servo.torque_on for servo in bench.rack.servos].count(True) == 7
    bench.rack.servo(2).motor.angle_rad = 3.2
    list(torque_on(bench.bus_cycle))
    assert all(servo.torque_on for servo in bench.rack.servos)
