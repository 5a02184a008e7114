"""`retarget web COMMAND`: prepare `web://`. A module has the function of its command."""

COMMANDS = {"install": "Fetch what the page needs to see a body with a camera."}
"""The line of each command in the help."""


def web() -> None:
    """Let a phone, a camera or a headset be the performer: run --source web://."""
