"""Engines that run the clips of a batch: processes of this machine, or Ray, on this machine or on a cluster.

Both yield rows in the order in which clips end, and isolate a clip in a `ClipWorker`.
"""

import os
from collections.abc import Generator, Iterable
from multiprocessing.connection import wait
from typing import Any

from hardware.clock import MonotonicClock
from retarget.batch.clip import BatchClip, BatchSettings, ClipRow, ClipStatus, failed_row, process_clip
from retarget.batch.worker import ClipLimits, ClipWorker, Work, WorkerError
from retarget.errors import UsageError, install_step


def usual_jobs() -> int:
    """The number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_processes(
    clips: Iterable[BatchClip],
    settings: BatchSettings,
    *,
    limits: ClipLimits,
    jobs: int,
    work: Work = process_clip,
) -> Generator[ClipRow, None, None]:
    """Yield rows of clips from `jobs` processes of this machine. They end with this generator, and with its process."""
    left = iter(clips)
    workers = [ClipWorker(work, settings, limits) for _ in range(jobs)]
    busy = list[ClipWorker]()
    try:
        for worker in workers:
            if (clip := next(left, None)) is not None:
                worker.begin(clip)
                busy.append(worker)
        while busy:
            wait([sign for worker in busy for sign in worker.signs], min(worker.time_left for worker in busy))
            for worker in tuple(busy):
                row = worker.look()
                if row is None:
                    continue
                if (clip := next(left, None)) is None:
                    busy.remove(worker)
                else:
                    worker.begin(clip)  # it works while the row is taken
                yield row
    finally:
        for worker in workers:
            worker.end()


# Ray: a task for each clip, whose worker process keeps a `ClipWorker`.

IN_FLIGHT = 2
"""Tasks per processor: one runs, one waits."""
CPUS_S = 10.0
"""Time between counts of the processors of a cluster, which may grow, s."""
STORE = 100 * 2**20
"""Object store of a local Ray, bytes: it only has rows and paths."""


def on_ray(
    clips: Iterable[BatchClip],
    settings: BatchSettings,
    *,
    limits: ClipLimits,
    jobs: int | None = None,
    address: str | None = None,
    work: Work = process_clip,
) -> Generator[ClipRow, None, None]:
    """Yield rows of clips from tasks of Ray. address: of a cluster, by default RAY_ADDRESS; without both, a local Ray
    is started with `jobs` processors. On a cluster, `jobs` is the most that are used at once.

    All nodes must have the same paths of sources and outputs, and this program. Raises UsageError without Ray or
    cluster, WorkerError if no node can begin a clip.
    """
    ray = _started(address, jobs)
    task = ray.remote(num_cpus=1, max_retries=1, retry_exceptions=False)(_task)
    shared, left, flying = ray.put((work, settings, limits)), iter(clips), dict[Any, BatchClip]()
    clock, counted_at, room = MonotonicClock(), -CPUS_S, 1
    try:
        while True:
            if (now := clock.now()) - counted_at >= CPUS_S:
                counted_at, cpus = now, int(ray.cluster_resources().get("CPU", 1))
                room = IN_FLIGHT * max(min(cpus, jobs or cpus), 1)
            while len(flying) < room and (clip := next(left, None)) is not None:
                flying[task.remote(clip, shared)] = clip
            if not flying:
                return
            for done in ray.wait(list(flying), num_returns=1, timeout=1.0)[0]:
                yield _row_of(ray, done, flying.pop(done), settings)
    finally:
        for one in flying:
            ray.cancel(one, force=True)
        ray.shutdown()


def _started(address: str | None, jobs: int | None) -> Any:
    try:
        import ray
    except ImportError as error:
        step = f"{install_step('ray')}; or --engine processes"
        raise UsageError("ray is missing", where="--engine", found=error, next_step=step) from error
    joins = address or os.environ.get("RAY_ADDRESS")
    own = {} if joins else {"num_cpus": jobs or usual_jobs(), "include_dashboard": False, "object_store_memory": STORE}
    try:
        ray.init(address=joins or "local", log_to_driver=False, logging_level="ERROR", **own)
    except (ConnectionError, ValueError, RuntimeError) as error:
        step = "`ray status` on the head node names it"
        raise UsageError("no Ray there", where="--address", found=str(error)[:200], next_step=step) from error
    return ray


_kept: dict[str, ClipWorker] = {}
"""Workers of a worker process of Ray, by the hash of their batch's settings."""


def _task(clip: BatchClip, shared: tuple[Work, BatchSettings, ClipLimits]) -> ClipRow:
    work, settings, limits = shared
    if settings.hash not in _kept:
        _kept[settings.hash] = ClipWorker(work, settings, limits)
    return _kept[settings.hash].run(clip)


def _row_of(ray: Any, done: Any, clip: BatchClip, settings: BatchSettings) -> ClipRow:
    known = ray.exceptions
    try:
        row: ClipRow = ray.get(done)
        return row
    except known.RayTaskError as error:
        if isinstance(error.cause, WorkerError):
            raise WorkerError(str(error.cause)) from error
        status, found = ClipStatus.FAILED, error.cause
    except known.OutOfMemoryError as error:
        status, found = ClipStatus.OUT_OF_MEMORY, error
    except known.TaskCancelledError as error:
        status, found = ClipStatus.TIMED_OUT, error
    except known.RayError as error:  # a worker or a node is gone, twice
        status, found = ClipStatus.CRASHED, error
    return failed_row(clip, settings, status, type(found).__name__, str(found))
