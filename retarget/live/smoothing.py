"""How much a live performer's sensors are smoothed, by name."""

from retarget.errors import UsageError, suggest
from retarget.live.one_euro import OneEuroSettings
from retarget.live.pose_filter import PoseFilter
from retarget.live.window_filter import WindowFilter

__all__ = ["LIGHT", "SMOOTHINGS", "WINDOW", "pose_filter"]

LIGHT = "light"
WINDOW = "window"
"""No One-Euro filter, but the mean over 120 ms: the smoothest, and always 60 ms late."""

SMOOTHINGS: dict[str, tuple[OneEuroSettings, OneEuroSettings] | None] = {
    "off": None,
    LIGHT: (OneEuroSettings(min_cutoff=4.0, beta=12.0), OneEuroSettings(min_cutoff=4.0, beta=3.0)),
    "strong": (OneEuroSettings(min_cutoff=1.0, beta=3.0), OneEuroSettings(min_cutoff=1.0, beta=1.0)),
}
"""Of positions (Hz, and Hz per m/s) and of orientations (Hz, and Hz per rad/s). light: a hand at rest trembles half as
much, and one that goes at 1 m/s lags by 10 ms."""


def pose_filter(name: str, count: int) -> PoseFilter | WindowFilter | None:
    """The filter of k sensors; None: they stay as they are. Raises UsageError for an unknown name."""
    if name == WINDOW:
        return WindowFilter(count)
    if name not in SMOOTHINGS:
        raise UsageError(
            "unknown smoothing",
            where="--smoothing",
            found=repr(name[:80]),
            allowed=", ".join((*SMOOTHINGS, WINDOW)),
            next_step=suggest(name, (*SMOOTHINGS, WINDOW)),
        )
    settings = SMOOTHINGS[name]
    return None if settings is None else PoseFilter(count, position=settings[0], orientation=settings[1])
