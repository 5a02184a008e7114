"""Keys of a terminal, one at a time, and the terminal as it was afterwards."""

import os
import pty
import termios

from retarget.cli.keys import Keys


def test_keys_come_without_enter_and_the_terminal_is_as_it_was() -> None:
    master, terminal = pty.openpty()
    try:
        before = termios.tcgetattr(terminal)
        with Keys(terminal) as keys:
            assert keys.listens and keys.pressed() == ""
            os.write(master, b" p")
            assert keys.pressed() == " p"
            assert termios.tcgetattr(terminal) != before
        assert termios.tcgetattr(terminal) == before
        os.close(master)
        master = -1
        assert keys.pressed() == "" and keys.pressed() == ""
    finally:
        for fd in (master, terminal):
            if fd >= 0:
                os.close(fd)


def test_without_a_terminal_there_are_none() -> None:
    reading, writing = os.pipe()
    os.close(writing)
    with Keys() as keys:
        assert keys.pressed() == ""
    os.close(reading)
