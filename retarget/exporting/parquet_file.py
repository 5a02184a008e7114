"""Parquet: the table of the CSV in full precision, with the unit of every column and what the motion is beside it."""

import json
from typing import IO

from retarget.exporting.arrow import arrow
from retarget.exporting.columns import columns_of
from retarget.exporting.conventions import CONVENTIONS
from retarget.exporting.motion import Motion

__all__ = ["write_parquet"]


def write_parquet(motion: Motion, stream: IO[bytes]) -> None:
    """Write the table of `columns_of`. Raises UsageError without pyarrow.

    A column's unit is the key `unit` of its field's metadata; the schema's metadata has `retarget`, a JSON object.
    """
    found = arrow()
    pa = found.core
    columns = columns_of(motion)
    about = {**CONVENTIONS, "root_link": motion.body.body_names[1], "rows": len(motion)}
    schema = pa.schema(
        [
            pa.field(
                column.name, pa.array(column.values[:0]).type, metadata={"unit": column.unit} if column.unit else None
            )
            for column in columns
        ],
        metadata={"retarget": json.dumps(about)},
    )
    # Arrow tells "not known" from NaN; here both are one.
    arrays = [pa.array(column.values, from_pandas=True) for column in columns]
    found.parquet.write_table(pa.table(arrays, schema=schema), stream)
