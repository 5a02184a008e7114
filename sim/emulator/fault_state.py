"""The faults of a line: the fault file, active faults, their effects on packets and devices, typed faults."""

import math
import random
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from retarget.errors import ConfigError, Problem, UsageError, suggest
from retarget.schema.strict_models import Integer, Schema, listed, read_model, unknown_name, validated
from retarget.schema.strict_yaml import Document, KeyPath, Node, scan
from sim.emulator.device import Device
from sim.emulator.faults import BYTE_KINDS, KEYS, VALUES, DelayedBytes, Direction, Fault, FaultKind, mangled
from sim.imu import Ailment

MAX_FAULTS = 1000
"""Most faults of a line."""

Effects = dict[tuple[FaultKind, int], float]
"""Effects on devices: (kind, index of the device) -> value."""


class FaultState:
    """Faults of one line. `now` is s of the line's clock. Call `update` before all else.

    missing, silent_tail, clashing: ids with these faults. dead: no bytes pass. unplugged: the host's adapter is gone.
    spoil: `to_host` may change bytes.
    """

    def __init__(
        self, devices: Sequence[Device], *, faults: Iterable[Fault] = (), origin: float = 0.0, seed: int | str = 0
    ) -> None:
        """origin: s of the clock from which the times of the faults count."""
        self._devices = tuple(devices)
        self._faults = list(faults)
        self._origin = origin
        self._chance = random.Random(seed)
        self._cycle = -1
        self.active: tuple[Fault, ...] = ()
        self._effects: Effects = {}
        self._now = origin  # [s] time never goes back for devices
        self._until = -math.inf  # [s] when a fault begins or ends by time
        self._reset()

    def _reset(self) -> None:
        self.missing = self._ids(FaultKind.MISSING)
        self.silent_tail = self._ids(FaultKind.SILENT_TAIL)
        self.clashing = self._ids(FaultKind.ID_CLASH)
        self._garbage = [int(fault.amount) for fault in self.active if fault.kind is FaultKind.SHORT]
        self.dead = bool(self._garbage)
        self.echo, self.unplugged = (
            any(fault.kind is kind for fault in self.active) for kind in (FaultKind.ECHO, FaultKind.UNPLUG)
        )
        hits = [fault for fault in self.active if fault.kind in BYTE_KINDS]
        self._inbound = [
            fault
            for fault in hits
            if fault.direction is not Direction.TO_HOST and fault.kind is not FaultKind.CRC_STORM and not fault.ids
        ]
        self._outbound = [fault for fault in hits if fault.direction is not Direction.TO_SERVOS]
        self.spoil = bool(self._outbound or self.clashing)

    @property
    def next_change(self) -> float | None:
        """Time of the next begin or end of a fault, s of the clock; None: never."""
        return self._until if math.isfinite(self._until) else None

    def count_cycle(self) -> None:
        """Note that a group read is about to be answered."""
        self._cycle += 1
        if any(fault.by_cycle for fault in self._faults):
            self._until = -math.inf

    def add(self, fault: Fault, now: float) -> bool:
        """Add one whose times count from `now`; False: there are too many already."""
        if len(self._faults) >= MAX_FAULTS:
            return False
        since = max(now, self._now) - self._origin
        self._faults.append(fault.model_copy(update={"start": fault.start + since, "end": fault.end + since}))
        self._until = -math.inf
        self.update(now)
        return True

    def clear(self, now: float, kind: FaultKind | None = None) -> None:
        """Remove all faults, or those of one kind. Errors that devices have latched remain."""
        self._faults = [] if kind is None else [fault for fault in self._faults if fault.kind is not kind]
        self._until = -math.inf
        self.update(now)

    def update(self, now: float) -> None:
        """Begin and end the faults that are due by `now`."""
        self._now = now = max(now, self._now)
        if now < self._until:
            return
        time = now - self._origin
        cycle = max(self._cycle, 0)
        active = tuple(fault for fault in self._faults if fault.lasts(time, cycle))
        edges = [edge for fault in self._faults for edge in (fault.start, fault.end) if edge > time]
        self._until = self._origin + min(edges, default=math.inf)
        if active == self.active:
            return
        self.active = active
        self._reset()
        before = self._effects
        self._effects = {
            (fault.kind, index): fault.amount if fault.kind in VALUES else 1.0
            for fault in active
            if fault.kind in _EFFECTS
            for index, device in enumerate(self._devices)
            if not fault.ids or device.id in fault.ids
        }
        for kind, index in sorted(before.keys() | self._effects.keys(), key=lambda key: (key[0].value, key[1])):
            value_now = self._effects.get((kind, index))
            if value_now != before.get((kind, index)):
                _EFFECTS[kind](self._devices[index], value_now, now)

    def garbage(self) -> bytes:
        """The bytes that the host receives from a dead line after a packet of its own."""
        return self._chance.randbytes(max(self._garbage))

    def to_servos(self, packet: bytes) -> list[DelayedBytes]:
        """The bytes that devices receive of a packet of the host."""
        return mangled(packet, self._inbound, self._chance)

    def to_host(self, device: int, packet: bytes) -> list[DelayedBytes]:
        """The bytes that the host receives of a packet of a device."""
        if device in self.clashing:
            packet = self._chance.randbytes(len(packet))
        hits = [fault for fault in self._outbound if not fault.ids or device in fault.ids]
        return mangled(packet, hits, self._chance)

    def _ids(self, kind: FaultKind) -> frozenset[int]:
        hit = [fault for fault in self.active if fault.kind is kind]
        return frozenset(own for fault in hit for own in fault.ids or [device.id for device in self._devices])


