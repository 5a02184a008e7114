"""Faults of an emulated line as data, and their effect on the bytes of a packet."""

import math
import random
from collections.abc import Sequence
from enum import Enum
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from retarget.arithmetic import exp, log
from retarget.schema.strict_models import Integer, Name, NotNegative, Number, Positive, Schema, Share


class FaultKind(Enum):
    """Kinds of fault (`docs/emulator.md`). A packet is an instruction, a status, or a device's part of a fast reply."""

    DROP = "drop"
    FLIP = "flip"
    DUPLICATE = "duplicate"
    LATE = "late"
    """Packets, or the rest of a packet after a byte, are `value` s late, and all that follows."""
    NOISE = "noise"
    """Up to `value` random bytes precede packets."""
    CRC_STORM = "crc_storm"
    """The CRC or checksum of devices is wrong."""
    MISSING = "missing"
    SILENT_TAIL = "silent_tail"
    """Devices do not answer group reads, nor do those behind them."""
    ID_CLASH = "id_clash"
    """A second device has the same id: both answer at once, which cannot be decoded."""
    SHORT = "short"
    """No bytes pass; the host receives `value` random bytes for each of its packets."""
    ECHO = "echo"
    OVER_TEMPERATURE = "over_temperature"
    UNDER_VOLTAGE = "under_voltage"
    """The supply of devices is `value` V; a very low one resets them."""
    OVERLOAD = "overload"
    """Shafts are blocked: a servo that moves overloads."""
    UNPLUG = "unplug"
    IMU_FROZEN = "imu_frozen"
    IMU_SWAPPED = "imu_swapped"
    IMU_SPIKES = "imu_spikes"
    CURRENT_STUCK = "current_stuck"


class Direction(Enum):
    """Direction of the changed bytes."""

    TO_SERVOS = "to_servos"
    TO_HOST = "to_host"
    BOTH = "both"


class Unit(Enum):
    """The unit that `rate` counts."""

    PACKETS = "packets"
    BYTES = "bytes"


BYTE_KINDS = frozenset(
    (FaultKind.DROP, FaultKind.FLIP, FaultKind.DUPLICATE, FaultKind.LATE, FaultKind.NOISE, FaultKind.CRC_STORM)
)
"""Kinds that change bytes on the wire, and have a rate."""

VALUES: dict[FaultKind, tuple[float, float, float]] = {
    FaultKind.LATE: (0.005, 0.0, 10.0),
    FaultKind.NOISE: (8.0, 1.0, 4096.0),
    FaultKind.SHORT: (0.0, 0.0, 4096.0),
    FaultKind.OVER_TEMPERATURE: (90.0, -40.0, 200.0),
    FaultKind.UNDER_VOLTAGE: (3.0, 0.0, 40.0),
}
"""Kinds with a `value`: its default, the lowest and the highest."""

KEYS: dict[FaultKind, frozenset[str]] = {
    kind: frozenset(("start", "end", "from_cycle", "to_cycle", "bus"))
    | (frozenset(("value",)) if kind in VALUES else frozenset())
    | (frozenset(("rate", "of", "direction")) if kind in BYTE_KINDS - {FaultKind.CRC_STORM} else frozenset())
    | (frozenset(("rate",)) if kind is FaultKind.CRC_STORM else frozenset())
    | (frozenset(("ids",)) if kind not in (FaultKind.SHORT, FaultKind.ECHO, FaultKind.UNPLUG) else frozenset())
    for kind in FaultKind
}
"""Keys of each kind."""
Cycle = Annotated[Integer, Field(ge=0)]


