"""What the profile wants is written, once, in the right order, and read back."""

from dataclasses import replace

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.packets import Instruction
from hardware.errors import BusError
from hardware.servo import ServoGains, ServoMode, ServoSpec
from support.messages import refuses, shows

GAINS = ServoGains(position_p=400, position_i=10, position_d=20, feedforward_1=5, feedforward_2=6)


def wanted() -> list[ServoSpec]:
    """Two servos with gains, one of many turns and one that limits its current."""
    plain = [replace(one, gains=GAINS) for one in specs(3)]
    plain[1] = replace(plain[1], mode=ServoMode.EXTENDED_POSITION)
    plain[2] = replace(plain[2], mode=ServoMode.CURRENT_BASED_POSITION, current_limit=1.0)
    return plain


def writes(rig: BusRig, device: int) -> list[int]:
    """Addresses that were written to one servo, in order."""
    frames = [packet for packet in rig.port.sent if packet[4] == device and packet[7] == Instruction.WRITE]
    return [packet[8] | packet[9] << 8 for packet in frames]


def delivered(rig: BusRig) -> BusRig:
    """All in the mode that servos are delivered in."""
    for one in rig.devices:
        one.memory.put("operating_mode", 3)
        one.tune()
    return rig


def test_what_differs_is_written_once_and_kept() -> None:
    rig = delivered(BusRig(wanted())).ready()
    assert rig.shown("operating_mode") == [3, 4, 5]
    assert rig.shown("return_delay_time") == [0] * 3
    for name, value in (
        ("position_p_gain", 400),
        ("position_i_gain", 10),
        ("position_d_gain", 20),
        ("feedforward_1st_gain", 5),
        ("feedforward_2nd_gain", 6),
        ("profile_velocity", 0),
        ("profile_acceleration", 0),
    ):
        assert rig.shown(name) == [value] * 3
    table = rig.device(1).table
    for device in (1, 2, 3):
        told = writes(rig, device)
        assert len(told) == len(set(told))
        modes = [address for address in told if address == table["operating_mode"].address]
        assert len(modes) == (device > 1)
        # A change of mode resets the gains: they come after everything in EEPROM.
        first_gain = min(told.index(table[name].address) for name in ("position_p_gain", "feedforward_1st_gain"))
        assert all(address >= table.eeprom_end for address in told[first_gain:])
    shows(rig.notes, "j2", 2, "return_delay_time", 250, 0, "operating_mode", 3, 4)
    assert rig.shown("torque_enable") == [0] * 3


def test_what_is_right_is_not_written_again() -> None:
    rig = delivered(BusRig(wanted())).ready()
    rig.bus.close()
    rig.port.sent.clear()
    rig.notes.clear()
    rig.bus = rig.another()
    rig.ready()
    assert [writes(rig, device) for device in (1, 2, 3)] == [[], [], []]
    assert rig.notes == []


def test_a_profile_without_gains_leaves_the_maker_s() -> None:
    rig = BusRig(specs(1)).ready()
    table = rig.device(1).table
    assert rig.shown("position_p_gain") == [table["position_p_gain"].initial]
    assert writes(rig, 1) == [table["return_delay_time"].address]


def test_a_value_that_is_not_kept_is_named_and_the_ports_are_closed() -> None:
    rig = BusRig([replace(one, gains=GAINS) for one in specs(2)])
    one = rig.device(2)
    store, address = one.memory.store, one.table["position_p_gain"].address

    def forgetful(register: object, value: int) -> None:
        if getattr(register, "address", None) != address:
            store(register, value)  # type: ignore[arg-type]

    one.memory.store = forgetful  # type: ignore[method-assign]
    with refuses(BusError, 2, "position_p_gain", 400, 800):
        rig.bus.open()
    assert not rig.port.opened


def test_current_is_the_drive_where_the_mode_limits_it() -> None:
    rig = delivered(BusRig(wanted())).ready(torque=True)
    third = rig.device(3)
    unit = third.table["goal_current"].scale
    assert unit is not None
    assert third.memory.value("goal_current") == round(1.0 / unit)


@pytest.mark.parametrize("model", ["AX-12A", "MX-28"])
def test_protocol_1_is_told_what_it_has(model: str) -> None:
    servos = [replace(one, gains=ServoGains(position_p=40)) for one in specs(2, model)]
    rig = BusRig(servos, buses=[bus_of(servos, protocol=1, baud=1_000_000)]).ready(torque=True)
    if model == "MX-28":
        assert rig.shown("p_gain") == [40, 40]
    assert rig.shown("moving_speed") == [0, 0]
    assert rig.shown("torque_limit") == rig.shown("max_torque")
    assert rig.shown("torque_enable") == [1, 1]
