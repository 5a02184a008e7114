"""stdout and stderr by threads of their own: whoever moves a robot waits for no terminal, and outlives it."""

import os
import select
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO, cast

from hardware.clock import MonotonicClock
from retarget.cli.screen import Screen

__all__ = ["Detached", "detached_screens"]

MOST = 1000
"""Texts that wait for a stream that takes none (Ctrl-S, a link that hangs, a pipe nobody reads); then the oldest go."""
PATIENCE_S = 0.4
"""How long the end waits for such streams, in all."""


class Detached:
    """A text stream in front of another one. Writing neither waits nor raises. failure: the first error of the stream;
    lost: texts that nobody saw."""

    def __init__(self, stream: TextIO) -> None:
        """Start the thread."""
        self.failure: OSError | None = None
        self.encoding, self.errors = stream.encoding or "utf-8", "backslashreplace"
        self._stream, self._fd = stream, _descriptor(stream)
        self._waiting: deque[str] = deque(maxlen=MOST)
        self._changed = threading.Condition()
        self._ended = False
        self._pushed_out = self._failed = 0
        self._thread = threading.Thread(target=self._run, name="screen", daemon=True)
        self._thread.start()

    @property
    def lost(self) -> int:
        """Texts that nobody saw."""
        return self._pushed_out + self._failed

    def write(self, text: str) -> int:
        """Leave it to the thread. Raises TypeError for what is no text, as any text stream."""
        if not isinstance(text, str):
            raise TypeError(f"a text stream takes str, found {type(text).__name__}")
        with self._changed:
            self._pushed_out += len(self._waiting) == MOST
            self._waiting.append(text)
            self._changed.notify()
        return len(text)

    def flush(self) -> None:
        """Everything is on its way already."""

    def end(self) -> None:
        """Write the rest, and nothing that comes; waits for nothing."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def close(self, patience: float = PATIENCE_S) -> None:
        """Write the rest; waits so many s at most. Twice does no harm."""
        self.end()
        self._thread.join(max(patience, 0.0))

    def isatty(self) -> bool:
        """Whether a terminal is behind it. More of the stream is not shown: `buffer` would lead past the thread."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """Of the file behind it. Raises OSError where there is none."""
        return self._stream.fileno()

    def _run(self) -> None:
        while texts := self._next():
            try:
                self._put("".join(texts))
            except (OSError, ValueError) as error:  # gone, full, or closed
                self._failed += len(texts)
                if isinstance(error, OSError):
                    self.failure = self.failure or error

    def _next(self) -> list[str]:
        """All that waits; nothing at the end."""
        with self._changed:
            while not (self._waiting or self._ended):
                self._changed.wait()
            texts = [*self._waiting]
            self._waiting.clear()
            return texts

    def _put(self, text: str) -> None:
        if self._fd is None:
            self._stream.write(text)
            self._stream.flush()
            return
        data = text.encode(self.encoding, self.errors)
        while data:
            # Not through the stream: a thread that hangs in it would keep its lock, and the process its end.
            select.select((), (self._fd,), ())
            with suppress(BlockingIOError):
                data = data[os.write(self._fd, data) :]


@contextmanager
def detached_screens() -> Iterator[None]:
    """Put a `Detached` in front of stdout and stderr, as far as the process has them."""
    stdout, stderr = sys.stdout, sys.stderr
    out = None if stdout is None else Detached(stdout)
    err = None if stderr is None else Detached(stderr)
    sys.stdout, sys.stderr = cast(TextIO, out), cast(TextIO, err)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = stdout, stderr
        streams, clock = [one for one in (out, err) if one is not None], MonotonicClock()
        last = clock.now() + PATIENCE_S
        for one in streams:
            one.end()
        for one in streams:
            one.close(last - clock.now())
        if out is not None and out.failure is not None and isinstance(stdout, Screen):
            stdout.lose(out.failure)


def _descriptor(stream: TextIO) -> int | None:
    """Where the stream writes, with nothing left in it; None where it has no file."""
    with suppress(OSError, ValueError):
        stream.flush()
        return stream.fileno()
    return None
