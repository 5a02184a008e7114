"""`retarget view FILE`: a recorded run on a web page that only this machine reaches."""

from pathlib import Path
from typing import Annotated

import typer

from hardware.clock import MonotonicClock
from retarget.cli.interrupt import stop_on_signals
from retarget.viewer.door import PORT
from retarget.viewer.from_mcap import open_viewed
from retarget.viewer.page import RecordedPage
from retarget.viewer.server import close_server, open_server

SHOWN_HZ = 30.0


def view(
    file: Annotated[
        Path, typer.Argument(help="A run that was saved or recorded: FILE.npz, FILE.mcap.", metavar="FILE")
    ],
    port: Annotated[
        int, typer.Option(help="Of the page, on this machine; 0: any.", metavar="PORT", min=0, max=65535)
    ] = PORT,
) -> None:
    """Show a recorded run on a web page: performer, robot, goals and joints, at any speed. Ctrl-C ends it.

    Open the address that is printed; its key keeps other pages and users out.
    """
    run = open_viewed(file)
    for note in run.notes:
        typer.echo(f"note: {file}: {note}", err=True)
    server, address = open_server(port, title=f"retarget: {file.name}")
    try:
        page, clock = RecordedPage(server, run, MonotonicClock()), MonotonicClock()
        typer.echo(f"{file.name}: {len(run.times)} ticks. Open {address} ; Ctrl-C ends it")
        with stop_on_signals() as stop:
            while not stop():
                page.tick()
                clock.sleep_until(clock.now() + 1.0 / SHOWN_HZ)
    finally:
        close_server(server)
