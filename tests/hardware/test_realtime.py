"""Real-time priority and a core of its own: given back afterwards, and refused with what to do."""

import os
import re
import threading
from pathlib import Path

import pytest

from hardware.errors import HardwareError
from hardware.realtime import (
    USUAL_PRIORITY,
    Scheduling,
    named_process,
    refuse_scheduling,
    scheduled,
)
from messages import refuses


def _process(folder: Path, cmdline: bytes, comm: bytes = b"short\n") -> str:
    (folder / "12").mkdir()
    (folder / "12" / "cmdline").write_bytes(cmdline)
    (folder / "12" / "comm").write_bytes(comm)
    return named_process(12, folder)


@pytest.mark.parametrize(
    ("cmdline", "said"),
    [
        (b"retarget\0servo\0monitor\0", "process 12 (retarget servo monitor)"),
        (
            b"/opt/v/bin/python3.12\0/opt/v/bin/retarget\0emulate\0--link\0a/b\0",
            "process 12 (retarget emulate --link a/b)",
        ),
        (b"/opt/bin/python\0-m\0retarget\0run\0", "process 12 (python -m retarget run)"),
        (b"/usr/bin/screen\0/dev/ttyUSB0\0", "process 12 (screen /dev/ttyUSB0)"),
        (b"python3\0", "process 12 (python3)"),
        (b"", "process 12 (short)"),
        (b"a\x1b[2J\xff\0\nb\0", "process 12 (a?[2J\N{REPLACEMENT CHARACTER} ?b)"),
    ],
)
def test_a_process_is_named_by_what_was_typed(tmp_path: Path, cmdline: bytes, said: str) -> None:
    assert _process(tmp_path, cmdline) == said


class Kernel:
    """A scheduler that permits, or does not, and remembers."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, error: OSError | None = None) -> None:
        self.calls: list[tuple[int, int]] = []
        self._error = error
        monkeypatch.setattr(os, "sched_setscheduler", self._set)

    def _set(self, pid: int, policy: int, parameter: os.sched_param) -> None:
        if self._error is not None and policy & os.SCHED_FIFO:
            raise self._error
        self.calls.append((policy, parameter.sched_priority))


def test_priority_and_core_are_had_and_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel, cores = Kernel(monkeypatch), os.sched_getaffinity(0)
    core = min(cores)
    with scheduled(Scheduling(priority=USUAL_PRIORITY, core=core)):
        assert kernel.calls == [(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, USUAL_PRIORITY)]
        assert os.sched_getaffinity(0) == {core}
    assert kernel.calls[-1] == (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority)
    assert os.sched_getaffinity(0) == cores


def test_what_is_not_permitted_is_refused_with_how_to_permit_it(monkeypatch: pytest.MonkeyPatch) -> None:
    cores = os.sched_getaffinity(0)
    Kernel(monkeypatch, error=PermissionError(1, "Operation not permitted"))
    with pytest.raises(HardwareError) as refused:
        refuse_scheduling(Scheduling(priority=40, core=min(cores)))
    for word in ("--realtime: ", "not permitted", "limits.d", "LimitRTPRIO", "leave --realtime out"):
        assert word in str(refused.value)
    assert os.sched_getaffinity(0) == cores


@pytest.mark.parametrize("priority", [0, -1, 100])
def test_a_priority_that_does_not_exist_is_refused(priority: int) -> None:
    with refuses(HardwareError, "--realtime", 1, 99):
        refuse_scheduling(Scheduling(priority=priority))


@pytest.mark.parametrize("core", [-1, 1023, 10**12])
def test_a_core_that_does_not_exist_is_refused(core: int) -> None:
    with refuses(HardwareError, "--core", varies=re.compile(r"allowed: [^.]*")):
        refuse_scheduling(Scheduling(core=core))


def test_nothing_asked_changes_nothing() -> None:
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    with scheduled(Scheduling()):
        assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before


def test_only_the_calling_thread_and_none_that_it_starts() -> None:
    """Where it is permitted; elsewhere the refusal is all there is to see."""
    seen: list[int] = []
    try:
        with scheduled(Scheduling(priority=1)):
            thread = threading.Thread(target=lambda: seen.append(os.sched_getscheduler(0)))
            thread.start()
            thread.join()
            mine = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    except HardwareError as error:
        pytest.skip(str(error))
    assert mine == os.SCHED_FIFO and seen == [os.SCHED_OTHER] and os.sched_getscheduler(0) == os.SCHED_OTHER
