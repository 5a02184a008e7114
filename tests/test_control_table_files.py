"""The files in `tables/`: every row is used, every cell is readable, every firmware has a table."""

import pytest

from hardware.dynamixel.control_table_files import (
    LAST_FIRMWARE,
    ModelRow,
    firmware_starts,
    layer_rows,
    model_rows,
    registers_of,
    rows_of,
)

COLUMNS = {"address", "size", "sign", "access", "scale", "unit", "lowest", "highest", "initial"}


def test_every_layer_is_used_and_every_used_layer_exists() -> None:
    used = {layer for model in model_rows() for layer in model.layers}
    assert used == set(layer_rows())


@pytest.mark.parametrize("model", model_rows(), ids=lambda row: f"{row.model}-{row.protocol}")
def test_every_row_of_a_model_has_an_effect(model: ModelRow) -> None:
    """A row that changes a register which nobody made is a misspelt name."""
    made: set[str] = set()
    for layer in model.layers:
        for row in layer_rows()[layer]:
            cells = dict(row.cells)
            assert cells, (layer, row.name)
            assert set(cells) <= COLUMNS
            assert ("address" in cells) == ("size" in cells) == ("sign" in cells and "access" in cells)
            assert 0 <= row.since <= row.until <= LAST_FIRMWARE
            if "address" in cells:
                made.add(row.name)
            assert row.name in made, f"{layer}: {row.name} changes a register that does not exist"


def test_cells_hold_what_their_columns_allow() -> None:
    for file in ("registers.tsv", "values.tsv"):
        for row in rows_of(file):
            assert None not in row, f"{file}: a row with too many cells: {row}"
            assert row.get("access", "") in {"", "r", "rw"}
            assert row.get("sign", "") in {"", "u", "s", "d10"}
            assert bool(row.get("scale")) == bool(row.get("unit"))
            for column in ("address", "size", "lowest", "highest", "initial", "since", "until"):
                cell = row.get(column, "").removesuffix("+")
                assert cell in {"", "none"} or int(cell) is not None


def test_spans_become_numbered_registers() -> None:
    model = next(row for row in model_rows() if row.model == "XM430-W350")
    found = {one.name: one for one in registers_of(model, 52)}
    assert [found[f"indirect_address_{n}"].address for n in (1, 2, 28, 29, 56)] == [168, 170, 222, 578, 632]
    assert [found[f"indirect_address_{n}"].initial for n in (1, 28, 29, 56)] == [224, 251, 634, 661]
    assert [found[f"indirect_data_{n}"].address for n in (1, 28, 29, 56)] == [224, 251, 634, 661]
    assert {found[f"indirect_data_{n}"].initial for n in range(1, 57)} == {0}


@pytest.mark.parametrize("model", model_rows(), ids=lambda row: f"{row.model}-{row.protocol}")
def test_a_table_changes_only_at_its_starts(model: ModelRow) -> None:
    starts = firmware_starts(model)
    assert starts[0] == 0
    assert list(starts) == sorted(set(starts))
    for before in range(LAST_FIRMWARE):
        if before + 1 not in starts and before % 9 == 0:
            assert registers_of(model, before) == registers_of(model, before + 1)
    assert 0 <= model.usual_firmware <= LAST_FIRMWARE
