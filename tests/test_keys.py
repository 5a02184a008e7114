"""Keys of a terminal, one at a time, and the terminal as it was afterwards."""

import os
import pty
import select
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


def test_ctrl_s_is_a_key_and_holds_nothing_up() -> None:
    master, terminal = pty.openpty()
    try:
        with Keys(terminal) as keys:
            os.write(master, b"\x13")
            assert keys.pressed() == "\x13"
            os.write(terminal, b"text")
            assert select.select((master,), (), (), 1.0)[0] and os.read(master, 9) == b"text"
        assert termios.tcgetattr(terminal)[0] & termios.IXON
    finally:
        os.close(master)
        os.close(terminal)


def test_a_terminal_that_goes_away_is_no_error() -> None:
    master, terminal = pty.openpty()
    with Keys(terminal) as keys:
        os.close(master)
        assert keys.listens
    os.close(terminal)


def test_without_a_terminal_there_are_none() -> None:
    reading, writing = os.pipe()
    os.close(writing)
    with Keys() as keys:
        assert keys.pressed() == ""
    os.close(reading)
