"""Engines: a clip that raises, hangs, ends its process or takes all memory costs itself alone, and whatever ends a
driver, the next one goes on, with the same bytes."""

import hashlib
import json
import os
import subprocess
import sys
from collections import Counter
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from batch_benches import surroundings
from benchmarks.batch_driver import FAULTS, instant
from command_line import code_of
from hardware.clock import MonotonicClock
from messages import refuses
from retarget.batch.batch import run_batch
from retarget.batch.clip import BatchClip, BatchSettings, ClipStatus, batch_settings, process_clip
from retarget.batch.engines import on_processes, on_ray
from retarget.batch.index import BatchIndex
from retarget.batch.inputs import find_clips
from retarget.batch.worker import ClipLimits, ClipWorker, WorkerError
from retarget.cli.batch import MOST_MEMORY, MOST_TIME_S
from retarget.human.samples import Playback
from retarget.run.options import RunOptions

ROOT = Path(__file__).resolve().parent.parent.parent
LIMITS = ClipLimits(time_s=2.0, memory=int(3e9))
INSTANT = partial(process_clip, follow=instant)
BENCH = "retarget.cli.buses:PhysicsBench"
SAMPLE = ROOT / "retarget/sources/sample_recording.bvh"
pytestmark = pytest.mark.long


def made(folder: Path, good: int) -> tuple[BatchSettings, tuple[BatchClip, ...]]:
    """So many clips, and one of each fault among them."""
    (folder / "data").mkdir()
    for name in [
        *(f"{number:03}" for number in range(good)),
        *(f"{4 * at:03}_{name}" for at, name in enumerate(FAULTS)),
    ]:
        (folder / "data" / f"{name}.bvh").write_text(name)
    settings = batch_settings(folder / "out", RunOptions(robot="op3"), bench=BENCH)
    return settings, find_clips([str(folder / "data")], out=settings.out, ending=".npz")


def not_as_planted(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows with another status than their clip's fault asks for."""
    wanted = {
        name: next((status for fault, status in FAULTS.items() if fault in name), ClipStatus.DONE)
        for name in (row["output"] for row in rows)
    }
    return [row for row in rows if row["status"] != wanted[row["output"]]]


def indexed(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / "index.jsonl").read_text().splitlines()]


def digests(out: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in out.rglob("*.npz")}


@pytest.mark.parametrize("engine", ["processes", "ray"])
def test_each_fault_has_its_row_and_costs_itself_alone(engine: str, tmp_path: Path) -> None:
    settings, clips = made(tmp_path, 30)
    run = partial(on_processes, limits=LIMITS, jobs=2, work=INSTANT)
    if engine == "ray":
        pytest.importorskip("ray", reason="the extra ray is not installed")
        run = partial(on_ray, limits=LIMITS, jobs=2, work=INSTANT)
    with BatchIndex(settings.out) as index:
        tally = run_batch(clips, settings, index, run)
    rows = indexed(settings.out)
    assert sorted(row["output"] for row in rows) == sorted(clip.output for clip in clips)
    assert not not_as_planted(rows) and tally.failed == len(FAULTS) and tally.counts[ClipStatus.DONE] == 30
    assert {row["output"] for row in rows if row["status"] == "done"} == set(digests(settings.out))
    said = {row["output"][4:-4]: row["message"] for row in rows if row["message"]}
    assert "7" in said["exits"] and "SIGSEGV" in said["breaks"] and "2 s" in said["sleeps"]
    assert "planted" in said["raises"]
    assert not children()


def test_the_largest_limits_are_ones_that_the_system_can_hold(tmp_path: Path) -> None:
    settings, clips = made(tmp_path, 1)
    good = [clip for clip in clips if "_" not in clip.output]
    most = ClipLimits(MOST_TIME_S, MOST_MEMORY)
    assert [row.status for row in on_processes(good, settings, limits=most, jobs=1, work=INSTANT)] == [ClipStatus.DONE]


