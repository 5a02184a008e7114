"""stdout that never costs a run its files: a reader that left and a full device are remembered, not raised."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO, cast

__all__ = ["Screen", "careful_stdout"]


class Screen:
    """A text stream in front of another one. failure: the first error of the stream; what comes after it is lost."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write, or remember why not."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self.lose(error)
            return len(text)

    def flush(self) -> None:
        """Flush, or remember why not."""
        try:
            self._stream.flush()
        except OSError as error:
            self.lose(error)

    @property
    def reason(self) -> str:
        """Why not everything was shown; empty if it was, or if the reader had seen enough (`| head`)."""
        if self.failure is None or isinstance(self.failure, BrokenPipeError):
            return ""
        return self.failure.strerror or str(self.failure)

    def lose(self, error: OSError) -> None:
        """Remember why not everything was shown; what comes is not shown."""
        self.failure = self.failure or error
        # What is still buffered goes nowhere, so that the interpreter has nothing to complain about at its end.
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def careful_stdout() -> Iterator[Screen | None]:
    """Put a `Screen` in front of stdout, flushed in the end; None where the process has no stdout."""
    stream = sys.stdout
    if stream is None:
        yield None
        return
    screen = Screen(stream)
    sys.stdout = cast(TextIO, screen)
    try:
        yield screen
    finally:
        screen.flush()
        sys.stdout = stream
