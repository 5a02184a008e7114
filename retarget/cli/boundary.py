"""The one place where an error of a command becomes a message and an exit code."""

import sys
import traceback
from collections.abc import Callable

from hardware.errors import RetargetError, TorqueError
from retarget.cli.interrupt import all_as_ctrl_c
from retarget.cli.screen import careful_stdout

DONE = 0
STOPPED = 1
"""Stopped by the guard or by the user while something moved, or a file could not be written afterwards."""
REFUSED = 2
"""Refused before anything moved: a bad file, a bad option. Also: what was to be said could not be printed."""
DEFECT = 3
"""An error that we did not foresee."""
INTERRUPTED = 130
"""Ctrl-C, SIGTERM, SIGHUP, SIGQUIT before anything moved: 128 + SIGINT, as shells count; typer leaves with it too."""


def exit_code_of(command: Callable[[], object]) -> int:
    """Run `command` and return its exit code; what went wrong is on stderr, a traceback only for our own defects.

    A signal that asks the process to end is as Ctrl-C. A reader of stdout that leaves early changes nothing; a stdout
    that takes nothing is told of.
    """
    with careful_stdout() as screen:
        code = _code_of(command)
    if screen is None or not screen.reason:
        return code
    _say(f"error: stdout: cannot print: {screen.reason}. Files that were asked for are written all the same.")
    return code or REFUSED


def _code_of(command: Callable[[], object]) -> int:
    try:
        with all_as_ctrl_c():
            command()
    except SystemExit as leaving:
        return _code_of_exit(leaving)
    except TorqueError as error:
        _say(f"error: {error}")
        return STOPPED
    except KeyboardInterrupt:
        return _interrupted()
    except Exception as error:  # noqa: BLE001 - the outermost boundary: nothing foreseen arrives here
        if _was_interrupted(error):
            return _interrupted()
        if isinstance(error, RetargetError):
            _say(f"error: {error}")
            return REFUSED
        traceback.print_exc()
        _say("error: this is a defect of ours; please report it with the lines above")
        return DEFECT
    return DONE


def _code_of_exit(leaving: SystemExit) -> int:
    if leaving.code == INTERRUPTED:
        return _interrupted()  # typer's word for Ctrl-C inside a command
    return leaving.code if isinstance(leaving.code, int) else DONE if leaving.code is None else STOPPED


def _was_interrupted(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: an import that it cuts may come back as 'initialization failed'."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _interrupted() -> int:
    _say("interrupted")
    return INTERRUPTED


def _say(text: str) -> None:
    print(text, file=sys.stderr)  # noqa: T201
