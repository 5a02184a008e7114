"""Control tables: the registers of a servo model, by protocol and firmware."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

from hardware.errors import HardwareError
from hardware.servo import Layout, find_model


@dataclass(frozen=True)
class Register:
    """`size` bytes at `address`, little-endian. One count is `scale` of the SI `unit`, if any.

    A signed register holds two's complement, or with a `direction_bit` sign and magnitude (older layout: set is
    clockwise, hence negative). bits: meaning of each bit, for errors in another order. lowest, highest: writable range,
    counts. initial: default, counts; None if measured at start.
    """

    name: str
    address: int
    size: int
    signed: bool
    writable: bool
    scale: float | None
    unit: str | None
    lowest: int | None
    highest: int | None
    initial: int | None
    direction_bit: int | None = None
    bits: tuple[int, ...] = ()

    @property
    def end(self) -> int:
        """First address after this register."""
        return self.address + self.size

    @property
    def narrowest(self) -> int:
        """Lowest count that the bytes can hold."""
        if self.direction_bit is not None:
            return 1 - (1 << self.direction_bit)
        return -(1 << (8 * self.size - 1)) if self.signed else 0

    @property
    def widest(self) -> int:
        """Highest count that the bytes can hold."""
        if self.direction_bit is not None:
            return (1 << self.direction_bit) - 1
        return (1 << (8 * self.size - self.signed)) - 1

    def decode(self, data: bytes) -> int:
        """The counts in `data`. Raises ValueError for another length."""
        if len(data) != self.size:
            raise ValueError(f"{self.name} has {self.size} bytes, not {len(data)}")
        if self.bits:
            raw = int.from_bytes(data, "little")
            return sum(1 << bit for place, bit in enumerate(self.bits) if raw >> place & 1)
        if self.direction_bit is None:
            return int.from_bytes(data, "little", signed=self.signed)
        raw = int.from_bytes(data, "little")
        magnitude = raw & self.widest
        return -magnitude if raw >> self.direction_bit & 1 else magnitude

    def encode(self, counts: int) -> bytes:
        """The bytes of `counts`. Raises ValueError beyond the register's width."""
        if not self.narrowest <= counts <= self.widest:
            raise ValueError(f"{self.name} holds {self.narrowest} to {self.widest}, not {counts}")
        if self.bits:
            counts = sum(1 << place for place, bit in enumerate(self.bits) if counts >> bit & 1)
        if self.direction_bit is not None and counts < 0:
            return ((1 << self.direction_bit) - counts).to_bytes(self.size, "little")
        return counts.to_bytes(self.size, "little", signed=self.signed)

    def allows(self, counts: int) -> bool:
        """True if `counts` lies within `lowest` and `highest`."""
        return (self.lowest is None or counts >= self.lowest) and (self.highest is None or counts <= self.highest)


# In `tables/`, `models.tsv` names the layers of each model, in order. A row of `registers.tsv` or `values.tsv`
# applies to firmware from `since` to `until`. The first row of a name makes the register, later ones replace the cells
# that they fill in, and `none` removes a value. `name_[1:28]` stands for 28 adjacent registers, along which an initial
# value `224+` counts up.

LAST_FIRMWARE = 255
"""Highest number that a firmware version register can hold."""
_FOLDER = Path(__file__).parent / "tables"


