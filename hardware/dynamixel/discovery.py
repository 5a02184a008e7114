"""Who is on the line: a broadcast ping (2.0) and single pings that listen long enough to notice a second answer."""

from collections import Counter
from dataclasses import dataclass

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.packets import BROADCAST, MAX_ID, Status
from hardware.dynamixel.parsers import parser1, parser2

SLOT = 0.003
"""[s] Beside its bytes, that the SDK allows each id when all devices answer a broadcast ping in order."""
SETTLE = 0.016
"""[s] That the SDK adds to all slots."""
PING_BYTES = protocol2.STATUS_BYTES + 3
SPREAD = 0.001
"""[s] Within which two servos with one id begin to answer: their return delays differ by half of it at most."""
MAX_HEARD = 65_536
"""Bytes after which a line that never falls silent is left."""


@dataclass(frozen=True)
class Found:
    """A servo on the line. model, firmware: None where it did not tell.

    alert: it reports a hardware error. clash: two answers came, or none was whole: most likely two servos with this id.
    """

    id: int
    protocol: int
    model: int | None = None
    firmware: int | None = None
    alert: bool = False
    clash: bool = False


@dataclass(frozen=True)
class Heard:
    """Status frames, in order; damaged: bytes that belong to none; echoed: what was sent came back."""

    answers: tuple[Status, ...]
    damaged: int
    echoed: bool


def broadcast_ping(port: BytePort, highest: int, slack: float) -> Heard:
    """Ping all devices of protocol 2.0, and listen until that with the id `highest` must have answered.

    Devices answer in order of their ids, each in its own slot: hence the window, and it cannot end sooner, since an
    unknown device may be the last one. At most 0.78 s at 4 Mbps, as the SDK's; 20 ids: 0.08 s.
    """
    slots = min(highest, MAX_ID) + 1
    request = protocol2.ping(BROADCAST)
    window = SETTLE + slots * SLOT + 10 * (len(request) + slots * PING_BYTES) / port.baud + port.latency + slack
    return _ask(port, 2, request, window)


def ping_alone(port: BytePort, protocol: int, device: int, wait: float) -> Heard:
    """Ping one device; `wait`: s that it may take beside the bytes. Listens on for a second answer to the first."""
    request = protocol1.ping(device) if protocol == 1 else protocol2.ping(device)
    answer = 10 * (protocol1.STATUS_BYTES if protocol == 1 else PING_BYTES) / port.baud
    window = 10 * len(request) / port.baud + 2 * answer + SPREAD + wait
    return _ask(port, protocol, request, window, enough=2)


def found_by_broadcast(heard: Heard) -> list[Found]:
    """The servos of a broadcast ping, by id."""
    times = Counter(answer.id for answer in heard.answers)
    first: dict[int, Status] = {}
    for answer in heard.answers:
        first.setdefault(answer.id, answer)
    return [found_by_ping(first[device], clash=times[device] > 1) for device in sorted(first)]


def found_by_ping(answer: Status, *, clash: bool = False) -> Found:
    """The servo behind a 2.0 answer to a ping; a refusal carries no model."""
    known = len(answer.data) == 3
    return Found(
        id=answer.id,
        protocol=2,
        model=answer.data[0] | answer.data[1] << 8 if known else None,
        firmware=answer.data[2] if known else None,
        alert=bool(answer.error & 0x80),
        clash=clash,
    )


def _ask(port: BytePort, protocol: int, request: bytes, window: float, *, enough: int | None = None) -> Heard:
    """Send, and listen for `window` s or until there are `enough` answers."""
    port.drop()
    port.write(request)
    deadline = port.now() + window
    heard = bytearray()
    while port.now() < deadline and len(heard) < MAX_HEARD:
        port.wait(deadline)
        heard += port.read()
        if enough is not None and len(_answers(protocol, request, bytes(heard)).answers) >= enough:
            break
    return _answers(protocol, request, bytes(heard))


def _answers(protocol: int, request: bytes, heard: bytes) -> Heard:
    """What the bytes mean; an echo of the request is in front."""
    echoed = heard.startswith(request)
    parser = parser1() if protocol == 1 else parser2()
    frames = parser.feed(heard[len(request) :] if echoed else heard)
    if protocol == 1:
        answers = [protocol1.status_of(frame) for frame in frames]
    else:
        told = (protocol2.status_of(frame) for frame in frames)
        answers = [answer for answer in told if answer is not None]
    return Heard(tuple(answers), parser.skipped + len(parser.pending), echoed)
