"""Random instructions, times and faults: an emulated servo stays a servo."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import read_register, servo1, servo2, write_register
from hardware.dynamixel.codec import Instruction
from hardware.servo import Layout, find_model
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo
from sim.emulator.servo2_registers import GOALS, goal_bounds
from sim.emulator.servo_body import ServoBody

MODELS = [
    *((model, 2) for model in ("XM430-W350", "XL430-W250", "XL330-M288", "MX-28", "MX-106", "XL-320")),
    *((model, 1) for model in ("MX-28", "MX-64", "AX-12A")),
]

_addresses = st.sampled_from((7, 8, 9, 10, 11, 12, 13, 20, 31, 32, 34, 36, 38, 44, 48, 52, 60, 63, 64, 65, 68, 76, 80))
_more = st.sampled_from((82, 84, 88, 90, 98, 100, 102, 104, 108, 112, 116, 126, 168, 170, 224, 208, 578, 634, 660))
_values = st.one_of(
    st.binary(max_size=8),
    st.integers(-2000, 5000).map(lambda value: value.to_bytes(4, "little", signed=True)),
    st.integers(-200, 900).map(lambda value: value.to_bytes(2, "little", signed=True)),
    st.integers(0, 255).map(lambda value: bytes((value,))),
)
_writes = st.tuples(
    st.sampled_from((Instruction.WRITE, Instruction.REG_WRITE)),
    st.builds(lambda address, data: address.to_bytes(2, "little") + data, _addresses | _more, _values),
)
_others = st.tuples(st.integers(0, 255), st.binary(max_size=10))
_known = st.sampled_from(
    (
        (Instruction.ACTION, b""),
        (Instruction.REBOOT, b""),
        (Instruction.FACTORY_RESET, b"\2"),
        (Instruction.CLEAR, bytes.fromhex("0144584c22")),
        (Instruction.CONTROL_TABLE_BACKUP, bytes.fromhex("014354524c")),
        (Instruction.CONTROL_TABLE_BACKUP, bytes.fromhex("024354524c")),
        (Instruction.WRITE, bytes((64, 0, 1))),
        (Instruction.READ, bytes((120, 0, 27, 0))),
        (Instruction.READ, bytes((168, 0, 0, 2))),
    )
)
_faults = st.tuples(
    st.sampled_from(("supply", "heat", "jam", "cut", "back")),
    st.sampled_from((None, 0.0, 0.5, 3.0, 9.0, 12.0, 20.0, 85.0)),
)
_steps = st.lists(
    st.tuples(st.sampled_from((0.0, 0.001, 0.01, 0.3, 2.0)), _writes | _others | _known | _faults), max_size=25
)


def hurt(servo: EmulatedServo | EmulatedServo1, kind: str, value: float | None, now: float) -> None:
    if kind == "supply":
        servo.supply(value, now)
    elif kind == "heat":
        servo.heat(value, now)
    elif kind == "jam":
        servo.jam(bool(value), now)
    else:
        (servo.power_cut if kind == "cut" else servo.power_back)(now)


def sound(servo: ServoBody) -> None:
    """Registers and motion say the same, no number has run away, and in 2.0 goals are within their bounds and an error
    that shuts down has taken the torque."""
    assert bool(servo.memory.value("torque_enable")) == servo.shaft.torque
    assert servo.memory.value("model_number") == servo.number
    assert abs(servo.shaft.velocity) < 1e6 and abs(servo.shaft.position) < 1e9
    if not isinstance(servo, EmulatedServo):
        return
    latched, mask = servo.memory.value("hardware_error_status"), servo.memory.value("shutdown") & 0x3F
    assert not (latched & mask and servo.shaft.torque)
    for name in GOALS:
        if servo.table.has(name):
            low, high = goal_bounds(servo.memory, name)
            if low <= high:  # limits that cross each other leave no goal at all
                assert low <= servo.memory.value(name) <= high


@pytest.mark.parametrize(("model", "protocol"), MODELS)
@settings(max_examples=25, deadline=None)
@given(steps=_steps)
def test_no_instruction_breaks_a_servo(
    model: str, protocol: int, steps: list[tuple[float, tuple[int | str, bytes | None]]]
) -> None:
    x = find_model(model).layout_in(protocol) is Layout.X
    servo = servo2(model) if x else servo1(model, position=512.0)
    now = 0.0
    for wait, (what, with_what) in steps:
        now += wait
        if isinstance(what, str):
            hurt(servo, what, with_what, now)  # type: ignore[arg-type]
        else:
            assert isinstance(with_what, bytes)
            if protocol == 1 and what in (Instruction.WRITE, Instruction.REG_WRITE):
                with_what = with_what[:1] + with_what[2:]  # its addresses are one byte
            servo.receive(now)
            servo.execute(what, with_what, now, broadcast=False)
        sound(servo)
    servo.read(0, servo.table.size, now + 1e6)


@settings(max_examples=100, deadline=None)
@given(address=_addresses | _more, data=_values)
def test_what_is_accepted_is_read_back(address: int, data: bytes) -> None:
    servo = servo2()
    before = bytes(servo.memory.image)
    error = servo.change(address, data, 0.0)
    if error:
        assert bytes(servo.memory.image) == before
    else:
        assert servo.read(address, len(data), 0.0).data == data


@settings(max_examples=50, deadline=None)
@given(
    value=st.integers(1, 127),
    gaps=st.lists(st.floats(0.0, 0.99), max_size=20),
    torque=st.booleans(),
    silence=st.floats(1.01, 5.0),
)
def test_the_watchdog_trips_in_silence_only(value: int, gaps: list[float], torque: bool, silence: float) -> None:
    servo, now = servo2(), 0.0
    write_register(servo, "bus_watchdog", value)
    write_register(servo, "torque_enable", int(torque))
    for gap in gaps:
        now += gap * value * 0.02
        servo.receive(now)
        assert read_register(servo, "bus_watchdog", now) == value
    now += silence * value * 0.02
    assert read_register(servo, "bus_watchdog", now) == (-1 if torque else value)
