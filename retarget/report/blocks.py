"""Figures of a long run in blocks of rows: a run keeps all of its rows, and a measurement needs several times as much
memory as the rows that it looks at."""

from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

BLOCK = 256
"""Rows that are measured together. The distances of all pairs of observers need 0.13 MB a row for a moment, so 35 MB;
larger blocks are no faster, as they leave the processor's cache."""

Array = TypeVar("Array", bound=NDArray[np.generic])


def blocks(count: int) -> Iterator[slice]:
    """The rows of each block of `count` rows, in their order; of no rows one empty block."""
    for first in range(0, max(count, 1), BLOCK):
        yield slice(first, min(first + BLOCK, count))


def in_blocks(measured: Callable[[slice], Array], count: int) -> Array:
    """The results of `measured` for `count` rows, (count, ...), each from itself alone. measured: takes some rows."""
    return in_named_blocks(lambda rows: {"": measured(rows)}, count)[""]


def in_named_blocks(measured: Callable[[slice], Mapping[str, Array]], count: int) -> dict[str, Array]:
    """As `in_blocks`, of several arrays by name."""
    whole: dict[str, Array] = {}
    for rows in blocks(count):
        for name, part in measured(rows).items():
            if name not in whole:  # filled in place: parts that are joined at the end need twice the memory
                whole[name] = np.empty((count, *part.shape[1:]), part.dtype)  # type: ignore[assignment]
            whole[name][rows] = part
    return whole
