"""Other processes of this machine, as far as this user may see them (Linux)."""

from pathlib import Path

from hardware.errors import printable

PROCESSES = Path("/proc")
LONGEST_COMMAND = 90  # characters of a command line in a message
MOST_PROCESSES = 100_000  # looked at


def named_process(number: int | str, processes: Path = PROCESSES) -> str:
    """Describe a process, for example `process 12 (retarget servo monitor --robot op3)`, without interpreter and
    folders."""
    process = processes / str(number)
    try:
        words = (process / "cmdline").read_text(encoding="utf-8", errors="replace").rstrip("\0").split("\0")
        if len(words) > 1 and Path(words[0]).name.startswith("python") and not words[1].startswith("-"):
            del words[0]
        words[0] = Path(words[0]).name or (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return f"process {number}"
    text = printable(" ".join(words), one_line=True)
    if len(text) > LONGEST_COMMAND:
        text = text[: LONGEST_COMMAND - 3] + "..."
    return f"process {number} ({text})" if text else f"process {number}"
