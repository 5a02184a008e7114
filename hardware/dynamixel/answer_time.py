"""How long a servo's answer really takes: an adapter or a hub may be slower than every timeout assumes."""

from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.exchange import Ask, Kind
from hardware.errors import describe

LOOKS = 5
"""Reads of which the fastest counts."""
PATIENCE = 0.1
"""[s] After which one of them is given up."""


def first_byte(port: BytePort, ask: Ask) -> float | None:
    """Time in s from sending to the first byte that is not the request's echo; None: it did not come."""
    port.drop()
    request, sent = ask.request(), port.now()
    port.write(request)
    heard = b""
    while port.wait(sent + PATIENCE):
        heard += port.read()
        if heard and not request.startswith(heard):
            return port.now() - sent
    return None


def too_slow(port: BytePort, table: ControlTable, device: int, return_delay: float) -> str:
    """What is wrong when even the fastest answer comes later than a cycle waits for it; "" when it does not.

    return_delay: of that servo, s. Raises BusError when the port is gone.
    """
    position = table["present_position"]
    kind = Kind.SINGLE1 if table.protocol == 1 else Kind.SYNC
    ask = Ask(kind, (device,), position.address, position.size)
    allowed = ask.timeouts(port, return_delay).first
    fastest = None
    for _ in range(LOOKS):
        took = first_byte(port, ask)
        if took is not None:
            fastest = took if fastest is None else min(fastest, took)
        if fastest is not None and fastest <= allowed:
            return ""
    port.sleep_until(port.now() + PATIENCE)  # what is left of the last answer
    port.drop()
    if fastest is None:
        return ""  # that nobody answers is said elsewhere
    return describe(
        what="the adapter, or a hub before it, is slower than a cycle allows: every answer would come too late",
        where=port.name,
        found=f"{1e3 * fastest:.1f} ms to the first byte at best",
        allowed=f"{1e3 * allowed:.1f} ms",
        then="Set its latency timer to 1 ms, plug it into the computer itself, or use another adapter",
    )
