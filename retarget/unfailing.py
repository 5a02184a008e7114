"""A question that must not fail while a robot brakes."""

from collections.abc import Callable

__all__ = ["Unfailing"]


class Unfailing:
    """Asks `question`. From its first exception on the answer is no, and nobody is asked any more; `settle` raises it,
    when the robot stands."""

    def __init__(self, question: Callable[[], bool]) -> None:
        self._question = question
        self._failure: Exception | None = None

    def __call__(self) -> bool:
        """The answer."""
        if self._failure is None:
            try:
                return self._question()
            except Exception as error:  # noqa: BLE001 - raised again by `settle`
                self._failure = error
        return False

    def settle(self) -> None:
        """Raise what the question failed with, if it did."""
        if self._failure is not None:
            raise self._failure
