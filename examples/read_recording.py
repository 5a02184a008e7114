"""Read a recording with the mcap library and numpy alone: give one that `retarget run --record` wrote, or none."""

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from mcap.reader import make_reader


def read(path, topic):
    """The messages of a topic as a structured array, and the names of what its arrays hold."""
    with Path(path).open("rb") as stream:
        found = [*make_reader(stream, validate_crcs=True).iter_messages(topics=[topic])]
    metadata = found[0][1].metadata
    layout = np.dtype(json.loads(metadata["layout"]))
    return np.frombuffer(b"".join(message.data for *_, message in found), layout), metadata["names"].split()


def main(path):
    """Print how far each joint was from the goal of the tick before."""
    (goals, joints), (states, _) = read(path, "/goals"), read(path, "/joint_states")
    sent, seen = (topic["stamp.sec"] + 1e-9 * topic["stamp.nanosec"] for topic in (goals, states))
    before = np.searchsorted(sent, seen) - 1
    error = np.abs(states["position"] - goals["position"][before])[before >= 0].max(axis=0)
    print("\n".join(f"{joints[worst]:12s} {error[worst]:.3f} rad off at most" for worst in np.argsort(-error)[:3]))


if len(sys.argv) > 1:
    main(sys.argv[1])
else:  # record one first
    from retarget.cli.run import Outputs, RunOptions, follow_clip
    from sim.performer import synthetic_performer

    with TemporaryDirectory() as folder:
        outputs = Outputs(record=Path(folder, "run.mcap"))
        follow_clip(lambda: synthetic_performer().cut(0.0, 2.0), RunOptions(robot="op3"), outputs)
        main(outputs.record)
