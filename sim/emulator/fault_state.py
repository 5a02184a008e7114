"""Which faults a line has right now: a plan, what was added live, and what they do to packets and devices."""

import math
import random
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Protocol, cast

from sim.emulator.device import Device, Faulty
from sim.emulator.faults import BYTE_KINDS, Direction, Fault, FaultKind
from sim.emulator.mangle import Part, mangled

MAX_FAULTS = 1000
"""Most faults that a line keeps; further ones are refused."""

Hurt = dict[tuple[FaultKind, int], float]
"""What is done to devices: (kind, index of the device) -> value."""


class FaultyDevice(Device, Faulty, Protocol):
    """A device with the handles of a fault plan."""


class FaultState:
    """Faults of one line. `update` before anything else is asked; all chance comes from one seeded generator."""

    def __init__(
        self, devices: Sequence[Device], *, faults: Iterable[Fault] = (), origin: float = 0.0, seed: int | str = 0
    ) -> None:
        """origin: s of the clock from which the faults' times count."""
        self._devices = tuple(devices)
        self._faults = list(faults)
        self._origin = origin
        self._chance = random.Random(seed)
        self._cycle = -1
        self._active: tuple[Fault, ...] = ()
        self._hurt: Hurt = {}
        self._now = origin  # [s] devices never see time go back
        self._until = -math.inf  # [s] when what is present changes by time
        self._by_cycle = False
        self._look_again()
        self._reset()

    def _reset(self) -> None:
        self.missing = self._ids(FaultKind.MISSING)
        """Ids that neither hear nor answer."""
        self.silent_tail = self._ids(FaultKind.SILENT_TAIL)
        """Ids that say nothing in group reads."""
        self.clashing = self._ids(FaultKind.ID_CLASH)
        """Ids that two devices have."""
        kinds = {fault.kind for fault in self._active}
        self.dead = FaultKind.SHORT in kinds
        """Whether nobody hears anybody."""
        self._garbage = max((int(fault.amount) for fault in self._active if fault.kind is FaultKind.SHORT), default=0)
        self.echo = FaultKind.ECHO in kinds
        """Whether the host hears itself."""
        self.unplugged = FaultKind.UNPLUG in kinds
        """Whether the host's adapter is gone."""
        hits = [fault for fault in self._active if fault.kind in BYTE_KINDS]
        self._on_way_in = [
            fault
            for fault in hits
            if fault.direction is not Direction.TO_HOST and fault.kind is not FaultKind.CRC_STORM and not fault.ids
        ]
        self._on_way_out = [fault for fault in hits if fault.direction is not Direction.TO_SERVOS]
        self.spoil = bool(self._on_way_out or self.clashing)
        """Whether `to_host` may change anything."""

    @property
    def active(self) -> tuple[Fault, ...]:
        """Those that are present."""
        return self._active

    @property
    def next_change(self) -> float | None:
        """When a fault begins or ends by time, s of the clock; None: never."""
        return self._until if math.isfinite(self._until) else None

    def count_cycle(self) -> None:
        """Note that a group read is about to be answered."""
        self._cycle += 1
        if self._by_cycle:
            self._until = -math.inf

    def add(self, fault: Fault, now: float) -> bool:
        """Add one whose times count from `now`; False: there are too many already."""
        if len(self._faults) >= MAX_FAULTS:
            return False
        since = max(now, self._now) - self._origin
        self._faults.append(replace(fault, start=fault.start + since, end=fault.end + since))
        self._look_again()
        self.update(now)
        return True

    def clear(self, now: float, kind: FaultKind | None = None) -> None:
        """Forget all faults, or those of one kind; what they did to devices ends, what devices latched stays."""
        self._faults = [] if kind is None else [fault for fault in self._faults if fault.kind is not kind]
        self._look_again()
        self.update(now)

    def update(self, now: float) -> None:
        """Begin and end what is due by `now`."""
        self._now = now = max(now, self._now)
        if now < self._until:
            return
        time = now - self._origin
        cycle = max(self._cycle, 0)
        active = tuple(fault for fault in self._faults if fault.lasts(time, cycle))
        edges = [edge for fault in self._faults for edge in (fault.start, fault.end) if edge > time]
        self._until = self._origin + min(edges, default=math.inf)
        if active != self._active:
            self._active = active
            self._reset()
            self._hurt_devices(now)

    def garbage(self) -> bytes:
        """What the host hears of a dead line when it has sent a packet."""
        return self._chance.randbytes(self._garbage)

    def to_servos(self, packet: bytes) -> list[Part]:
        """What the devices get of bytes that the host sends."""
        return mangled(packet, self._on_way_in, self._chance) if self._on_way_in else [Part(0.0, packet)]

    def to_host(self, device: int, packet: bytes) -> list[Part]:
        """What the host gets of what a device says."""
        if device in self.clashing:
            packet = self._chance.randbytes(len(packet))
        hits = [fault for fault in self._on_way_out if not fault.ids or device in fault.ids]
        return mangled(packet, hits, self._chance) if hits else [Part(0.0, packet)]

    def _look_again(self) -> None:
        """The list of faults has changed."""
        self._until = -math.inf
        self._by_cycle = any(fault.by_cycle for fault in self._faults)

    def _ids(self, kind: FaultKind) -> frozenset[int]:
        """Ids of the present faults of a kind."""
        ids: set[int] = set()
        for fault in self._active:
            if fault.kind is kind:
                ids |= set(fault.ids) or {device.id for device in self._devices}
        return frozenset(ids)

    def _hurt_devices(self, now: float) -> None:
        """Do to devices what has begun, undo what has ended."""
        before, self._hurt = self._hurt, {}
        for fault in self._active:
            if fault.kind in _HANDLES:
                value = 1.0 if fault.kind is FaultKind.OVERLOAD else fault.amount
                for index, device in enumerate(self._devices):
                    if not fault.ids or device.id in fault.ids:
                        self._hurt[fault.kind, index] = value
        for kind, index in sorted(before.keys() | self._hurt.keys(), key=lambda key: (key[0].value, key[1])):
            value_now = self._hurt.get((kind, index))
            if value_now != before.get((kind, index)):
                _handle(cast(FaultyDevice, self._devices[index]), kind, value_now, now)


_HANDLES = frozenset((FaultKind.OVER_TEMPERATURE, FaultKind.UNDER_VOLTAGE, FaultKind.OVERLOAD))


def _handle(device: FaultyDevice, kind: FaultKind, value: float | None, now: float) -> None:
    """Hurt a device, or (None) let it be."""
    if kind is FaultKind.OVER_TEMPERATURE:
        device.heat(value, now)
    elif kind is FaultKind.UNDER_VOLTAGE:
        device.supply(value, now)
    else:
        device.jam(value is not None, now)
