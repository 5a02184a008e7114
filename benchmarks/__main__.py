"""`python -m benchmarks`: our frame beside PlaCo and mink, in one run on one core.

`--json FILE` keeps the numbers.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

from benchmarks.bodies import BenchBody, bench_human, bench_op3
from benchmarks.measure import Outcome, run, show_sides
from benchmarks.motion import Motion, crouch_and_reach, out_of_reach
from benchmarks.ours import Ours
from benchmarks.recording import RECORDING, SHARED, followed, recording
from benchmarks.side import N_IK, peers
from benchmarks.table import options_of, write_json
from retarget.human.calibration import calibrate
from retarget.sources.open import open_source


def main() -> None:
    """Run everything and print it."""
    options = options_of("benchmarks", __doc__)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    sides = [Ours, *peers()]
    outcomes: list[Outcome] = []
    human, op3 = bench_human(), bench_op3()
    for body, motion in cases(human, op3, options.frames):
        outcomes += run(body, motion, sides, repeats=options.repeats)
    print(f"One process, one core, {N_IK} iterations, no early stop.")
    print(f"Synthetic motions: {options.frames} frames at 120 Hz.")
    print(f"Sides take turns frame by frame; times are medians over {options.repeats} runs.")
    show_sides("frames", outcomes, docs=options.docs)
    write_json(options.json, {"frames": outcomes})


def cases(human: BenchBody, op3: BenchBody, frames: int) -> list[tuple[BenchBody, Motion]]:
    """Both bodies, in reach and out of it; a recording where there is one."""
    found = []
    for body in (human, op3):
        easy = crouch_and_reach(body, frames)
        found += [(body, easy), (body, out_of_reach(body, easy))]
    if RECORDING.is_file():
        recorded = open_source(RECORDING)
        performer = bench_human(calibrate(recorded))
        found += [(performer, recording(performer, recorded)), followed(op3, recorded)]
    else:
        print(f"without the recording: no {RECORDING.name} under {SHARED}")
    return found


if __name__ == "__main__":
    main()
