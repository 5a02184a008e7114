"""The rows of the fault table: what is done to a run, and what the robot has to do about it."""

from sim.faults.bus_rows import BUS_ROWS
from sim.faults.host_rows import HOST_ROWS
from sim.faults.reaction import Row
from sim.faults.start_rows import START_ROWS
from sim.faults.stream_rows import STREAM_ROWS

__all__ = ["APPROACHED", "ROWS"]

ROWS: tuple[Row, ...] = (*STREAM_ROWS, *HOST_ROWS, *BUS_ROWS, *START_ROWS)
APPROACHED: tuple[Row, ...] = (
    *STREAM_ROWS,
    *(row for row in HOST_ROWS if not row.name.startswith(("solver", "clearance", "wall clock"))),
)
"""Rows that are done on the approach, too: nothing solves or gates there what a performer does."""
