"""How long a USB adapter keeps what has arrived: the latency timer of an FTDI chip, in the kernel's own files."""

from pathlib import Path

from serial import Serial

DEVICES = Path("/sys/bus/usb-serial/devices")
ASSUMED = 0.001
"""Latency, s, of an adapter that has no such timer: a USB frame."""
WANTED_MS = 1


def timer_file(path: str, devices: Path = DEVICES) -> Path:
    """Where the kernel shows the timer of the port at `path`, whatever links lead to it; it exists for FTDI only."""
    return devices / Path(path).resolve().name / "latency_timer"


def latency_timer_ms(path: str, devices: Path = DEVICES) -> int | None:
    """The timer in ms; None for an adapter without one."""
    try:
        return int(timer_file(path, devices).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def latency(timer_ms: int | None) -> float:
    """Longest time, s, that the adapter keeps bytes: the timer, and a USB frame where there is none or it says 0."""
    return timer_ms / 1000 if timer_ms else ASSUMED


def timer_command(path: str, devices: Path = DEVICES) -> str:
    """What a person types to set the timer to 1 ms, until the adapter is plugged in anew."""
    return f"echo {WANTED_MS} | sudo tee {timer_file(path, devices)}"


def ask_low_latency(line: Serial) -> bool:
    """Ask the kernel for low latency (ASYNC_LOW_LATENCY; no rights needed; an FTDI's timer becomes 1 ms).

    Whether the driver took it: many have no such thing, and say so.
    """
    try:
        line.set_low_latency_mode(True)
    except (ValueError, OSError, NotImplementedError):
        return False
    return True
