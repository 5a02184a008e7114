"""Malformed robot files from the command line: exit code 2, one message, and no port is opened."""

from pathlib import Path

import pytest

from hardware.dynamixel.serial_port import SerialPort
from messages import shows
from retarget import cli
from retarget.cli.exit import REFUSED
from retarget.schema.catalogue import Kind, find
from sim.faults.malformed_files import MALFORMED, Malformed, judged_file


@pytest.mark.parametrize("file", MALFORMED, ids=lambda one: one.name)
def test_a_malformed_file_is_refused(
    file: Malformed, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[int] = []
    monkeypatch.setattr(SerialPort, "open", lambda self, baud: opened.append(baud))
    path = file.write(find(Kind.ROBOT, "op3"), tmp_path)
    words = ["run", "--robot", str(path), "--source", "json://127.0.0.1:14150", "--bus", str(tmp_path / "port")]
    with pytest.raises(SystemExit) as leaving:
        cli.main(words)
    message = capsys.readouterr().err
    assert (leaving.value.code, opened) == (REFUSED, [])
    assert message.startswith("error: ") and file.reason in message
    assert "Traceback" not in message


def test_the_judge_says_no(tmp_path: Path) -> None:
    sound = Malformed("sound", lambda text, folder: text, "")
    assert judged_file(sound) == ("the run went on",)
    other = Malformed("other", lambda text, folder: b"", "Elvis")
    shows(judged_file(other)[0], "'Elvis'")

    def raising(text: bytes, folder: Path) -> bytes:
        (folder / "body.xml").unlink()
        (folder / "body.xml").mkdir()
        return text

    assert judged_file(Malformed("folder", raising, "a folder")) == ()