_EFFECTS: dict[FaultKind, Callable[[Device, float | None, float], None]] = {
    FaultKind.OVER_TEMPERATURE: lambda device, value, now: device.heat(value, now),
    FaultKind.UNDER_VOLTAGE: lambda device, value, now: device.supply(value, now),
    FaultKind.OVERLOAD: lambda device, value, now: device.jam(value is not None, now),
    FaultKind.CURRENT_STUCK: lambda device, value, now: device.hold_current(value is not None, now),
    FaultKind.IMU_FROZEN: lambda device, value, now: device.sense(None if value is None else Ailment.FROZEN, now),
    FaultKind.IMU_SWAPPED: lambda device, value, now: device.sense(None if value is None else Ailment.SWAPPED, now),
    FaultKind.IMU_SPIKES: lambda device, value, now: device.sense(None if value is None else Ailment.SPIKES, now),
}
"""The begin of a fault of a kind on a device with its value, or (None) its end."""


# A fault file: the faults of an emulated bus, and their times. Strict YAML.
#
# seed: 1
# faults:
#   - {fault: flip, rate: 0.01}                          # corrupt 1 % of all packets
#   - {fault: missing, ids: [5], start: 2, end: 3}       # s since the emulator began
#   - {fault: crc_storm, from_cycle: 100, to_cycle: 110} # group reads, from 0

Buses = Mapping[str, Collection[int]]
"""The ids on each bus, by the bus's name."""


class FaultPlan(Schema):
    """Faults of a whole robot, and the seed of all chance in them: a fault file."""

    seed: Annotated[Integer, Field(ge=0)] = 0
    faults: Annotated[tuple[Fault, ...], Field(max_length=MAX_FAULTS)]

    def of_bus(self, name: str) -> tuple[Fault, ...]:
        """The faults of one bus."""
        return tuple(fault for fault in self.faults if fault.bus in (None, name))


EVERY_KIND = frozenset(FaultKind)
"""Faults of a line whose servos turn their shafts themselves."""


def load_fault_plan(path: Path, buses: Buses, *, kinds: Collection[FaultKind] = EVERY_KIND) -> FaultPlan:
    """Read a fault file for a robot with these buses. kinds: those that can be played. Raises ConfigError."""
    return read_model(FaultPlan, path, check=lambda _, document: _problems(document, buses, kinds))


def _problems(document: Document, buses: Buses, kinds: Collection[FaultKind] = EVERY_KIND) -> list[Problem]:
    """The problems of entries that are valid by themselves."""
    entries = document.data.get("faults")
    problems: list[Problem] = []
    for index, data in enumerate(entries if isinstance(entries, list) else []):
        with suppress(ValidationError):
            entry, at = Fault.model_validate(data), ("faults", index)
            problems += _entry_problems(entry, document, at, buses)
            if entry.kind not in kinds:
                allowed = ", ".join(kind.value for kind in FaultKind if kind in kinds)
                what = "a fault that this bus cannot play"
                problems.append(document.problem((*at, "fault"), what, found=entry.kind.value, allowed=allowed))
    return problems