@dataclass(frozen=True)
class ControlTable:
    """Registers of one model, ascending by address, for firmware `firmware[0]` to `firmware[1]`.

    fast_since: first firmware with Fast Sync Read. usual_firmware: of an emulated servo. baud_family: of the codes of
    the baud rate register. layers: of rows that make the registers, which a row of `models.tsv` lacks.
    """

    model: str
    number: int
    protocol: int
    usual_firmware: int
    fast_since: int | None
    modes: tuple[int, ...]
    baud_family: str
    layers: tuple[str, ...] = ()
    firmware: tuple[int, int] = (0, LAST_FIRMWARE)
    registers: tuple[Register, ...] = ()

    @property
    def fast_read(self) -> bool:
        """True if it supports Fast Sync Read."""
        return self.fast_since is not None and self.firmware[0] >= self.fast_since

    @property
    def eeprom_end(self) -> int:
        """First address of the RAM area, which begins with Torque Enable (e-Manual, all models)."""
        return self["torque_enable"].address if self.has("torque_enable") else self.size

    @property
    def layout(self) -> Layout:
        """Layout with its protocol."""
        return find_model(self.model).layout_in(self.protocol)

    @cached_property
    def size(self) -> int:
        """Bytes from address 0 to the end of the last register."""
        return self.registers[-1].end

    @cached_property
    def _by_name(self) -> dict[str, Register]:
        return {register.name: register for register in self.registers}

    def __getitem__(self, name: str) -> Register:
        register = self._by_name.get(name)
        if register is None:
            raise HardwareError(
                "no such register",
                where=f"{self.model}, protocol {self.protocol}.0, firmware {self.firmware[0]} to {self.firmware[1]}",
                found=repr(name),
                allowed=", ".join(one for one in self._by_name if not one.startswith("indirect_")),
            )
        return register

    def has(self, name: str) -> bool:
        """True if there is a register of that name."""
        return name in self._by_name

    @property
    def p_gain(self) -> Register | None:
        """Register of the position P gain; None without one (AX-12A)."""
        return self._by_name.get("p_gain" if self.layout is Layout.OLDER else "position_p_gain")


def rows_of(file: str) -> Iterator[dict[str, str]]:
    """Yield the rows of a file in `tables/` by column, without remarks (#)."""
    with (_FOLDER / file).open(encoding="utf-8", newline="") as stream:
        lines = (line for line in stream if not line.startswith("#"))
        for row in csv.DictReader(lines, delimiter="\t", quoting=csv.QUOTE_NONE, restval=""):
            yield {column: cell.strip() for column, cell in row.items()}


@cache
def model_rows() -> tuple[ControlTable, ...]:
    """Return every model."""
    return tuple(
        ControlTable(
            model=row["model"],
            protocol=int(row["protocol"]),
            number=int(row["number"]),
            usual_firmware=int(row["usual_firmware"]),
            fast_since=int(row["fast_since"]) if row["fast_since"] else None,
            modes=tuple(int(mode) for mode in row["modes"].split()),
            baud_family=row["baud_family"],
            layers=tuple(row["layers"].split()),
        )
        for row in rows_of("models.tsv")
    )


@cache
def layer_rows() -> dict[str, list[dict[str, str]]]:
    """The rows of every layer: filled cells by column."""
    layers: dict[str, list[dict[str, str]]] = {}
    for file in ("registers.tsv", "values.tsv"):
        for row in rows_of(file):
            cells = {column: cell for column, cell in row.items() if cell}
            layers.setdefault(row["layer"], []).append(cells)
    return layers


def _rows(model: ControlTable) -> Iterator[tuple[int, int, dict[str, str]]]:
    for layer in model.layers:
        for row in layer_rows()[layer]:
            yield int(row.get("since", 0)), int(row.get("until", LAST_FIRMWARE)), row


def firmware_starts(model: ControlTable) -> tuple[int, ...]:
    """The firmware versions at which the table changes, ascending from 0."""
    starts = {0, model.fast_since or 0}
    for since, until, _ in _rows(model):
        starts |= {since, until + 1}
    return tuple(sorted(starts - {LAST_FIRMWARE + 1}))


def registers_of(model: ControlTable, firmware: int) -> tuple[Register, ...]:
    """The registers for `firmware`, ascending by address."""
    merged: dict[str, dict[str, str]] = {}
    for since, until, row in _rows(model):
        if since <= firmware <= until:
            merged.setdefault(row["name"], {}).update(row)
    merged["model_number"]["initial"] = str(model.number)
    registers = [register for cells in merged.values() for register in row_registers(cells)]
    return tuple(sorted(registers, key=lambda register: register.address))


