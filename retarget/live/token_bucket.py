"""A bound on how often something may happen: a steady rate, and a burst above it. Reads no clock."""

from math import isfinite

__all__ = ["TokenBucket"]


class TokenBucket:
    """Up to `burst` at once, `rate` a second over time: at most burst + rate * t of them in any t seconds."""

    def __init__(self, *, rate: float, burst: int) -> None:
        """Start full. Raises ValueError unless the rate is positive and finite, and the burst at least 1."""
        if not (rate > 0.0 and isfinite(rate) and burst >= 1):
            raise ValueError(f"a bucket needs a rate above 0 and a burst from 1; found {rate} and {burst}")
        self._rate, self._burst = rate, float(burst)
        self._tokens = self._burst
        self._filled: float | None = None

    def take(self, now: float) -> bool:
        """Whether one more may happen at `now`, s. A time that goes back counts as none passed."""
        if self._filled is not None and now > self._filled:
            self._tokens = min(self._burst, self._tokens + (now - self._filled) * self._rate)
        if self._filled is None or now > self._filled:
            self._filled = now
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True
