"""Whether two sensors have changed places, or one has taken the place of the other."""

from math import dist

__all__ = ["exchanged", "taken_over"]

HARDEST = 50.0
"""m/s^2: half of this times the time squared is how far a sensor may be from where it was due."""
MUCH_NEARER = 0.35
"""Share of the distance from its own place that a sensor may be from the other's."""
_Point = list[float] | tuple[float, float, float]
_Two = tuple[_Point, _Point]


def exchanged(was: _Two, due: _Two, now: _Two, elapsed: float, least: float) -> bool:
    """Whether two sensors, each told to be at `now`, are the other one.

    was: where they were told `elapsed` s ago. due: where they would be if they had gone on as they went. Each must be
    much nearer to where the other was due than to where it was due itself, and nearer to where the other was: two
    hands that meet and rebound are not due where they are, but stay on their own side. Nearer ones than `least` m, and
    those for which a hard movement would do, are not told apart.
    """
    threshold = least + _by_hard_movement(elapsed)
    for one, other in ((0, 1), (1, 0)):
        own = dist(now[one], due[one])
        if own <= threshold or dist(now[one], due[other]) > MUCH_NEARER * own:
            return False
        if dist(now[one], was[other]) >= dist(now[one], was[one]):
            return False
    return True


def taken_over(due: _Two, now: _Point, elapsed: tuple[float, float], *, least: float, calm: float) -> bool:
    """Whether a sensor that is told to be at `now` is the other one, which is not told any more.

    due: where itself and the other would be if they had gone on as they went. elapsed: s since each was told. It must
    go on from where the other was, within `calm` m and a hard movement, and be far from where it was due itself.
    """
    own, near = dist(now, due[0]), dist(now, due[1])
    far = own > least + _by_hard_movement(elapsed[0])
    return far and near <= min(MUCH_NEARER * own, calm + _by_hard_movement(elapsed[1]))


def _by_hard_movement(elapsed: float) -> float:
    """How far, m, a sensor may be from where it was due after so many s."""
    return 0.5 * HARDEST * min(elapsed, 0.1) ** 2
