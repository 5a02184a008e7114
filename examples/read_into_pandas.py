"""A recording as pandas tables, one per topic: give one that `retarget run --record` wrote, or none."""

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from mcap.reader import make_reader


def table(path, topic, field):
    """One field of a topic: a row per message, by its time; a column per name (joint, servo, sensor)."""
    with Path(path).open("rb") as stream:
        found = [*make_reader(stream, validate_crcs=True).iter_messages(topics=[topic])]
    metadata, data = found[0][1].metadata, b"".join(message.data for *_, message in found)
    rows = np.frombuffer(data, np.dtype(json.loads(metadata["layout"])))
    time = rows["stamp.sec"].astype("datetime64[s]") + rows["stamp.nanosec"].astype("timedelta64[ns]")
    return pd.DataFrame(rows[field], index=time, columns=metadata["names"].split())


def main(path):
    """How far servos were from the goal of the tick before."""
    goals, seen = (table(path, topic, "position") for topic in ("/goals", "/joint_states"))
    error = (seen - goals.shift().reindex(seen.index, method="ffill")).abs().max()
    print(error.nlargest(3).map("{:.3f} rad off at most".format).to_string())


if len(sys.argv) > 1:
    main(sys.argv[1])
else:  # record one first
    from retarget.cli.run import Outputs, RunOptions, follow_clip
    from sim.performer import synthetic_performer

    with TemporaryDirectory() as folder:
        outputs = Outputs(record=Path(folder, "run.mcap"))
        follow_clip(lambda: synthetic_performer().cut(0.0, 2.0), RunOptions(robot="op3"), outputs)
        main(outputs.record)