def _entry_problems(entry: Fault, document: Document, at: KeyPath, buses: Buses) -> list[Problem]:
    def wrong(key: str, what: str, found: str, allowed: str, next_step: str = "") -> Problem:
        return document.problem((*at, key), what, found=found, allowed=allowed, next_step=next_step)

    kind, known = entry.kind, KEYS[entry.kind]
    problems = [
        wrong(key, f"{kind.value} has no such key", key, ", ".join(sorted(known)), "Remove the key")
        for key in sorted(entry.model_fields_set - known - {"kind"})
    ]
    for key, begin, end in (("end", entry.start, entry.end), ("to_cycle", entry.from_cycle, entry.to_cycle)):
        if end is not None and end <= begin:
            problems.append(wrong(key, "a fault ends before it begins", f"{end:g}", f"above {begin:g}"))
    if entry.value is not None and kind in VALUES:
        _, low, high = VALUES[kind]
        if not low <= entry.value <= high:
            problems.append(wrong("value", "a value out of range", f"{entry.value:g}", f"{low:g} to {high:g}"))
    if entry.bus is not None and entry.bus not in buses:
        return [*problems, unknown_name(document, (*at, "bus"), "bus", entry.bus, buses)]
    devices = {device for name, ids in buses.items() if entry.bus in (None, name) for device in ids}
    return problems + [
        wrong("ids", "no such device", str(device), listed(map(str, sorted(devices))))
        for device in entry.ids
        if device not in devices
    ]


# Faults from a keyboard: one line of words, one change.

HELP = (
    "NAME [ID ...] [KEY=VALUE ...] begins a fault (missing 5; flip rate=0.01; unplug end=2), times counted from now; "
    "clear [NAME] ends them; list shows them. Names: " + ", ".join(kind.value for kind in FaultKind)
)
MAX_LINE = 1000
"""Longest line that is read, characters."""


def obey(line: str, states: dict[str, FaultState], buses: Buses, now: Callable[[], float]) -> str:
    """Carry out one line on the faults of all buses (by name); return the reply. Bad words do not raise."""
    words = line[:MAX_LINE].split()
    if not words:
        return ""
    try:
        match words:
            case ["help" | "?"]:
                return HELP
            case ["list"]:
                active = [(name, fault) for name, state in states.items() for fault in state.active]
                shown = [" ".join([f"{name}: {fault.kind.value}", *map(str, fault.ids)]) for name, fault in active]
                return "\n".join(shown) or "no fault"
            case ["clear", *rest]:
                kinds: list[FaultKind | None] = [_kind(word) for word in rest]
                for state in states.values():
                    for kind in kinds or [None]:
                        state.clear(now(), kind)
                return f"cleared {' '.join(rest) or 'all faults'}"
        kind = _kind(words[0])
        keys, ids = ([word for word in words[1:] if ("=" in word) is key] for key in (True, False))
        data: dict[str, Node] = {"fault": kind.value}
        data |= {"ids": [_scalar(word) for word in ids]} if ids else {}
        data |= {key: _scalar(text) for key, _, text in (word.partition("=") for word in keys)}
        entry = Document(Path("faults"), {"faults": [data]}, {})
        (fault,) = validated(FaultPlan, entry, check=lambda _, document: _problems(document, buses)).faults
        known = {name: set(buses[name]) for name in states if fault.bus in (None, name)}
        meant = [name for name, own in known.items() if set(fault.ids or own) & own]
        if not all(states[name].add(fault, now()) for name in meant):
            return "too many faults; type clear first"
        return f"{' '.join(words)}: begun"
    except (ConfigError, UsageError) as error:
        return f"{error} Type help for help."


def _kind(word: str) -> FaultKind:
    names = [kind.value for kind in FaultKind]
    if word not in names:
        raise UsageError("unknown fault", found=repr(word), allowed=", ".join(names), next_step=suggest(word, names))
    return FaultKind(word)


def _scalar(text: str) -> Node:
    return scan(f"value: {text}", Path("faults")).data["value"] if text.isascii() else text
