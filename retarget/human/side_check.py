"""The check of sides: a raised left arm shows that no axis of the world is mirrored or swapped."""

import numpy as np

from retarget.arithmetic import hypot
from retarget.types import FloatArray

RISE_M = 0.3
"""Least rise of the left wrist. A wrist that sinks by as much shows a vertical axis with the wrong sign."""
FRONT_M = 0.25  # least way forward of the left wrist; an arm to the side looks the same in a mirror
BACK_M = 0.15  # a raised arm is no farther back, as shoulders do not turn there
OTHER_RISE_M = 0.15  # most rise of the other wrist
STAYS_M = 0.25  # most horizontal motion of the other wrist, for a performer who turns around
SURE_S = 0.2  # a single jump proves nothing

RAISED, ASIDE = "left rose", "left rose aside"
REFUSED = ("right rose", "left rose behind", "left sank", "right sank")


class SideCheck:
    """Finds how both wrists move from where they hang. `take` their positions; read `seen`."""

    def __init__(self, rest: FloatArray) -> None:
        """rest (2, 3) m: the left and the right wrist at rest; x forward, z up."""
        self.seen = ""
        """Motion of one wrist for long enough while the other stayed: RAISED, ASIDE, one of REFUSED, or ""."""
        self.aside = False  # the left arm was raised to the side
        self._rest = np.array(rest, dtype=float)
        self._highest = np.zeros(2)  # [m] above rest, so far, of the left and the right wrist
        self._forward = 0.0  # [m] forward of rest, of the left wrist when it was highest
        self._now_seen, self._since = "", 0.0

    def take(self, time: float, position: FloatArray) -> None:
        """Take the positions (2, 3) m of both wrists at `time`, s; NaN where unknown."""
        moved = position - self._rest
        if moved[0, 2] > self._highest[0]:
            self._forward = float(moved[0, 0])
        self._highest = np.fmax(self._highest, moved[:, 2])
        seen = _what_moved(moved)
        if seen != self._now_seen:
            self._now_seen, self._since = seen, time
        self.seen = seen if time - self._since >= SURE_S else ""
        self.aside |= self.seen == ASIDE

    def found(self) -> str:
        """Description of how far both wrists rose."""
        left, right = 100 * self._highest
        forward = 100 * self._forward
        direction = f"forward by {forward:.0f} cm" if forward >= 0.0 else f"back by {-forward:.0f} cm"
        return f"the left wrist rose by {left:.0f} cm and went {direction}, the right wrist rose by {right:.0f} cm"


def _what_moved(moved: FloatArray) -> str:
    """Motion of one wrist while the other stayed, or "". moved (2, 3) m."""
    for row, side in enumerate(("left", "right")):
        (forward, _, up), other = moved[row], moved[1 - row]
        if not (abs(other[2]) < OTHER_RISE_M and hypot(other[0], other[1]) < STAYS_M):  # nor NaN
            continue
        if up < -RISE_M:
            return f"{side} sank"
        if up > RISE_M and side == "right":
            return "right rose"
        if up > RISE_M:
            return "left rose behind" if forward < -BACK_M else RAISED if forward > FRONT_M else ASIDE
    return ""
