"""Codes of the baud rate register <-> bits per second, by the table's family."""

from functools import cache

from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.control_table_files import rows_of

_DIVIDED = 2_000_000  # [bits/s] protocol 1.0: divided by code + 1
_TOLERANCE = 0.01  # of the rate; a UART stands about 3 %, both ends together


@cache
def _listed(family: str) -> dict[int, int]:
    """Bits per second by code, as the maker lists them for one family."""
    rows = rows_of("baud_rates.tsv")
    return {int(row["code"]): int(row["baud"]) for row in rows if family in row["families"].split()}


def baud_of(table: ControlTable, code: int) -> int | None:
    """Return the nominal bits per second of a code, None for a code that the model does not have."""
    if not table["baud_rate"].allows(code):
        return None
    listed = _listed(table.baud_family).get(code)
    return round(_DIVIDED / (code + 1)) if listed is None and table.protocol == 1 else listed


def code_of(table: ControlTable, baud: int) -> int | None:
    """Return the code whose rate is `baud` bits/s, in protocol 1.0 to 1 %; None for a rate that the model lacks."""
    register = table["baud_rate"]
    for code, listed in _listed(table.baud_family).items():
        if listed == baud and register.allows(code):
            return code
    if table.protocol != 1 or baud <= 0:
        return None
    code = round(_DIVIDED / baud) - 1
    rate = baud_of(table, code)
    return code if rate is not None and abs(rate - baud) <= _TOLERANCE * baud else None
