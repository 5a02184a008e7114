"""A fault file: what goes wrong on an emulated bus, and when. Strict YAML.

seed: 1
faults:
  - {fault: flip, rate: 0.01}                          # corrupt 1 % of all packets
  - {fault: missing, ids: [5], start: 2, end: 3}       # s since the emulator began
  - {fault: crc_storm, from_cycle: 100, to_cycle: 110} # group reads, from 0
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from retarget.errors import ConfigError, Problem
from retarget.schema import Integer, Name, NotNegative, Number, Positive, Schema, Share, read_model
from retarget.schema_errors import in_our_words, listed, unknown_name
from retarget.strict_yaml import Document, KeyPath
from sim.emulator.fault_state import MAX_FAULTS
from sim.emulator.faults import KEYS, VALUES, Direction, Fault, FaultKind, Unit

Cycle = Annotated[Integer, Field(ge=0)]
Kinds = Literal[
    "drop",
    "flip",
    "duplicate",
    "late",
    "noise",
    "crc_storm",
    "missing",
    "silent_tail",
    "id_clash",
    "short",
    "echo",
    "over_temperature",
    "under_voltage",
    "overload",
    "unplug",
]
Buses = Mapping[str, Collection[int]]
"""The ids on each bus, by the bus's name."""


class FaultEntry(Schema):
    """One fault, as `sim.emulator.faults.Fault`."""

    fault: Kinds
    ids: Annotated[tuple[Annotated[Integer, Field(ge=0, le=253)], ...], Field(min_length=1, max_length=253)] | None = (
        None
    )
    start: NotNegative = 0.0
    end: Positive | None = None
    from_cycle: Cycle = 0
    to_cycle: Cycle | None = None
    rate: Share = 1.0
    of: Literal["packets", "bytes"] = "packets"
    direction: Literal["to_servos", "to_host", "both"] = "both"
    value: Number | None = None
    bus: Name | None = None

    def to_fault(self) -> Fault:
        """The same as the emulator knows it."""
        return Fault(
            FaultKind(self.fault),
            ids=self.ids or (),
            start=self.start,
            end=math.inf if self.end is None else self.end,
            from_cycle=self.from_cycle,
            to_cycle=self.to_cycle,
            rate=self.rate,
            unit=Unit(self.of),
            direction=Direction(self.direction),
            value=self.value,
            bus=self.bus,
        )


class FaultFile(Schema):
    """Faults, and the seed of all chance in them."""

    seed: Annotated[Integer, Field(ge=0)] = 0
    faults: Annotated[tuple[FaultEntry, ...], Field(max_length=MAX_FAULTS)]


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Faults of a whole robot, and the seed of all chance in them."""

    faults: tuple[Fault, ...] = ()
    seed: int = 0

    def of_bus(self, name: str) -> tuple[Fault, ...]:
        """Those of one bus."""
        return tuple(fault for fault in self.faults if fault.bus in (None, name))


def load_fault_plan(path: Path, buses: Buses) -> FaultPlan:
    """Read a fault file for a robot with these buses. Raises ConfigError with all its problems."""
    model, _ = read_model(FaultFile, path, check=lambda _, document: _problems(document, buses))
    return FaultPlan(tuple(entry.to_fault() for entry in model.faults), model.seed)


def read_fault(document: Document, buses: Buses) -> Fault:
    """The only fault of a document whose top level is one entry. Raises ConfigError with all its problems."""
    try:
        entry = FaultEntry.model_validate(document.data)
    except ValidationError as error:
        raise ConfigError.from_problems(in_our_words(FaultEntry, error, document)) from None
    problems = _entry_problems(entry, document, (), buses)
    if problems:
        raise ConfigError.from_problems(problems)
    return entry.to_fault()


def _problems(document: Document, buses: Buses) -> list[Problem]:
    """Cross checks of every entry that is sound by itself."""
    entries = document.data.get("faults")
    problems: list[Problem] = []
    for index, data in enumerate(entries if isinstance(entries, list) else []):
        try:
            entry = FaultEntry.model_validate(data)
        except ValidationError:
            continue
        problems += _entry_problems(entry, document, ("faults", index), buses)
    return problems


def _entry_problems(entry: FaultEntry, document: Document, at: KeyPath, buses: Buses) -> list[Problem]:
    kind = FaultKind(entry.fault)
    problems = [
        document.problem(
            (*at, key),
            f"{kind.value} has no such key",
            found=key,
            allowed=", ".join(sorted(KEYS[kind])),
            next_step="Remove the key",
        )
        for key in sorted(entry.model_fields_set - KEYS[kind] - {"fault"})
    ]
    if entry.end is not None and entry.end <= entry.start:
        problems.append(
            document.problem(
                (*at, "end"), "a fault ends before it begins", found=f"{entry.end:g}", allowed=f"above {entry.start:g}"
            )
        )
    if entry.to_cycle is not None and entry.to_cycle <= entry.from_cycle:
        allowed = f"above {entry.from_cycle}"
        found = f"{entry.to_cycle}"
        problems.append(
            document.problem((*at, "to_cycle"), "a fault ends before it begins", found=found, allowed=allowed)
        )
    if entry.value is not None and kind in VALUES:
        _, low, high = VALUES[kind]
        if not low <= entry.value <= high:
            allowed = f"{low:g} to {high:g}"
            problems.append(
                document.problem((*at, "value"), "a value out of range", found=f"{entry.value:g}", allowed=allowed)
            )
    return problems + _places(entry, document, at, buses)


def _places(entry: FaultEntry, document: Document, at: KeyPath, buses: Buses) -> list[Problem]:
    """A bus and ids that do not exist."""
    if entry.bus is not None and entry.bus not in buses:
        return [unknown_name(document, (*at, "bus"), "bus", entry.bus, buses)]
    known = {device for name, ids in buses.items() if entry.bus in (None, name) for device in ids}
    return [
        document.problem((*at, "ids"), "no such device", found=str(device), allowed=listed(map(str, sorted(known))))
        for device in entry.ids or ()
        if device not in known
    ]
