"""Work on untrusted files, tried first in a child process with limits of memory and time."""

import json
import os
import resource
import select
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import NoReturn

from retarget.errors import InputError, Problem, RefusedError

MEMORY = 1_000_000_000
"""Memory of the child beyond this process's, bytes: ten times that of large meshes."""
CPU_S = 30
"""Processor time of the child, s: meshes of 400,000 triangles take 6 s, and five times that on a small board."""
PATIENCE_S = 120.0
"""Time of the child on a busy machine, s."""
MOST = 1 << 20
"""Size of the child's answer, bytes."""
MOST_PROBLEMS = 50
"""Number of reported problems of a file."""
DONE, REFUSED, MEMORY_ERROR, DEFECT = 0, 10, 11, 12
"""Exit codes of the child. MuJoCo or a limit ended it with others."""
BUSY = "End other programs, or raise the limit of processes (ulimit -u)"
HELP = "Give the body of one robot, with simpler meshes"


def try_in_child(work: Callable[[], object], *, source: str) -> None:
    """Do some work in a forked child first, in which a file cannot exhaust memory or time, or end this process.

    Raises InputError if the work takes too much, or refuses the file. Other errors are left to the work in this
    process. source: name of the file.
    """
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of other threads, whose locks the child does not need
        try:
            child = os.fork()
        except OSError as error:
            os.close(reading)
            os.close(writing)
            raise InputError(
                "no process can be made in which the body is compiled", where=source, found=str(error), next_step=BUSY
            ) from error
    if not child:
        os.close(reading)
        _work_and_leave(work, writing)
    os.close(writing)
    try:
        answer = _answer(reading)
    finally:
        os.close(reading)
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)  # at its end, too late, or after Ctrl-C
        _, status = os.waitpid(child, 0)
    if answer is not None:
        _judge(answer, os.waitstatus_to_exitcode(status), source)
    else:
        raise _too_much(source, f"more than {PATIENCE_S:g} s")


def _judge(answer: bytes, code: int, source: str) -> None:
    problems = [Problem(**problem) for problem in json.loads(answer)] if answer else []
    if problems:
        raise InputError.from_problems(problems, title=f"{source}: {len(problems)} problems")
    if code == MEMORY_ERROR:
        raise _too_much(source, f"more than {MEMORY / 1e6:g} MB")
    if code == -signal.SIGKILL:  # of the kernel, for memory, or of the time limit
        raise _too_much(source, "it was killed")
    if code == -signal.SIGXCPU:
        raise _too_much(source, f"more than {CPU_S} s of a processor")
    if code not in (DONE, DEFECT):
        raise InputError("not a usable body", where=source, found=f"it ends MuJoCo ({code})", next_step=HELP)


def _too_much(source: str, found: str) -> InputError:
    allowed = f"{MEMORY / 1e6:g} MB and {CPU_S} s"
    return InputError("compiling the body takes too much", where=source, found=found, allowed=allowed, next_step=HELP)


def _answer(reading: int) -> bytes | None:
    """The child's output; None if it does not end in time."""
    answer = b""
    while select.select((reading,), (), (), PATIENCE_S)[0]:
        part = os.read(reading, MOST)
        answer += part
        if not part or len(answer) > MOST:
            return answer
    return None


def _work_and_leave(work: Callable[[], object], writing: int) -> NoReturn:
    code = DEFECT
    try:
        sys.stdout = sys.stderr = nowhere = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
        for stream in (1, 2):
            os.dup2(nowhere.fileno(), stream)
        used = resource.getpagesize() * int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        for kind, most in ((resource.RLIMIT_AS, used + MEMORY), (resource.RLIMIT_CPU, CPU_S)):
            # At a hard limit of time the kernel kills, as for memory.
            _, hard = resource.getrlimit(kind)
            resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        work()
        code = DONE
    except RefusedError as error:
        code = REFUSED
        with suppress(BaseException):
            os.write(writing, json.dumps([asdict(problem) for problem in error.problems[:MOST_PROBLEMS]]).encode())
    except MemoryError:
        code = MEMORY_ERROR
    finally:
        os._exit(code)
