"""A recording whose process is killed at any time loses at most its last second; ten minutes of it are small."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from hardware.clock import MonotonicClock, wall_to_monotonic
from retarget.recording.mcap_writer import FLUSH_S
from retarget.recording.reading import played, read_recording
from retarget.recording.topics import TICK

CLOCK = MonotonicClock()
PROCESS = Path(__file__).parents[1] / "support" / "recording_process.py"
OURS = os.environ | {"PYTHONPATH": str(PROCESS.parents[2])}
LOST_S = 1.0


def kill_while_it_moves(path: Path, *, after: float) -> float:
    """Kill -9 so many seconds after it moves. Returns how much of what had happened is not in the file, s."""
    words = [sys.executable, str(PROCESS), str(path), "15"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=OURS) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "moves\n"
        CLOCK.sleep_until(CLOCK.now() + after)
        killed_ns = round(CLOCK.now() * 1e9) - wall_to_monotonic()
        process.kill()
    recording = read_recording(path)
    cycles = played(recording).cycles
    last = recording.topic(TICK).rows[-1]
    assert recording.damage and len(cycles) > 50 and cycles.index.tolist() == list(range(len(cycles)))
    return 1e-9 * (killed_ns - (int(last["stamp.sec"]) * 10**9 + int(last["stamp.nanosec"])))


def test_a_killed_run_is_there_but_for_the_last_second(tmp_path: Path) -> None:
    assert FLUSH_S <= 0.5
    assert kill_while_it_moves(tmp_path / "run.mcap", after=0.3) < LOST_S


@pytest.mark.long
def test_fifty_killed_runs_are_there_but_for_the_last_second(tmp_path: Path) -> None:
    times = random.Random(50)
    lost = [kill_while_it_moves(tmp_path / f"{run}.mcap", after=times.uniform(0.0, 2.0)) for run in range(50)]
    assert max(lost) < LOST_S, sorted(lost)[-5:]


@pytest.mark.long
def test_it_is_small_and_costs_little(tmp_path: Path) -> None:
    """In real time: bytes of ten minutes, and CPU of the thread that writes."""
    words = [sys.executable, str(PROCESS), str(tmp_path / "run.mcap"), "18"]
    said = subprocess.run(words, capture_output=True, text=True, check=True, timeout=120, env=OURS).stdout.split()
    percent, per_second = float(said[said.index("cpu") + 1]), float(said[said.index("bytes") - 1])
    assert percent < 2.0 and 600.0 * per_second < 60e6
