"""The one place where an error of a command becomes a message and an exit code."""

import os
import sys
import traceback
from collections.abc import Callable

from hardware.errors import RetargetError, TorqueError

DONE = 0
STOPPED = 1
"""Stopped by the guard, or interrupted by the user."""
REFUSED = 2
"""Refused before anything moved: a bad file, a bad option."""
DEFECT = 3
"""An error that we did not foresee."""


def exit_code_of(command: Callable[[], object]) -> int:
    """Run `command` and return its exit code; what went wrong is on stderr, a traceback only for our own defects."""
    try:
        command()
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else DONE if leaving.code is None else STOPPED
    except TorqueError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return STOPPED
    except RetargetError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return REFUSED
    except KeyboardInterrupt:
        print("interrupted: stopped as asked", file=sys.stderr)  # noqa: T201
        return STOPPED
    except BrokenPipeError:
        # The reader of our output has left, for example `| head`; say nothing more, at exit neither.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return STOPPED
    except Exception:  # noqa: BLE001 - the outermost boundary: nothing foreseen arrives here
        traceback.print_exc()
        print("error: this is a defect of ours; please report it with the lines above", file=sys.stderr)  # noqa: T201
        return DEFECT
    return DONE
