"""`retarget web install`: fetch the body tracker of the page."""

from pathlib import Path

from retarget.cli.application import log
from retarget.cli.exit import echo
from retarget.web import runtime


def install(archives: tuple[Path, ...] = ()) -> None:
    """Fetch what the page of web:// needs to see a body with a camera, once; 51 MB, kept in the cache.

    It is MediaPipe, from two packages of npm whose checksums are known here. A headset needs none of it. Exit code 0:
    it is there; 2: it could not be fetched, or is not what it should be.

    Arguments:
        archives [FILE.tgz]...: The two packages, as `npm pack` writes them, for a machine that is offline.
    """
    if not archives and (there := runtime.runtime_folder()):
        echo(f"it is there: {there}")
        return
    echo(f"installed: {runtime.install(archives or None, log)}")
