"""`retarget web COMMAND`: prepare `web://`. A module has the function of its command.

In: options. Out: fetched files, and control of a page. May import as `retarget.cli`.
"""

COMMANDS = {"install": "Fetch what the page needs to see a body with a camera."}
"""The line of each command in the help."""


def web() -> None:
    """Let a phone, a camera or a headset be the performer: run --source web://."""
