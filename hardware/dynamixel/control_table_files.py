"""Reader of the files in `tables/`: models, and layers of register rows that add up to a control table.

`models.tsv` names the layers of each model, in the order in which they apply. A row of `registers.tsv` or `values.tsv`
counts for firmware from `since` to `until`; the first row of a name in a model's layers makes the register, each later
one replaces what it fills in, `none` takes a value away. `name_[1:28]` stands for 28 registers, one after the other; an
initial value `224+` counts up along them.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from hardware.dynamixel.register import Register

LAST_FIRMWARE = 255
"""Highest number that a firmware version register can hold."""
_FOLDER = Path(__file__).parent / "tables"
_NOTHING = "none"


@dataclass(frozen=True)
class ModelRow:
    """One model in one protocol: a row of `models.tsv`."""

    model: str
    protocol: int
    number: int
    usual_firmware: int
    fast_since: int | None
    modes: tuple[int, ...]
    baud_family: str
    layers: tuple[str, ...]


@dataclass(frozen=True)
class LayerRow:
    """What one layer says about one register, for firmware `since` to `until`; `cells` as written, by column."""

    layer: str
    name: str
    since: int
    until: int
    cells: tuple[tuple[str, str], ...]


def rows_of(file: str) -> Iterator[dict[str, str]]:
    """Yield the rows of a file in `tables/` by column, spaces trimmed; lines that begin with # are remarks."""
    with (_FOLDER / file).open(encoding="utf-8", newline="") as stream:
        lines = (line for line in stream if not line.startswith("#"))
        for row in csv.DictReader(lines, delimiter="\t", quoting=csv.QUOTE_NONE, restval=""):
            yield {column: cell.strip() for column, cell in row.items()}


@cache
def model_rows() -> tuple[ModelRow, ...]:
    """Every model, in the order of the file."""
    return tuple(
        ModelRow(
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
def layer_rows() -> dict[str, tuple[LayerRow, ...]]:
    """The rows of every layer, by its name."""
    layers: dict[str, list[LayerRow]] = {}
    for file in ("registers.tsv", "values.tsv"):
        for row in rows_of(file):
            layer, name = row.pop("layer"), row.pop("name")
            since = int(row.pop("since", "") or 0)
            until = int(row.pop("until", "") or LAST_FIRMWARE)
            cells = tuple((column, cell) for column, cell in row.items() if cell)
            layers.setdefault(layer, []).append(LayerRow(layer, name, since, until, cells))
    return {layer: tuple(rows) for layer, rows in layers.items()}


def firmware_starts(model: ModelRow) -> tuple[int, ...]:
    """The firmware versions at which the model's table changes, ascending, 0 the first."""
    starts = {0}
    if model.fast_since is not None:
        starts.add(model.fast_since)
    for row in _rows(model):
        starts.add(row.since)
        if row.until < LAST_FIRMWARE:
            starts.add(row.until + 1)
    return tuple(sorted(starts))


def registers_of(model: ModelRow, firmware: int) -> tuple[Register, ...]:
    """Return the model's registers as `firmware` has them, ascending by address."""
    merged: dict[str, dict[str, str]] = {}
    for row in _rows(model):
        if row.since <= firmware <= row.until:
            merged.setdefault(row.name, {}).update(row.cells)
    merged["model_number"]["initial"] = str(model.number)
    registers = [register for name, cells in merged.items() for register in _registers(name, cells)]
    return tuple(sorted(registers, key=lambda register: register.address))


def _rows(model: ModelRow) -> Iterator[LayerRow]:
    """The rows of a model's layers, in the order in which they apply."""
    for layer in model.layers:
        yield from layer_rows()[layer]


def _registers(name: str, cells: dict[str, str]) -> Iterator[Register]:
    """The registers of one row: one, or as many as the brackets of its name say."""
    stem, _, span = name.partition("[")
    first, last = (int(end) for end in span.rstrip("]").split(":")) if span else (0, 0)
    filled = {column: cell for column, cell in cells.items() if cell != _NOTHING}
    size = int(filled["size"])
    initial = filled.get("initial")
    step = 1 if initial is not None and initial.endswith("+") else 0
    for place, index in enumerate(range(first, last + 1)):
        yield Register(
            name=f"{stem}{index}" if span else stem,
            address=int(filled["address"]) + place * size,
            size=size,
            signed=filled["sign"] != "u",
            writable=filled["access"] == "rw",
            scale=float(filled["scale"]) if "scale" in filled else None,
            unit=filled.get("unit"),
            lowest=_whole(filled.get("lowest")),
            highest=_whole(filled.get("highest")),
            initial=None if initial is None else int(initial.rstrip("+")) + place * step,
            direction_bit=int(filled["sign"].removeprefix("d")) if filled["sign"].startswith("d") else None,
        )


def _whole(cell: str | None) -> int | None:
    """A whole number or None."""
    return None if cell is None else int(cell)
