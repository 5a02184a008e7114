"""Raise your left arm: the one motion that proves which side is which, and that up is up."""

from collections.abc import Callable

import numpy as np

from hardware.clock import Clock
from retarget.errors import InputError
from retarget.live.performer import live_sample
from retarget.live.rest_capture import Calibrated, believing_still
from retarget.live.stream import LiveStream
from retarget.rotations import FloatArray

__all__ = ["RISE_M", "SideCheck", "check_sides"]

RISE_M = 0.3
"""So far the left wrist rises; a wrist that sinks so far tells an axis that is upside down."""
STILL_M = 0.15
"""The other wrist rises less than this meanwhile."""
SURE_S = 0.2
"""So long it must be so: a single leap proves nothing."""
WAIT_S = 10.0
LISTEN_S = 0.01

SIDES = ("left", "right")
_SWAP = "Swap the roles of the left and right trackers, or their names in the performer's file"


class SideCheck:
    """The heights of both wrists since they hung: `take` them; `passed`, or `refused` with what is wrong."""

    def __init__(self, rest: FloatArray) -> None:
        """rest (2,) m: height of the left and the right wrist at rest."""
        self.passed = False
        self.refused: tuple[str, str] | None = None
        """What is wrong, and what to do."""
        self.highest = np.zeros(2)
        """m above rest, the farthest so far."""
        self._rest = np.array(rest, dtype=float)
        self._seen: str = ""
        self._since = 0.0

    def take(self, time: float, heights: FloatArray) -> None:
        """Heights (2,) m at `time`, s; NaN where it is not known."""
        rise = heights - self._rest
        self.highest = np.fmax(self.highest, rise)
        seen = _what_moved(rise)
        if seen != self._seen:
            self._seen, self._since = seen, time
        if not seen or time - self._since < SURE_S:
            return
        self.passed = seen == "left rose"
        self.refused = _REFUSALS.get(seen)


_REFUSALS = {
    "right rose": ("the right wrist rose: left and right are exchanged", _SWAP),
    "left sank": (
        "the left wrist went down: up is down",
        "See that the convention of roles is that of the sender, and reset the trackers",
    ),
    "right sank": (
        "the right wrist went down: left and right are exchanged, and up is down",
        "See that the convention of roles is that of the sender, and which tracker is worn where",
    ),
}


def _what_moved(rise: FloatArray) -> str:
    """One wrist, alone; "" for anything else."""
    for side, row in zip(SIDES, (0, 1), strict=True):
        if not abs(rise[1 - row]) < STILL_M:  # nor NaN
            continue
        if rise[row] > RISE_M:
            return f"{side} rose"
        if rise[row] < -RISE_M:
            return f"{side} sank"
    return ""


def check_sides(
    stream: LiveStream, rest: Calibrated, *, clock: Clock, where: str, tell: Callable[[str], object]
) -> None:
    """Ask for the left arm, and see it rise. rest: where the wrists were when the performer was measured.

    Raises InputError with what rose instead, and what to do about it.
    """
    names = stream.roles.sensors
    rows = [names.index("l_wrist"), names.index("r_wrist")]
    everybody = np.ones(len(names), dtype=bool)
    check = SideCheck(rest.position[rows, 2])
    tell(f"Raise your left arm, and only that: {WAIT_S:g} s")
    end = clock.now() + WAIT_S
    while not check.passed:
        clock.sleep_until(clock.now() + LISTEN_S)
        now = clock.now()
        stream.listen(now, moving=False)
        sample = live_sample(names, believing_still(stream.read(now)), rest.alignment, believed=everybody)
        check.take(now, np.where(sample.valid[rows], sample.position[rows, 2], np.nan))
        if check.refused is not None:
            what, step = check.refused
            raise InputError(what, where=f"{where}, raise your left arm", found=_found(check), next_step=step)
        if now >= end and not check.passed:
            raise InputError(
                "the left arm was not seen to rise",
                where=f"{where}, raise your left arm",
                found=_found(check),
                allowed=f"the left wrist up by more than {RISE_M:g} m, the right one by less than {STILL_M:g} m",
                next_step="See that the trackers of both hands move with them, and try again; or --no-check-sides",
            )
    tell("left is left, and up is up: lower the arm")


def _found(check: SideCheck) -> str:
    return ", ".join(
        f"the {side} wrist rose by {100 * high:.0f} cm" for side, high in zip(SIDES, check.highest, strict=True)
    )
