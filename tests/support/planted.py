"""Failures that tests plant in methods."""

from collections.abc import Callable, Container
from itertools import count
from typing import Any


def failing(call: Callable[..., Any], error: BaseException, calls: Container[int]) -> Callable[..., Any]:
    """The same function, but for these of its calls, counted from 1, in which it does nothing and raises."""
    numbers = count(1)

    def planted(*args: Any, **words: Any) -> Any:
        if next(numbers) in calls:
            raise error
        return call(*args, **words)

    return planted