def row_registers(cells: dict[str, str]) -> Iterator[Register]:
    """Yield the registers of one row."""
    stem, _, span = cells["name"].partition("[")
    first, last = (int(end) for end in span.rstrip("]").split(":")) if span else (0, 0)
    filled = {column: cell for column, cell in cells.items() if cell not in ("", "none")}
    size = int(filled["size"])
    initial = filled.get("initial")
    step = 1 if initial is not None and initial.endswith("+") else 0
    kind, numbers = filled["sign"][0], filled["sign"][1:]
    for place, index in enumerate(range(first, last + 1)):
        yield Register(
            name=f"{stem}{index}" if span else stem,
            address=int(filled["address"]) + place * size,
            size=size,
            signed=kind in "sd",
            writable=filled["access"] == "rw",
            scale=float(filled["scale"]) if "scale" in filled else None,
            unit=filled.get("unit"),
            lowest=int(filled["lowest"]) if "lowest" in filled else None,
            highest=int(filled["highest"]) if "highest" in filled else None,
            initial=None if initial is None else int(initial.rstrip("+")) + place * step,
            direction_bit=int(numbers) if kind == "d" else None,
            bits=tuple(map(int, numbers.split(","))) if kind == "b" else (),
        )


def tables() -> tuple[ControlTable, ...]:
    """The table of each model, protocol and range of firmware."""
    return tuple(_table(row, first) for row in model_rows() for first in firmware_starts(row))


def find_table(model: str, protocol: int, firmware: int | None = None) -> ControlTable:
    """The table of a model for `firmware` (0 to 255; None: a usual one). Raises HardwareError for an unknown
    model or protocol."""
    name = find_model(model).name
    rows = {row.protocol: row for row in model_rows() if row.model == name}
    row = rows.get(protocol)
    if row is None:
        raise HardwareError(
            "the model does not speak this protocol",
            where=name,
            found=f"protocol {protocol}.0",
            allowed=", ".join(f"{one}.0" for one in sorted(rows)),
        )
    return _table_at(row, firmware)


def table_of_number(number: int, firmware: int | None = None) -> ControlTable | None:
    """The table of the model that reports `number`, or None."""
    return next((_table_at(row, firmware) for row in model_rows() if row.number == number), None)


def usual_table(protocol: int) -> ControlTable:
    """The most common table of a protocol."""
    return find_table({1: "MX-28", 2: "XM430-W350"}[protocol], protocol)


def _table_at(row: ControlTable, firmware: int | None) -> ControlTable:
    version = row.usual_firmware if firmware is None else firmware
    return _table(row, max(start for start in firmware_starts(row) if start <= max(version, 0)))


@cache
def _table(row: ControlTable, first: int) -> ControlTable:
    later = [start for start in firmware_starts(row) if start > first]
    last = min(later) - 1 if later else LAST_FIRMWARE
    usual = min(max(row.usual_firmware, first), last)
    return replace(row, firmware=(first, last), usual_firmware=usual, registers=registers_of(row, first))


DIVIDED_BAUD = 2_000_000
"""[bits/s] Protocol 1.0: divided by the code of the baud rate register + 1."""
DIVIDED_TOLERANCE = 0.01
"""Relative. A UART tolerates about 3 %, both ends together."""


@cache
def _listed(family: str) -> dict[int, int]:
    rows = rows_of("baud_rates.tsv")
    return {int(row["code"]): int(row["baud"]) for row in rows if family in row["families"].split()}


def baud_of(table: ControlTable, code: int) -> int | None:
    """The nominal bits per second of a code, or None."""
    if not table["baud_rate"].allows(code):
        return None
    listed = _listed(table.baud_family).get(code)
    return round(DIVIDED_BAUD / (code + 1)) if listed is None and table.protocol == 1 else listed


def fastest_baud(table: ControlTable) -> int:
    """The highest speed of a servo with this table, bits/s."""
    register = table["baud_rate"]
    return max(baud_of(table, code) or 0 for code in range((register.highest or 0) + 1))


def code_of(table: ControlTable, baud: int) -> int | None:
    """The code of `baud` bits/s within DIVIDED_TOLERANCE, or None."""
    register = table["baud_rate"]
    for code, listed in _listed(table.baud_family).items():
        if listed == baud and register.allows(code):
            return code
    if table.protocol != 1 or baud <= 0:
        return None
    code = round(DIVIDED_BAUD / baud) - 1
    rate = baud_of(table, code)
    return code if rate is not None and abs(rate - baud) <= DIVIDED_TOLERANCE * baud else None
