"""A way out of a tangle: a second posture, solved a frame a tick beside a body that misses its sensors.

A body that was led through itself, by a jump or by sensors that crossed, can end in a posture from which no small
motion leads to its sensors. A natural posture in the same place leads there within a few frames.
"""

from dataclasses import dataclass

from retarget.types import FloatArray

_MISSED_M, _MISSED_S = 0.01, 0.05
"""A body that misses a sensor by more than this for so long, though its limbs reach there, is tangled: sensors are
to be met to 10 mm."""
_FRAMES, _REACHED_M = 16, 0.005
"""At most so many frames the second posture has to come this near to all sensors."""
_BETTER = 0.5
"""After its last frame it is also taken where it misses by less than this share of what the body does."""


@dataclass(slots=True)
class SecondPosture:
    """q (nq,): the second posture; None: none is tried. frames: solved of it.

    missed_s: for how long the body has missed its sensors; patience_s: for how long it may, doubled by every try that
    fails: a sensor can be where no body goes.
    """

    q: FloatArray | None = None
    frames: int = 0
    missed_s: float = 0.0
    patience_s: float = _MISSED_S

    def is_due(self, missed: float, dt: float) -> bool:
        """Whether a second posture is to be tried in this tick of `dt` s, in which the body misses a sensor by up to
        `missed` m."""
        if missed <= _MISSED_M:
            self.q, self.frames, self.missed_s, self.patience_s = None, 0, 0.0, _MISSED_S
        else:
            self.missed_s += dt
        return self.missed_s > self.patience_s

    def keep(self, q: FloatArray, missed: float, *, by_body: float) -> bool:
        """Keep q (nq,), one frame further on, which misses a sensor by up to `missed` m while the body does `by_body`.
        Whether the body should stand in it."""
        self.q, self.frames = q, self.frames + 1
        last = self.frames == _FRAMES
        reached = missed < (_BETTER * by_body if last else _REACHED_M)
        if reached or last:
            self.q, self.frames, self.missed_s = None, 0, 0.0
            self.patience_s = _MISSED_S if reached else 2.0 * self.patience_s
        return reached
