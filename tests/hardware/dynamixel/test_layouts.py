"""A bus of XL-320: protocol 2.0 with the older layout, from the scan to torque off; and lines with both layouts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bus_rig import CYCLE, BusRig, bus_of, spec, specs
from emulated import answered, read_register, servo1, write_register, wrote
from hardware.bus import ServoAlert
from hardware.dynamixel.bus import BusWatch
from hardware.dynamixel.codec import ALERT, Error2, Instruction
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.found_servos import as_bus, look, look_at_bus
from hardware.dynamixel.line_scan import Speed, scan_line
from hardware.dynamixel.torque import not_limp, off_everywhere
from hardware.errors import BusError
from hardware.servo import ServoGains, ServoSpec
from messages import refuses

SPEED = Speed(2, 1_000_000)


def _rig(servos: list[ServoSpec] | None = None, *, start: list[int] | None = None) -> BusRig:
    """Four XL-320, or those servos, at 1 Mbps. The watchdog of the bus is that of its profile: none."""
    servos = specs(4, "XL-320") if servos is None else servos
    rig = BusRig(servos, buses=[replace(bus_of(servos, baud=SPEED.baud), watchdog=0.0)], start=start)
    for one in rig.devices:
        one.supply(7.4 if one.model == "XL-320" else None, 0.0)
    return rig


def test_a_bus_is_opened_driven_and_let_go() -> None:
    gains = ServoGains(position_p=48, position_i=2)
    rig = _rig([replace(one, gains=gains) for one in specs(4, "XL-320")], start=[400, 500, 512, 600])
    rig.put(2, control_mode=1)  # a wheel
    rig.ready(torque=True)
    assert rig.shown("torque_enable") == [1, 1, 1, 1] and rig.shown("torque_limit") == [1023] * 4
    assert rig.shown("p_gain") == [48] * 4 and rig.shown("i_gain") == [2] * 4 and rig.shown("control_mode") == [2] * 4
    assert rig.shown("return_delay_time") == [0] * 4 and rig.shown("moving_speed") == [0] * 4
    goals = np.array([450, 450, 450, 450])
    fastest = np.zeros(4)
    for _ in range(100):
        states = rig.tick(goals).states
        assert states.valid.all() and states.driven.all() and not states.alert.any()
        fastest = np.where(np.abs(states.velocity) > np.abs(fastest), states.velocity, fastest)
    assert np.abs(states.position - goals).max() <= 1 and np.abs(rig.shafts() - goals).max() <= 1
    assert list(np.sign(fastest)) == [1, -1, -1, -1]
    model = rig.servos[0].model
    assert 0.2 < np.abs(fastest).max() < 1.01 * model.no_load_speed
    assert model.tick_rad == pytest.approx(math.radians(300.0) / 1024) and not model.has_turns
    assert CYCLE * model.no_load_speed / model.tick_rad < 20  # ticks that a goal may move in a cycle
    assert states.voltage == pytest.approx([7.4] * 4, abs=0.1) and np.isnan(states.current).all()
    assert (states.temperature > 20.0).all()
    rig.bus.torque(False)
    assert rig.shown("torque_enable") == [0] * 4
    before = rig.shafts()
    rig.tick(np.full(4, 512))  # no goal reaches a limp servo: it might switch it on
    assert rig.shown("torque_enable") == [0] * 4 and rig.shown("goal_position") == [450] * 4
    assert (rig.shafts() == before).all()
    rig.bus.close()


def test_an_error_is_what_the_register_says_and_not_what_another_layout_would() -> None:
    rig = _rig().ready(torque=True)
    for servo, harm, alert, raw in (
        (rig.devices[0], "heat", ServoAlert.OVERHEATING, 2),
        (rig.devices[1], "supply", ServoAlert.INPUT_VOLTAGE, 4),
    ):
        getattr(servo, harm)(95.0 if harm == "heat" else 9.5, rig.clock.now())
        rig.clock.sleep_until(rig.clock.now() + 0.1)
        for _ in range(3):
            states = rig.tick().states
        place = servo.id - 1
        assert states.valid.all() and states.error[place] == ALERT and states.alert[place] == alert
        assert servo.read(50, 1, rig.clock.now()).data == bytes((raw,))
    for _ in range(4 * len(rig.servos)):  # the torque of one servo is read every few cycles
        states = rig.tick().states
    # Shutdown names heat, not voltage, as the maker delivers it.
    assert list(states.driven) == [False, True, True, True] and list(states.alert[2:]) == [0, 0]


def test_opening_refuses_limits_errors_and_a_supply_with_the_fix() -> None:
    rig = _rig()
    _, hot, weak = rig.devices[:3]
    rig.put(1, cw_angle_limit=400)
    hot.heat(95.0, 0.0)
    weak.supply(5.5, 0.0)
    rig.clock.sleep_until(1.0)
    before = rig.images()
    with refuses(BusError, "400", "cw_angle_limit", "too hot", "5.5 V"):
        rig.bus.open()
    assert rig.images() == before
    rig.put(1, cw_angle_limit=0)
    hot.heat(None, 1.0)
    weak.supply(7.4, 1.0)
    rig.clock.sleep_until(2.0)
    rig.bus.open()
    assert any("ids 1, 2, 3, 4" in note for note in rig.notes)  # none has a bus watchdog


@pytest.mark.parametrize("others", ["XL-320", "XM430-W350"])
def test_without_a_profile_servos_of_both_layouts_are_found_watched_and_let_go(others: str) -> None:
    """As `scan`, `monitor` and `rest` see a line."""
    rig = _rig([spec(1, "XL-320"), spec(2, "XL-320"), spec(3, others), spec(4, others)], start=[300, 500, 600, 700])
    for one in rig.devices:
        write_register(one, "torque_enable", 1)
    rig.port.open(SPEED.baud)
    seen = scan_line(rig.port, [SPEED]).sightings
    assert [(one.found.id, one.model) for one in seen] == [(one.id, one.model) for one in rig.devices]
    name, placed = as_bus("main", seen)
    line = BusLine(name, rig.port, placed)
    look(line, seen)
    states = BusWatch([line]).read()
    assert states.valid.all() and list(states.position) == [300, 500, 600, 700]
    assert not_limp(line, [1, 2, 3, 4]) == [1, 2, 3, 4]
    assert off_everywhere({line: [1, 2, 3, 4]}) == [] == not_limp(line, [1, 2, 3, 4])
    assert rig.shown("torque_enable") == [0] * 4


def test_a_servo_of_the_other_layout_that_the_profile_does_not_have_is_named_and_let_go() -> None:
    rig = BusRig(specs(2), baud=SPEED.baud, unknown_ids=[spec(9, "XL-320")])
    (other,) = [one for one in rig.line.devices if one.id == 9]
    other.memory.put("torque_enable", 1)
    other.react({"torque_enable"}, 0.0)
    rig.port.open(SPEED.baud)
    line = rig.bus.lines[0]
    assert any("9 (XL-320)" in text for text in look_at_bus(line).wrong)
    assert not_limp(line, [1, 2, 9]) == [9]
    assert off_everywhere({line: [1, 2, 9]}) == [] and other.memory.value("torque_enable") == 0


def test_a_servo_answers_and_refuses_as_protocol_2_does() -> None:
    servo = servo1("XL-320", position=512.0)
    assert answered(servo, Instruction.PING).data == bytes((350 & 255, 350 >> 8, servo.table.usual_firmware))
    assert write_register(servo, "goal_position", 1023) == 0 and servo.shaft.torque
    eeprom = servo.table["cw_angle_limit"]
    assert write_register(servo, eeprom.name, 10) == Error2.ACCESS  # torque locks the EEPROM
    wrote(servo, torque_enable=0, cw_angle_limit=100, ccw_angle_limit=900)
    assert write_register(servo, "goal_position", 99) == Error2.DATA_LIMIT
    assert write_register(servo, "led", 8) == Error2.DATA_RANGE
    assert answered(servo, Instruction.WRITE, bytes((30, 0, 1))).error == Error2.DATA_LENGTH
    assert answered(servo, Instruction.READ, bytes((200, 0, 1, 0))).error == Error2.ACCESS
    assert answered(servo, Instruction.CLEAR, b"\1").error == Error2.INSTRUCTION
    servo.heat(80.0, 1.0)
    assert answered(servo, Instruction.PING, b"", 1.0).error == ALERT
    assert write_register(servo, "led", 8, 1.0) == ALERT | Error2.DATA_RANGE
    assert answered(servo, Instruction.REBOOT, b"", 1.0).error == ALERT and servo.booting(1.1)
    servo.heat(None, 2.0)
    assert answered(servo, Instruction.FACTORY_RESET, b"\1", 60.0).error == 0
    assert read_register(servo, "ccw_angle_limit", 61.0) == 1023
