"""`python -m benchmarks.batch_driver`: a batch whose clips may have faults, to be killed and resumed from outside.

A clip with one of FAULTS in its name does that. The others are followed as in `retarget batch`; with `--instant`, each
only copies its source. With `--loop` they are run one after the other in this process. The last line that is printed is
JSON: rows by status; clips a second, and since the first row, before which processes start; CPU, s a clip, of all
processes of this machine; and the peak memory of this process, MB.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
from collections.abc import Generator, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from hardware.clock import MonotonicClock
from retarget.batch.batch import Engine, run_batch
from retarget.batch.clip import BatchClip, BatchSettings, ClipRow, ClipStatus, batch_settings, failed_row, process_clip
from retarget.batch.clip import follow_clip as usual
from retarget.batch.engines import on_processes, on_ray
from retarget.batch.index import BatchIndex
from retarget.batch.inputs import find_clips
from retarget.batch.worker import ClipLimits, Work
from retarget.cli.batch import BENCH
from retarget.human.samples import Playback
from retarget.run.options import RunOptions
from retarget.schema.files import write_atomic

FAULTS = {
    "raises": ClipStatus.FAILED,
    "sleeps": ClipStatus.TIMED_OUT,
    "exits": ClipStatus.CRASHED,
    "breaks": ClipStatus.CRASHED,
    "allocates": ClipStatus.OUT_OF_MEMORY,
}
"""Part of a clip's name, and the status of its row."""
FOREVER_S = 1e6


def faulty(clip: BatchClip, settings: BatchSettings) -> ClipRow:
    """Do what the clip's name says, else follow it as usual."""
    plant(clip)
    return usual(clip, settings)


def instant(clip: BatchClip, settings: BatchSettings) -> ClipRow:
    """Do what the clip's name says, else copy the source."""
    plant(clip)
    place = settings.out / clip.output
    place.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(place, Path(clip.source).read_bytes(), option="--out")
    return replace(failed_row(clip, settings, ClipStatus.DONE, "", ""), frames=1)


def plant(clip: BatchClip) -> None:
    """The fault in the clip's name, if there is one."""
    name = Path(clip.source).name
    if "raises" in name:
        raise ZeroDivisionError("a planted fault")
    if "sleeps" in name:
        clock = MonotonicClock()
        clock.sleep_until(clock.now() + FOREVER_S)
    if "exits" in name:
        os._exit(7)
    if "breaks" in name:
        os.kill(os.getpid(), signal.SIGSEGV)
    if "allocates" in name:
        kept = []
        while True:
            kept.append(np.zeros(2**23))


def in_loop(
    clips: Iterable[BatchClip], settings: BatchSettings, work: Work = process_clip
) -> Generator[ClipRow, None, None]:
    """The rows of clips, by this process alone."""
    for clip in clips:
        yield work(clip, settings)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.batch_driver", description=__doc__)
    parser.add_argument("folder", type=Path, help="of the motion files")
    parser.add_argument("out", type=Path)
    parser.add_argument("--robot", default="op3")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--ray", action="store_true")
    parser.add_argument("--loop", action="store_true")
    parser.add_argument("--instant", action="store_true")
    parser.add_argument("--time-limit", type=float, default=20.0, help="s")
    parser.add_argument("--memory", type=float, default=3.0, help="GB")
    asked = parser.parse_args()
    settings = batch_settings(asked.out, RunOptions(robot=asked.robot, playback=Playback()), bench=BENCH)
    clips = find_clips([str(asked.folder)], out=settings.out, ending=".npz")
    work = partial(process_clip, follow=instant if asked.instant else faulty)
    engine: Engine = partial(
        on_ray if asked.ray else on_processes,
        limits=ClipLimits(asked.time_limit, int(1e9 * asked.memory)),
        jobs=asked.jobs,
        work=work,
    )
    if asked.loop:
        engine = partial(in_loop, work=work)
    times = list[float]()
    with BatchIndex(settings.out) as index:
        tally = run_batch(clips, settings, index, engine, look=lambda tally, row: times.append(tally.seconds))
        index.write_table()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    found = {"done_before": tally.done_before, "rate": tally.over / max(tally.seconds, 1e-9), "peak_mb": peak}
    found["working_rate"] = (len(times) - 2) / max(times[-1] - times[1], 1e-9) if len(times) > 2 else 0.0
    usage = [resource.getrusage(of) for of in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    found["cpu_s"] = sum(one.ru_utime + one.ru_stime for one in usage) / max(tally.over, 1)
    print(json.dumps({**tally.counts, **found}), flush=True)


if __name__ == "__main__":
    from benchmarks.batch_driver import main as run  # processes of Ray find faults by the name of this module

    run()
