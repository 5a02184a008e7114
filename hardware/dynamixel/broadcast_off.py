"""Torque off told to everybody at once, at speeds that need not be known: quicker than any search.

A broadcast is confirmed by nobody. Whoever uses this looks for the servos afterwards, and asks each.
"""

from collections.abc import Sequence

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.line_scan import Speed, is_gone
from hardware.dynamixel.packets import BROADCAST
from hardware.dynamixel.unread import TORQUE_ENABLE
from hardware.errors import BusError

TIMES = 2
"""A packet may be lost."""
MARGIN = 0.002
"""[s] After the last byte, before the speed changes: what the adapter still holds would be spoiled."""


def tell_everybody_off(port: BytePort, speeds: Sequence[Speed]) -> None:
    """Write torque off to all ids at each speed, in this order; nobody answers. Under 1 s for all speeds there are.

    The port is left at the last speed. A speed that the adapter does not have is left out. Raises BusError when the
    port is gone.
    """
    for speed in speeds:
        try:
            port.set_baud(speed.baud)
        except BusError:
            if is_gone(port):
                raise
            continue
        data = _off(speed.protocol) * TIMES
        port.write(data)
        port.sleep_until(port.now() + 10 * len(data) / speed.baud + port.latency + MARGIN)
        port.drop()


def _off(protocol: int) -> bytes:
    register = TORQUE_ENABLE[protocol]
    make = protocol1.write if protocol == 1 else protocol2.write
    return make(BROADCAST, register.address, register.encode(0))
