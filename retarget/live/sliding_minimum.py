"""The least value of the last few seconds, in memory that does not grow."""

from math import inf

__all__ = ["SlidingMinimum"]


class SlidingMinimum:
    """Minimum over a window of `window` s, kept in `buckets` parts: it forgets a part at a time.

    What is added is remembered for at least (1 - 1/buckets) of the window and at most for the whole of it.
    """

    def __init__(self, window: float, *, buckets: int = 8) -> None:
        assert window > 0.0 and buckets > 1
        self._width = window / buckets
        self._least = [inf] * buckets
        self._bucket: int | None = None

    def add(self, now: float, value: float) -> None:
        """Add a value at a time (s); a time before the last one counts as the last one."""
        index = self._turn_to(now)
        if value < self._least[index]:
            self._least[index] = value

    def at(self, now: float) -> float:
        """The least value that is remembered at `now`; infinity where there is none."""
        self._turn_to(now)
        return min(self._least)

    def clear(self) -> None:
        """Forget everything."""
        self._least[:] = [inf] * len(self._least)
        self._bucket = None

    def _turn_to(self, now: float) -> int:
        """Empty the buckets that were entered since; the index of the present one."""
        count = len(self._least)
        bucket = int(now // self._width)
        if bucket == self._bucket:
            return bucket % count
        if self._bucket is None:
            self._bucket = bucket
        for entered in range(max(self._bucket + 1, bucket - count + 1), bucket + 1):
            self._least[entered % count] = inf
        self._bucket = max(self._bucket, bucket)
        return self._bucket % count
