"""Everybody on one port, whatever their speed and protocol. Nothing is written to a servo."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hardware.bus_spec import BAUDS
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.control_table import ControlTable, table_of_number
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.packets import MAX_ID
from hardware.dynamixel.servo_error import NoAnswer, ServoError
from hardware.errors import BusError

PROTOCOLS = (2, 1)
"""In the order in which they are tried."""
LIKELY = (57600, 1000000, 2000000, 3000000, 4000000, 115200)
"""[bits/s] The maker's setting (X, MX: 57600; AX: 1000000) and those that people choose, most likely first."""
DIVIDED, MOST_DIVIDED = 2_000_000, 255
"""[bits/s] What protocol 1.0 divides, and by what at most."""
UNSAID = "reports an error, and does not say which"


class Speed(NamedTuple):
    """A way to talk: protocol 1 or 2, bits per second."""

    protocol: int
    baud: int

    def __str__(self) -> str:
        return f"protocol {self.protocol}.0, {self.baud} baud"


@dataclass(frozen=True)
class Sighting:
    """A servo that answered. alert: its errors in words, "" when it reports none."""

    found: Found
    speed: Speed
    alert: str = ""

    @property
    def table(self) -> ControlTable | None:
        """Its registers; None for a model that is not known here."""
        if self.found.model is None:
            return None
        return table_of_number(self.found.model, self.found.firmware)

    @property
    def model(self) -> str:
        """Its model in words."""
        if self.found.model is None:
            return "does not say"
        return self.table.model if self.table is not None else f"number {self.found.model}"


@dataclass(frozen=True)
class LineScan:
    """Who answered, by speed and id; which speeds were tried; and why others could not be.

    echoes: what was sent came back.
    """

    sightings: tuple[Sighting, ...]
    tried: tuple[Speed, ...]
    skipped: tuple[str, ...]
    echoes: bool = False


def all_speeds(
    protocols: Sequence[int] = PROTOCOLS, baud: int | None = None, *, first: Speed | None = None
) -> list[Speed]:
    """Every speed that servos can be set to, or one baud rate only, bits per second; `first`, then the likely ones."""
    speeds = [Speed(one, rate) for one in protocols for rate in ((baud,) if baud is not None else BAUDS[one])]
    ranks = {rate: rank for rank, rate in enumerate(LIKELY)}
    speeds.sort(key=lambda one: (one != first, ranks.get(one.baud, len(ranks)), PROTOCOLS.index(one.protocol)))
    return speeds


def has_speed(protocol: int, baud: int) -> bool:
    """Whether servos of a protocol can be set to `baud` bits/s; in 1.0 to 2 Mbps by a whole number, to 1 %."""
    if protocol != 1 or baud in BAUDS[protocol]:
        return baud in BAUDS[protocol]
    divisor = round(DIVIDED / baud) if baud > 0 else 0
    return 1 <= divisor <= MOST_DIVIDED and abs(DIVIDED / divisor - baud) <= 0.01 * baud


def all_ids(protocol: int) -> range:
    """Ids that a servo of this protocol may have."""
    return range(MAX_ID + (2 if protocol == 1 else 1))


def scan_line(
    port: BytePort,
    speeds: Sequence[Speed],
    *,
    ids: Iterable[int] | None = None,
    progress: Callable[[int], object] = lambda done: None,
    told: Callable[[Sighting], object] = lambda seen: None,
) -> LineScan:
    """Look for `ids` (None: all) at each speed; the port must be open, and is left at the last speed.

    progress: hears how many speeds are done. told: hears of everybody at once (2.0: of all at one speed). Raises
    BusError when the port is gone; a speed that the adapter does not have is skipped.
    """
    wanted = None if ids is None else sorted(set(ids))
    seen: list[Sighting] = []
    tried: list[Speed] = []
    skipped: list[str] = []
    echoes = False
    for done, speed in enumerate(speeds):
        progress(done)
        try:
            port.set_baud(speed.baud)
        except BusError as error:
            if is_gone(port):
                raise
            skipped.append(f"{speed}: {error}")
            continue
        tried.append(speed)
        client = OneOff(port, speed.protocol)
        for found in _found(client, wanted):
            seen.append(_sighting(client, found, speed))
            told(seen[-1])
        echoes = echoes or client.echoes
    progress(len(speeds))
    return LineScan(tuple(seen), tuple(tried), tuple(skipped), echoes)


def _found(client: OneOff, wanted: Sequence[int] | None) -> Iterator[Found]:
    """Who of these ids (None: all) is there. A broadcast brings others too: they were not asked for."""
    possible = all_ids(client.protocol)
    chosen = possible if wanted is None else [device for device in wanted if device in possible]
    if client.protocol == 2:
        yield from (one for one in client.scan(chosen) if one.id in chosen)
        return
    for device in chosen:
        yield from client.scan([device])


def is_gone(port: BytePort) -> bool:
    """Whether it is the port that is missing, and not only a speed."""
    try:
        port.drop()
    except BusError:
        return True
    return False


def _sighting(client: OneOff, found: Found, speed: Speed) -> Sighting:
    bare = Sighting(found, speed)
    if not found.alert:
        return bare
    table = bare.table
    if table is None or not table.has("hardware_error_status"):
        return Sighting(found, speed, UNSAID)
    try:
        bits = client.read(found.id, table["hardware_error_status"])
    except (NoAnswer, ServoError):
        bits = 0
    return Sighting(found, speed, alert_text(bits) or UNSAID)