def children(pid: int = os.getpid()) -> list[str]:
    """Processes of a process, of this one by default, that work on clips."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            try:
                if "spawn_main" in Path(f"/proc/{child}/cmdline").read_text():
                    found.append(child)
            except OSError:
                pass
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
def test_a_killed_driver_leaves_nothing_half_and_no_process_and_the_next_goes_on(tmp_path: Path) -> None:
    settings, clips = made(tmp_path, 400)
    command = [sys.executable, "-P", "-m", "benchmarks.batch_driver", str(tmp_path / "data"), str(settings.out)]
    command += ["--instant", "--time-limit", "2"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    driver = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    index, clock = settings.out / "index.jsonl", MonotonicClock()
    while not (index.is_file() and index.read_bytes().count(b"\n") > 60):
        assert driver.poll() is None
        clock.sleep_until(clock.now() + 0.01)
    workers = children(driver.pid)
    driver.kill()
    driver.wait()
    assert workers
    latest = clock.now() + 10.0
    while any(Path(f"/proc/{worker}").is_dir() for worker in workers):
        assert clock.now() < latest, "workers outlive their driver"
        clock.sleep_until(clock.now() + 0.05)
    before = index.read_bytes().count(b"\n")
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, timeout=200)
    tally = json.loads(done.stdout.splitlines()[-1])
    rows = indexed(settings.out)
    assert len(rows) == len(clips) and not not_as_planted(rows)
    assert set(Counter(row["output"] for row in rows).values()) == {1}
    assert before < len(clips) and tally["done_before"] >= before - len(FAULTS)
    assert not [*settings.out.glob(".*")] and len(digests(settings.out)) == 400
    again = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, timeout=200)
    assert json.loads(again.stdout.splitlines()[-1])["done_before"] == 400 and len(indexed(settings.out)) == len(rows)


def test_outputs_have_the_same_bytes_by_one_worker_by_two_and_in_this_process(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    lines = SAMPLE.read_text().splitlines(keepends=True)
    motion = next(at for at, line in enumerate(lines) if line.startswith("Frame Time"))
    for name, first in (("a", 0), ("b", 60), ("c", 120), ("d", 180)):
        head = [*lines[: motion - 1], "Frames: 20\n", lines[motion]]
        (tmp_path / "data" / f"{name}.bvh").write_text("".join(head + lines[motion + 1 + first : motion + 21 + first]))
    found = []
    for jobs in (0, 1, 2):
        out = tmp_path / f"out{jobs}"
        settings = batch_settings(out, RunOptions(robot="op3"), bench=BENCH, reading={"unit": "cm"})
        clips = find_clips([str(tmp_path / "data")], out=settings.out, ending=".npz")
        if jobs == 0:
            rows = [process_clip(clip, settings) for clip in reversed(clips)]
        else:
            rows = list(on_processes(clips, settings, limits=ClipLimits(100.0, int(4e9)), jobs=jobs))
        assert {row.status for row in rows} == {ClipStatus.DONE}, rows
        assert all(row.verdict and row.likeness_deg and row.tracking_mm and row.frames == 20 for row in rows)
        found.append((digests(out), sorted(row.source_hash for row in rows)))
    assert found[0] == found[1] == found[2] and len(set(found[0][0].values())) == 4


def test_exports_have_the_bytes_of_export_itself(tmp_path: Path) -> None:
    """And are written over those of an earlier batch."""
    (tmp_path / "a.bvh").write_bytes(SAMPLE.read_bytes())
    options = RunOptions(robot="op3", playback=Playback(end=0.3))
    for form, name in (("run", "a.npz"), ("csv", "a.csv"), ("npz", "a_motion.npz"), ("bvh", "a.bvh")):
        settings = batch_settings(tmp_path / "out", options, bench=BENCH, reading={"unit": "cm"}, form=form)
        clip = BatchClip(str(tmp_path / "a.bvh"), name)
        for _ in range(2):
            row = process_clip(clip, settings)
            assert row.status is ClipStatus.DONE, row
        if form != "run":
            made = tmp_path / "alone" / name
            made.parent.mkdir(exist_ok=True)
            assert code_of("export", tmp_path / "out/a.npz", "--to", form, "--out", made) == 0
            assert made.read_bytes() == (tmp_path / "out" / name).read_bytes()


def test_the_virtual_human_alone_has_rows_and_outputs(tmp_path: Path) -> None:
    options = RunOptions(robot="human", playback=Playback(end=0.3))
    for form, name in (("run", "a.npz"), ("csv", "a.csv")):
        settings = batch_settings(tmp_path, options, bench=BENCH, reading={"unit": "cm"}, form=form)
        row = process_clip(BatchClip(str(SAMPLE), name), settings)
        assert row.status is ClipStatus.DONE and (tmp_path / name).is_file(), row
        assert row.tracking_mm and not row.verdict and row.gated is None


def test_a_robot_with_mass_that_falls_is_stopped_and_says_so(tmp_path: Path) -> None:
    """A bench sees every tick: here one that lets the robot fall after a second."""
    options = RunOptions(robot="op3", playback=Playback(end=2.0))
    settings = batch_settings(tmp_path, options, bench="batch_benches:Falling", reading={"unit": "cm"})
    row = process_clip(BatchClip(str(SAMPLE), "a.npz"), settings)
    assert row.status is ClipStatus.STOPPED and "fallen" in row.stop and (tmp_path / "a.npz").is_file()


def test_processes_that_never_begin_are_a_fault_of_the_machine(tmp_path: Path) -> None:
    settings, clips = made(tmp_path, 1)

    class Ends:
        """Ends the process that loads it."""

        def __reduce__(self) -> Any:
            return os._exit, (3,)

    rows = on_processes(clips, settings, limits=LIMITS, jobs=1, work=Ends())  # type: ignore[arg-type]
    with closing(rows), refuses(WorkerError, "exit code 3"):
        next(rows)


def test_a_driver_that_stops_ends_its_workers(tmp_path: Path) -> None:
    settings, clips = made(tmp_path, 30)
    rows = on_processes(
        [clip for clip in clips if "_" not in clip.output], settings, limits=LIMITS, jobs=2, work=INSTANT
    )
    assert next(rows).status is ClipStatus.DONE and children()
    rows.close()
    assert not children()


def test_a_worker_has_one_thread_and_does_not_see_ctrl_c(tmp_path: Path) -> None:
    settings, clips = made(tmp_path, 1)
    worker = ClipWorker(surroundings, settings, LIMITS)
    try:
        row = worker.run(clips[0])
        before = os.environ.get("OMP_NUM_THREADS")
        assert row.message == "1 1 blocked" and os.environ.get("OMP_NUM_THREADS") == before
    finally:
        worker.end()
