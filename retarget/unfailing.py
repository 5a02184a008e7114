"""What must not fail while a robot moves: a question, and whoever looks on."""

from collections.abc import Callable

from retarget.record import Record

__all__ = ["Onlooker", "Unfailing"]


class Onlooker:
    """Shows every row of a record to `look`; from its first exception on to nobody. failure: that one, in words."""

    def __init__(self, look: Callable[[Record, int], object]) -> None:
        self._look = look
        self.failure = ""

    def __call__(self, record: Record, row: int) -> None:
        """A row was filled."""
        if not self.failure:
            try:
                self._look(record, row)
            except Exception as error:  # noqa: BLE001 - a robot goes on, whoever looks on
                self.failure = f"{type(error).__name__}: {error}"


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
