"""Raise your left arm to the front: the one motion that proves which side is which, that up is up, and that the world
is not mirrored: its calibration turns it until left is left, and what was the front is then the back.
"""

from collections.abc import Callable

import numpy as np

from hardware.clock import Clock
from retarget.errors import InputError
from retarget.live.performer import live_sample
from retarget.live.rest_capture import Calibrated, believing_still
from retarget.live.stream import LiveStream
from retarget.live.stream_trouble import StreamTrouble
from retarget.rotations import FloatArray

__all__ = ["BACK_M", "FRONT_M", "RISE_M", "SideCheck", "check_sides"]

RISE_M = 0.3
"""So far the left wrist rises; a wrist that sinks so far tells an axis that is upside down."""
FRONT_M = 0.25
"""So far it comes forward meanwhile: less is an arm to the side, which looks the same in a mirror."""
BACK_M = 0.15
"""An arm that has risen is no farther back than this: shoulders do not turn that way."""
STILL_M = 0.15
"""The other wrist rises less than this meanwhile."""
STAYS_M = 0.25
"""And goes less far on the floor: whoever turns around shows nothing."""
SURE_S = 0.2
"""So long it must be so: a single leap proves nothing."""
WAIT_S = 10.0
LISTEN_S = 0.01

SIDES = ("left", "right")
ASIDE = "left rose aside"
_SWAP = "Swap the roles of the left and right trackers, or their names in the performer's file"


class SideCheck:
    """Where both wrists went since they hung: `take` it; `passed`, or `refused` with what is wrong."""

    def __init__(self, rest: FloatArray) -> None:
        """rest (2, 3) m: the left and the right wrist at rest; x forward, z up."""
        self.passed = False
        self.refused: tuple[str, str] | None = None
        """What is wrong, and what to do."""
        self.aside = False
        """Whether the left arm was raised to the side."""
        self.highest = np.zeros(2)
        """m above rest, the farthest so far."""
        self.forward = 0.0
        """m by which the left wrist was before its rest when it was highest."""
        self._rest = np.array(rest, dtype=float)
        self._seen: str = ""
        self._since = 0.0

    def take(self, time: float, position: FloatArray) -> None:
        """Both wrists (2, 3) m at `time`, s; NaN where it is not known."""
        moved = position - self._rest
        if moved[0, 2] > self.highest[0]:
            self.forward = float(moved[0, 0])
        self.highest = np.fmax(self.highest, moved[:, 2])
        seen = _what_moved(moved)
        if seen != self._seen:
            self._seen, self._since = seen, time
        if not seen or time - self._since < SURE_S:
            return
        self.passed = seen == "left rose"
        self.aside |= seen == ASIDE
        self.refused = _REFUSALS.get(seen)


_REFUSALS = {
    "right rose": ("the right wrist rose: left and right are exchanged", _SWAP),
    "left rose behind": (
        "the left wrist went back: the axes are mirrored",
        "One level axis of what is sent has the wrong sign, whichever: see that the convention of roles, or the axes "
        "that the sender names, are the sender's, and that it mirrors nothing",
    ),
    "left sank": (
        "the left wrist went down: up is down",
        "See that the convention of roles is that of the sender, and reset the trackers",
    ),
    "right sank": (
        "the right wrist went down: left and right are exchanged, and up is down",
        "See that the convention of roles is that of the sender, and which tracker is worn where",
    ),
}


def _what_moved(moved: FloatArray) -> str:
    """One wrist, alone; "" for anything else. moved (2, 3) m, since they hung."""
    for side, row in zip(SIDES, (0, 1), strict=True):
        other = moved[1 - row]
        if not (abs(other[2]) < STILL_M and np.hypot(other[0], other[1]) < STAYS_M):  # nor NaN
            continue
        if moved[row, 2] < -RISE_M:
            return f"{side} sank"
        if moved[row, 2] > RISE_M:
            return f"{side} rose{_whereto(moved[row, 0]) if side == 'left' else ''}"
    return ""


def _whereto(forward: float) -> str:
    if forward < -BACK_M:
        return " behind"
    return "" if forward > FRONT_M else " aside"


def check_sides(
    stream: LiveStream, rest: Calibrated, *, clock: Clock, where: str, tell: Callable[[str], object]
) -> None:
    """Ask for the left arm to the front, and see it come; once more if it goes to the side.

    rest: where the wrists were when the performer was measured. Raises InputError with what rose instead, and what to
    do about it.
    """
    names = stream.roles.sensors
    rows = [names.index("l_wrist"), names.index("r_wrist")]
    everybody = np.ones(len(names), dtype=bool)
    check, asked_again, trouble = SideCheck(rest.position[rows]), False, StreamTrouble(stream)
    tell(f"Raise your left arm forward, to the front, and only that: {WAIT_S:g} s")
    end = clock.now() + WAIT_S
    while not check.passed:
        clock.sleep_until(clock.now() + LISTEN_S)
        now = clock.now()
        stream.listen(now, moving=True)  # who was measured keeps the stream: nobody else has this size
        heard = believing_still(stream.read(now))
        sample = live_sample(names, heard, rest.alignment, believed=everybody)
        check.take(now, np.where(sample.valid[rows, None], sample.position[rows], np.nan))
        if message := trouble.look(now):
            tell(message)
        if check.refused is not None:
            what, step = check.refused
            raise InputError(what, where=f"{where}, raise your left arm", found=_found(check), next_step=step)
        if check.aside and not asked_again:
            asked_again, end = True, now + WAIT_S
            tell(f"To the front, not to the side, which looks the same in a mirrored world: {WAIT_S:g} s")
        if now >= end and not check.passed:
            lost = [names[row] for row in rows if not heard.fresh[row]]
            raise _not_heard(trouble.why(now), lost, where) or _not_seen(check, where)
    tell("left is left, up is up, and the front is in front: lower the arm")


def _not_heard(why: str, lost: list[str], where: str) -> InputError | None:
    """What is wrong with the data, where that is why nothing was seen: then the check is not what to leave out. why: of
    the stream, "" where it is well; lost: wrists that are not fresh."""
    if why:
        return InputError(why.rstrip("."), where=f"{where}, raise your left arm")
    if lost:
        step = "See that they are worn, switched on and seen, and try again"
        return InputError(
            "sensors are lost", where=f"{where}, raise your left arm", found=f"no {', no '.join(lost)}", next_step=step
        )
    return None


def _not_seen(check: SideCheck, where: str) -> InputError:
    what, step = (
        "the left arm was not seen to rise",
        "See that the trackers of both hands move with them, and try again",
    )
    if check.aside:
        what = "the left arm rose to the side only, which does not tell whether the axes are mirrored"
        step = "Raise it to the front"
    return InputError(
        what,
        where=f"{where}, raise your left arm",
        found=_found(check),
        allowed=f"the left wrist up by more than {RISE_M:g} m and forward by more than {FRONT_M:g} m, the right one "
        f"up by less than {STILL_M:g} m",
        next_step=f"{step}; or --no-check-sides",
    )


def _found(check: SideCheck) -> str:
    left, right = 100 * check.highest
    forward = 100 * check.forward
    way = f"forward by {forward:.0f} cm" if forward >= 0.0 else f"back by {-forward:.0f} cm"
    return f"the left wrist rose by {left:.0f} cm and went {way}, the right wrist rose by {right:.0f} cm"
