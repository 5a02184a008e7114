"""How long a servo's answer really takes: an adapter or a hub may be slower than every timeout assumes."""

from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.exchange import Ask, Kind, settle
from hardware.errors import describe

LOOKS = 5
"""Reads of which the fastest counts."""
PATIENCE = 0.1
"""[s] After which one of them is given up."""


def answer_time(port: BytePort, ask: Ask) -> float | None:
    """Time in s from sending to the first byte that is not the request's echo, of an answer that then comes whole and
    sound; None: none did. The line is silent before and after."""
    port.drop()
    request, sent = ask.request(), port.now()
    port.write(request)
    heard, took, whole = b"", None, False
    while port.now() < sent + PATIENCE and port.wait(sent + PATIENCE):
        heard += port.read()
        if took is None and heard and not request.startswith(heard):
            took = port.now() - sent
        whole = len(ask.answers(heard.removeprefix(request))) == len(ask.ids)
        if whole:
            break
    settle(port)
    return took if whole else None


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
        took = answer_time(port, ask)
        if took is not None:
            fastest = took if fastest is None else min(fastest, took)
            if fastest <= allowed:
                return ""
    if fastest is None:
        return ""  # that nobody answers is said elsewhere
    return describe(
        what="the adapter, or a hub before it, is slower than a cycle allows: every answer would come too late",
        where=port.name,
        found=f"{1e3 * fastest:.1f} ms to the first byte at best",
        allowed=f"{1e3 * allowed:.1f} ms",
        then="Set its latency timer to 1 ms, plug it into the computer itself, or use another adapter",
    )