class Fault(Schema):
    """One fault, an entry of a fault file. It lasts inside both windows: time since the line began, s, from `start` to
    before `end`, and group reads received, from 0, from `from_cycle` to before `to_cycle`.

    ids: of the devices; none: all. Faults with ids do not change bytes to the servos, which belong to no device. rate:
    share of the units `of`. value: None: the default. bus: name of its only line; None: all. Raises ValidationError.
    """

    kind: FaultKind = Field(alias="fault")
    ids: Annotated[tuple[Annotated[Integer, Field(ge=0, le=253)], ...], Field(min_length=1, max_length=253)] = ()
    start: NotNegative = 0.0
    end: Positive = math.inf
    from_cycle: Cycle = 0
    to_cycle: Cycle | None = None
    rate: Share = 1.0
    of: Unit = Unit.PACKETS
    direction: Direction = Direction.BOTH
    value: Number | None = None
    bus: Name | None = None

    def __init__(self, *kind: FaultKind, **values: Any) -> None:
        """Take `kind` first, or as the key `fault`."""
        super().__init__(**values, **({"fault": kind[0]} if kind else {}))

    @property
    def amount(self) -> float:
        """The value, or the default of the kind."""
        return VALUES[self.kind][0] if self.value is None else self.value

    @property
    def by_cycle(self) -> bool:
        """True if a count of cycles begins or ends it."""
        return self.from_cycle > 0 or self.to_cycle is not None

    def lasts(self, time: float, cycle: int) -> bool:
        """Return whether it is active, `time` s after the line began, in that cycle."""
        within = self.from_cycle <= cycle and (self.to_cycle is None or cycle < self.to_cycle)
        return within and self.start <= time < self.end


MEASURED_KINDS = frozenset((FaultKind.IMU_FROZEN, FaultKind.IMU_SWAPPED, FaultKind.IMU_SPIKES, FaultKind.CURRENT_STUCK))
"""Faults of the measurements of a device that answers."""
RANDOM_KINDS = tuple(kind for kind in FaultKind if kind not in MEASURED_KINDS)
"""Kinds of random faults: those that every line can have."""
RATES = (1e-3, 1e-1)
"""Shares of bytes that a random fault damages, drawn with uniform logarithms."""


def random_faults(seed: int, ids: Sequence[int], duration: float) -> tuple[Fault, ...]:
    """Draw three to eight faults within `duration` s, each for at most a fifth of it."""
    chance = random.Random(seed)
    faults = []
    for _ in range(chance.randint(3, 8)):
        kind = chance.choice(RANDOM_KINDS)
        start = chance.uniform(0.0, 0.8 * duration)
        some = tuple(sorted(chance.sample(list(ids), min(len(ids), chance.randint(1, 2)))))
        own: dict[str, Any] = {"end": start + chance.uniform(0.0, 0.2 * duration)}
        if kind in BYTE_KINDS:
            own["rate"] = exp(chance.uniform(log(RATES[0]), log(RATES[1])))
        elif "ids" in KEYS[kind]:
            own["ids"] = some
        faults.append(Fault(kind, start=start, **own))
    return tuple(faults)


class DelayedBytes(NamedTuple):
    """Bytes of a packet that arrive `delay` s after those before them."""

    delay: float
    data: bytes


def mangled(packet: bytes, faults: Sequence[Fault], chance: random.Random) -> list[DelayedBytes]:
    """The parts of a packet after faults of BYTE_KINDS, in their order; none: it is lost. Those that double act last,
    so that they repeat the damage of the others."""
    parts = [DelayedBytes(0.0, packet)]
    for fault in sorted(faults, key=lambda one: one.kind is FaultKind.DUPLICATE):
        parts = [new for part in parts for new in _hit(part, fault, chance, last=packet[-1])]
    return parts


def _hit(part: DelayedBytes, fault: Fault, chance: random.Random, *, last: int) -> list[DelayedBytes]:
    """Apply a fault to a packet or to each of its bytes. last: its last byte as sent; two storms change it as one."""
    whole = fault.of is Unit.PACKETS
    out: list[DelayedBytes] = []
    delay, done = part.delay, b""
    for unit in [part.data] if whole else [bytes((byte,)) for byte in part.data]:
        hit = unit
        if chance.random() < fault.rate:
            match fault.kind:
                case FaultKind.DROP:
                    hit = b""
                case FaultKind.FLIP:
                    at = chance.randrange(len(unit)) if whole else 0
                    hit = unit[:at] + bytes((unit[at] ^ 1 << chance.randrange(8),)) + unit[at + 1 :]
                case FaultKind.DUPLICATE:
                    hit = unit + unit
                case FaultKind.NOISE:
                    hit = chance.randbytes(chance.randint(1, int(fault.amount))) + unit
                case FaultKind.CRC_STORM:
                    hit = unit[:-1] + bytes((last ^ 0xFF,))
                case FaultKind.LATE:
                    out += [DelayedBytes(delay, done)] if done else []
                    delay, done = fault.amount if done else delay + fault.amount, b""
        done += hit
    return [one for one in (*out, DelayedBytes(delay, done)) if one.data]
