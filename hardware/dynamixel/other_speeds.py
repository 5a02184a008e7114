"""Servos that do not answer at the speed of their bus, looked for at all others."""

from collections.abc import Mapping, Sequence

from hardware.bus_spec import BAUDS, BusSpec
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.line_scan import is_gone
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.setup_plan import setup_command
from hardware.errors import BusError

MOST = 3
"""Ids that are looked for: each costs a wait at every speed."""


def other_bauds(bus: BusSpec) -> list[int]:
    """Bits per second that servos of its protocol can have, but for its own."""
    return [baud for baud in BAUDS[bus.protocol] if baud != bus.baud]


def heard_elsewhere(port: BytePort, bus: BusSpec, ids: Sequence[int]) -> dict[int, list[int]]:
    """By id, the first MOST of `ids` that answer at other speeds, and at which, bits/s; the port is left at the bus's
    own.

    A speed that the adapter does not have is left out. Raises BusError when the port is gone.
    """
    found: dict[int, list[int]] = {}
    for baud in other_bauds(bus):
        try:
            port.set_baud(baud)
        except BusError:
            if is_gone(port):
                raise
            continue
        client = OneOff(port, bus.protocol, retries=0)
        for device in ids[:MOST]:
            answer = client.ping(device)
            if answer is not None and not answer.clash:
                found.setdefault(device, []).append(baud)
    port.set_baud(bus.baud)
    return found


def elsewhere_texts(port: BytePort, bus: BusSpec, ids: Sequence[int], named: Mapping[int, str]) -> list[str]:
    """Of the first MOST of `ids`: who answers at which other speed, and the command that mends it, a text each.

    named: what people call them, by id. Raises BusError when the port is gone.
    """
    texts = []
    for device, bauds in heard_elsewhere(port, bus, ids).items() if ids else ():
        speeds, cure = " and ".join(map(str, bauds)), setup_command(bus, device, baud=bus.baud)
        name = named.get(device, f"device {device}")
        texts.append(f"{name} answers at {speeds} baud, and its bus has {bus.baud}: {cure}")
    return texts
