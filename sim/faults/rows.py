"""The rows of the fault table, read from `rows.yaml`."""

from pathlib import Path
from typing import Any

import yaml

from hardware.guard_state import StopCause
from sim.faults.inject import injection
from sim.faults.reactions import Idle, Reaction, Row

TABLE = Path(__file__).with_name("rows.yaml")
ENUMS: dict[str, Any] = {"reaction": Reaction, "idle": Idle, "cause": StopCause, "then": StopCause}


def _row(entry: dict[str, Any]) -> Row:
    values: dict[str, Any] = {key: ENUMS[key][value] if key in ENUMS else value for key, value in entry.items()}
    return Row(**values | {"inject": injection(entry["inject"]), "refusal": tuple(entry.get("refusal", ()))})


ROWS: tuple[Row, ...] = tuple(_row(entry) for entry in yaml.safe_load(TABLE.read_text(encoding="utf-8")))
APPROACHED: tuple[Row, ...] = tuple(row for row in ROWS if row.approach)
"""Rows that are injected on the approach, too: the posture of a performer is neither solved nor gated there."""
