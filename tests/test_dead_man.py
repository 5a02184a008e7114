"""What must be held: a key of the terminal or a pedal; anything else is refused."""

import os
from pathlib import Path

import pytest

from hardware.errors import HardwareError
from hardware.key_device import EVENT
from retarget.cli.dead_man import open_dead_man
from retarget.errors import UsageError
from support.messages import refuses


def test_a_pedal_with_and_without_a_key(tmp_path: Path) -> None:
    path = tmp_path / "event3"
    os.mkfifo(path)
    fd = os.open(path, os.O_RDWR)
    for text, code, counts in (("", 57, True), ("#57", 57, True), ("#57", 30, False)):
        dead_man = open_dead_man(f"pedal:{path}{text}", terminal=False)
        assert not dead_man.held("", 0.0) and str(path) in dead_man.told
        os.write(fd, EVENT.pack(0, 0, 1, code, 1))
        assert dead_man.held("", 0.0) == counts and not dead_man.lost
        dead_man.close()
    dead_man = open_dead_man(f"pedal:{path}", terminal=False)
    os.close(fd)
    assert not dead_man.held("", 0.0) and f"{path}: " in dead_man.lost


def test_a_key_needs_a_terminal() -> None:
    assert "'b'" in open_dead_man("b", terminal=True).told
    with refuses(UsageError):
        open_dead_man("b", terminal=False)


@pytest.mark.parametrize(
    "text", ["", " ", "p", "h", "bb", "é", "\x1b", "pedal", "event5", "pedal:event5#a", "pedal:x#"]
)
def test_what_cannot_be_held_is_refused(text: str) -> None:
    with pytest.raises((UsageError, HardwareError)) as refused:
        open_dead_man(text, terminal=True)
    assert "--dead-man" in str(refused.value) or text == "pedal:x#"
