"""Everybody on a bus who answers, expected or not."""

from hardware.bus_spec import MAX_RETURN_DELAY, BusSpec
from hardware.dynamixel import discovery, protocol1
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.packets import MAX_ID

SLACK = 0.001
"""[s] That a stranger's answer to a ping may be late."""
LONGEST = 2.0
"""[s] That the search for strangers of protocol 1.0 may take: about 1 s at 1 Mbps, 1.7 s at 57,600."""


def everybody(port: BytePort, client: OneOff, bus: BusSpec) -> tuple[list[Found], list[str]]:
    """Who answers on an open port, by id; and notes. Raises BusError when the port is gone.

    2.0: one broadcast ping, heard to its end, so that no late answer disturbs what comes next. 1.0 has none: each id
    is pinged, once those that are not expected.
    """
    if bus.protocol == 2:
        heard = client.scan({*bus.ids, MAX_ID})  # the window is that of the highest id asked for
        return [one for one in heard if one.id in bus.ids or one.model is not None], []  # noise is no stranger
    found = {one.id: one for one in client.scan(bus.ids)}
    wait = MAX_RETURN_DELAY + port.latency + SLACK
    others = [device for device in range(MAX_ID + 2) if device not in bus.ids]
    each = discovery.SPREAD + wait + 10 * (len(protocol1.ping(0)) + 2 * protocol1.STATUS_BYTES) / port.baud
    if len(others) * each > LONGEST:
        return [*found.values()], [f"bus {bus.name}: too slow to look for servos that the profile does not know"]
    for device in others:
        if any(answer.id == device for answer in discovery.ping_alone(port, 1, device, wait).answers):
            stranger = client.ping(device)
            if stranger is not None:
                found[device] = stranger
    return [found[device] for device in sorted(found)], []
