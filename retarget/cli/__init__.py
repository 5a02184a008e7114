"""The command line: a module has one command or a few, each a function of its name, with options and printing only.
A folder is a group of commands. In come words, out go an exit code and messages. It may import all other folders.

Only the chosen command is imported. `retarget stop` sends its word before anything else is imported.
"""

import atexit
import gc
import os
import sys

TYPE_CHECKING = False  # see `stop`
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

COMMANDS = {
    "demo": "See it work: no data and no hardware needed.",
    "run": "Let a robot follow a performer, live or recorded.",
    "batch": "Retarget many motion files, on this machine or a cluster; goes on where it ended.",
    "replay": "Run a recording again and compare, or send its goals to a bus.",
    "stop": "Stop a live run that has a --control-socket.",
    "inspect": "Say what is in a motion file.",
    "judge": "Judge the motion of a robot, from any program.",
    "export": "Export a recorded run: CSV, NPZ, Parquet, BVH, LeRobot.",
    "check": "Validate profiles, priorities, performers, scenes and sessions.",
    "doctor": "Say what is wrong with a stream, a servo port or this machine.",
    "view": "Look at a recorded run on a web page.",
    "web": "Prepare web://, where a phone, a camera or a headset is the performer.",
    "robots": "List the robots known by name.",
    "emulate": "Answer as a robot's servos would, on a serial port.",
    "servo": "Work with servos: find, set up, watch, rest, reboot, home.",
    "faults": "Inject every fault of the fault table into a live run, and judge what the robot does.",
    "import": "Draft a robot profile from a URDF or MJCF file.",
    "fit-observers": "Propose collision observers from a robot's body.",
}
"""The line of each command in the help."""

HOMES = {
    "demo": ("run", "demo"),
    "judge": ("inspect", "judge"),
    "faults": ("emulate", "faults"),
    "import": ("robots", "import_body"),
    "fit-observers": ("robots", "fit_observers"),
}
"""Module and function of the commands that have no module of their own name."""

_GARBAGE = 100_000
"""New objects between garbage collections: more than imports and a short run make."""


def main(arguments: "Sequence[str] | None" = None) -> None:
    """Run the command line with `arguments` (default: those of the process) and exit with its code."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    stops = _begun_stop(words[1:]) if words[:1] == ["stop"] else None
    from retarget.cli.exit import exit_code_of

    if arguments is None:
        # A process of our own starts 0.3 s earlier with seldom garbage collection, without windows of MuJoCo, plugins
        # of pydantic and threads of BLAS.
        gc.set_threshold(_GARBAGE)
        atexit.register(gc.freeze)
        os.environ.setdefault("MUJOCO_GL", "disable")
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(exit_code_of(stops or (lambda: _call(words))))


def _begun_stop(words: list[str]) -> "Callable[[], None] | None":
    """Send the word of `retarget stop` before anything else is imported. Returns the rest of the command; None if
    nothing was sent."""
    from retarget.cli.stop import confirm, sent

    try:
        client = sent(words)
    except KeyboardInterrupt as interrupt:
        pressed = interrupt

        def leave() -> None:
            raise pressed

        return leave
    return None if client is None else lambda: confirm(client)


def _call(words: list[str]) -> None:
    from retarget.cli.application import (
        HELP_ALL,
        application,
        called,
        refuse_renamed,
        refuse_repeated,
        with_values,
    )

    chosen = [word for word in words if not word.startswith("-")][:2]
    refuse_renamed(words)
    refuse_repeated(words)
    known = application(chosen, all_options=HELP_ALL in words)
    sys.exit(called(known, ["--help" if word == HELP_ALL else word for word in with_values(words)]))
