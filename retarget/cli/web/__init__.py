"""`retarget web COMMAND`: what `web://` needs beside this program. One file per command, with a function of its
name."""

COMMANDS = {"install": "Fetch what the page needs to see a body with a camera."}
"""Every command and its line in the list of commands."""


def web() -> None:
    """Let a phone, a camera or a headset be the performer: run --source web://."""
