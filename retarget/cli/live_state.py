"""What a live run does right now and since when it has run, on a terminal; nothing in a pipe."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from retarget.cli.live_controls import LiveStatus

__all__ = ["live_state", "words_for"]


def words_for(status: LiveStatus, *, approaching: bool) -> str:
    """How it is now, in a word or a few."""
    if status.stop is not None or status.state == "stopping":
        return "stopping"
    if status.let_go:
        return "paused: holding"
    if approaching:
        return "on its way to the performer"
    return "following" if status.followed else "holding"


@contextmanager
def live_state(what: str, words: Callable[[], str]) -> Iterator[None]:
    """A line on stderr. words: how it is now; asked by a thread of its own, some times a second."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
    from rich.text import Text

    class Words(ProgressColumn):
        """Asked whenever the line is drawn."""

        def render(self, task: Task) -> Text:
            return Text(words())

    columns = (SpinnerColumn(), TextColumn("{task.description}"), Words(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as line:
        line.add_task(what, total=None)
        yield
