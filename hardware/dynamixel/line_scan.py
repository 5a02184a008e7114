"""Finding every servo on a port, at any speed and protocol; and writing one EEPROM value, also id and speed."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

from hardware.bus import BAUDS, BusSpec
from hardware.dynamixel import opencr
from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.codec import CODECS
from hardware.dynamixel.control_table import DIVIDED_BAUD, DIVIDED_TOLERANCE, ControlTable, baud_of, table_of_number
from hardware.dynamixel.serial_port import BytePort
from hardware.dynamixel.settings import Setting, setup_command
from hardware.dynamixel.single_requests import FoundServo, NoAnswer, OneOff, ServoError
from hardware.errors import BusError

PROTOCOLS = (2, 1)
LIKELY = (1000000, 57600, 2000000, 3000000, 4000000, 115200)
"""[bits/s] Factory settings (X, MX: 57600; AX: 1000000) and common choices, most likely first."""
LIKELY_IDS = range(61)
"""1.0 ids of a quick scan. Humanoids number by limbs, up to 54 on Poppy."""
MOST_DIVIDED = 255  # largest value of the 8-bit baud register of 1.0
UNREAD_ERROR = "reports an error, and does not say which"


class Speed(NamedTuple):
    """Protocol, 1 or 2, and baud rate, bits/s."""

    protocol: int
    baud: int

    def __str__(self) -> str:
        return f"protocol {self.protocol}.0, {self.baud} baud"


@dataclass(frozen=True)
class Sighting:
    """A servo that answered. alert: its errors in words, or ""."""

    found: FoundServo
    speed: Speed
    alert: str = ""

    @property
    def table(self) -> ControlTable | None:
        """Control table of the model; None if unknown."""
        if self.found.model is None:
            return None
        return table_of_number(self.found.model, self.found.firmware)

    @property
    def model(self) -> str:
        """Model in words."""
        if self.found.model is None:
            return "does not say"
        if self.found.model == opencr.NUMBER:  # no servo
            return opencr.TABLE.model
        return self.table.model if self.table is not None else f"number {self.found.model}"


@dataclass(frozen=True)
class LineScan:
    """sightings: by speed and id. skipped: reasons of untried speeds. echoes: the adapter returns what is sent."""

    sightings: tuple[Sighting, ...]
    tried: tuple[Speed, ...]
    skipped: tuple[str, ...]
    echoes: bool = False


def all_speeds(
    protocols: Sequence[int] = PROTOCOLS, baud: int | None = None, *, first: Speed | None = None
) -> list[Speed]:
    """Return every possible speed, or those of one baud rate: `first`, then the likely ones."""
    speeds = [Speed(one, rate) for one in protocols for rate in ((baud,) if baud is not None else BAUDS[one])]
    ranks = {rate: rank for rank, rate in enumerate(LIKELY)}
    speeds.sort(key=lambda one: (one != first, ranks.get(one.baud, len(ranks)), PROTOCOLS.index(one.protocol)))
    return speeds


def likely_speeds(speeds: Sequence[Speed]) -> list[Speed]:
    """The speeds of a quick scan: the first, and the likely ones, 2.0 first."""
    found = [speed for speed in speeds if speed == speeds[0] or speed.baud in LIKELY]
    return sorted(found, key=lambda one: (one != speeds[0], PROTOCOLS.index(one.protocol)))


def has_speed(protocol: int, baud: int) -> bool:
    """True if servos of a protocol can be set to `baud` bits/s. In 1.0 it must divide DIVIDED_BAUD within
    DIVIDED_TOLERANCE."""
    if protocol != 1 or baud in BAUDS[protocol]:
        return baud in BAUDS[protocol]
    divisor = round(DIVIDED_BAUD / baud) if baud > 0 else 0
    return 1 <= divisor <= MOST_DIVIDED and abs(DIVIDED_BAUD / divisor - baud) <= DIVIDED_TOLERANCE * baud


def scan_line(
    port: BytePort,
    speeds: Sequence[Speed],
    *,
    ids: Iterable[int] | None = None,
    progress: Callable[[int], object] = lambda done: None,
    on_found: Callable[[Sighting], object] = lambda seen: None,
) -> LineScan:
    """Look for `ids` (None: all) at each speed of an open port. progress: called with the number of finished speeds.
    on_found: called with each servo. Impossible speeds are skipped."""
    expected = None if ids is None else sorted(set(ids))
    return _scan(port, speeds, lambda client: _found(client, expected), progress, on_found)


def scan_likely(
    port: BytePort,
    speeds: Sequence[Speed],
    *,
    ids: Iterable[int] = (),
    progress: Callable[[int], object] = lambda done: None,
    on_found: Callable[[Sighting], object] = lambda seen: None,
) -> LineScan:
    """Scan in seconds: for all that answer a broadcast ping (2.0) or have one of LIKELY_IDS (1.0). ids: others that are
    expected."""
    expected = frozenset(ids)

    def likely(client: OneOff) -> Iterator[FoundServo]:
        if client.protocol == 2:
            yield from client.scan(range(CODECS[2].MOST_MEMBERS + 1), alone=expected)
        else:
            yield from _found(client, sorted(expected.union(LIKELY_IDS)))

    return _scan(port, speeds, likely, progress, on_found)


def _scan(
    port: BytePort,
    speeds: Sequence[Speed],
    look: Callable[[OneOff], Iterator[FoundServo]],
    progress: Callable[[int], object],
    on_found: Callable[[Sighting], object],
) -> LineScan:
    seen: list[Sighting] = []
    tried: list[Speed] = []
    skipped: list[str] = []
    echoes = False
    for done, speed in enumerate(speeds):
        progress(done)
        refused = speed_refused(port, speed.baud)
        if refused:
            skipped.append(f"{speed}: {refused}")
            continue
        tried.append(speed)
        client = OneOff(port, speed.protocol)
        for found in look(client):
            seen.append(_sighting(client, found, speed))
            on_found(seen[-1])
        echoes = echoes or client.echoes > 0
    progress(len(speeds))
    return LineScan(tuple(seen), tuple(tried), tuple(skipped), echoes)


def _found(client: OneOff, expected: Sequence[int] | None) -> Iterator[FoundServo]:
    possible = range(CODECS[client.protocol].MOST_MEMBERS + 1)
    chosen = possible if expected is None else [device for device in expected if device in possible]
    if client.protocol == 2:
        yield from (one for one in client.scan(chosen) if one.id in chosen)
        return
    for device in chosen:
        yield from client.scan([device])


def speed_refused(port: BytePort, baud: int) -> str:
    """Set the speed, bits/s. Return the reason if the adapter refuses it, else ""."""
    try:
        port.set_baud(baud)
    except BusError as refused:
        try:
            port.drop()
        except BusError:
            raise refused from None  # the port itself is gone
        return str(refused)
    return ""


def _sighting(client: OneOff, found: FoundServo, speed: Speed) -> Sighting:
    bare = Sighting(found, speed)
    if not found.alert:
        return bare
    table = bare.table
    if table is None or not table.has("hardware_error_status"):
        return Sighting(found, speed, UNREAD_ERROR)
    try:
        bits = client.read(found.id, table["hardware_error_status"])
    except (NoAnswer, ServoError):
        bits = 0
    return Sighting(found, speed, alert_text(bits) or UNREAD_ERROR)


MOST_ELSEWHERE = 3
"""Bound of the ids that are tried, each with a timeout at every speed."""


def elsewhere_texts(port: BytePort, bus: BusSpec, ids: Sequence[int], named: Mapping[int, str]) -> list[str]:
    """Return texts on the first of `ids` that answer at another speed, with the command that fixes it. named: by id.
    The port is left at the bus's own speed."""
    if not ids:
        return []
    found: dict[int, list[int]] = {}
    for baud in BAUDS[bus.protocol]:
        if baud == bus.baud or speed_refused(port, baud):
            continue
        client = OneOff(port, bus.protocol, retries=0)
        for device in ids[:MOST_ELSEWHERE]:
            answer = client.ping(device)
            if answer is not None and not answer.clash:
                found.setdefault(device, []).append(baud)
    port.set_baud(bus.baud)
    texts = []
    for device, bauds in found.items():
        speeds, fix = " and ".join(map(str, bauds)), setup_command(bus, device, baud=bus.baud)
        name = named.get(device, f"device {device}")
        texts.append(
            f"{name} answers at {speeds} baud, and its bus has {bus.baud}: correct `baud` of the profile, or {fix}"
        )
    return texts


