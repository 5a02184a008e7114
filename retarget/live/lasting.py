"""Whether something has been good for long enough to be relied upon again."""

__all__ = ["Lasting"]


class Lasting:
    """From bad on it takes `healthy` s of good. good: whether it is taken to have been good until now."""

    def __init__(self, healthy: float, *, good: bool = False) -> None:
        self._healthy = healthy
        self._since = -float("inf") if good else None

    def restart(self) -> None:
        """It is bad now."""
        self._since = None

    def step(self, now: float, *, good: bool) -> bool:
        """Whether it has lasted at `now`, s."""
        if not good:
            self._since = None
        elif self._since is None:
            self._since = now
        return self._since is not None and now - self._since >= self._healthy
