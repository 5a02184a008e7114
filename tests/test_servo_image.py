"""A servo's registers, read in a few pieces."""

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.one_off import NoAnswer, OneOff
from hardware.dynamixel.servo_image import read_image
from sim.emulator.faults import Fault, FaultKind


@pytest.mark.parametrize(("model", "protocol"), [("XM430-W350", 2), ("2XL430-W250", 2), ("MX-28", 1), ("AX-12A", 1)])
def test_an_image_is_what_the_servo_holds(model: str, protocol: int) -> None:
    servos = specs(2, model)
    rig = BusRig(servos, buses=[bus_of(servos, protocol=protocol, baud=1_000_000)])
    rig.port.open(1_000_000)
    client, table = OneOff(rig.port, protocol), rig.devices[1].table
    image = read_image(client, 2, table)
    for register in table.registers:
        volatile = register.name.startswith(("present", "realtime", "moving_status", "position_tr", "velocity_tr"))
        if image.has(register.name) and not volatile:
            assert image.value(register.name) == rig.devices[1].memory.value(register.name), register.name
    assert image.value("id") == 2
    assert not image.has("no such register")
    if model == "MX-28":
        assert image.has("goal_acceleration")  # behind the present values
    rig.fault(Fault(FaultKind.MISSING, ids=(2,)))
    with pytest.raises(NoAnswer):
        read_image(client, 2, table)