WRITE_TRIES = 3
SPEED_SETTLE = 0.05
"""[s] Time in which a servo changes its speed."""


def write_setting(
    port: BytePort, table: ControlTable, device: int, speed: Speed, setting: Setting
) -> tuple[int, Speed]:
    """Write one value. Return the servo's id and speed afterwards, which the port then has. Raises BusError."""
    register, value = setting
    if register.name not in ("id", "baud_rate"):
        OneOff(port, speed.protocol).write(device, register, value, verify=True)
        return device, speed
    new_id = value if register.name == "id" else device
    rate = baud_of(table, value) if register.name == "baud_rate" else speed.baud
    assert rate is not None
    for _ in range(WRITE_TRIES):
        port.set_baud(speed.baud)
        # The answer comes at the new speed, or is lost. The servo is read below.
        with suppress(NoAnswer):
            OneOff(port, speed.protocol, retries=0).write(device, register, value)
        port.sleep_until(port.now() + SPEED_SETTLE)
        port.set_baud(rate)
        there = OneOff(port, speed.protocol)
        try:
            if there.read(new_id, register) == value:
                return new_id, Speed(speed.protocol, rate)
        except NoAnswer:
            continue
    raise BusError(
        f"the servo does not answer after {register.name} := {value}",
        where=port.name,
        found=f"silence of id {new_id} at {rate} baud",
        then="Find it with `retarget servo scan`",
    )
