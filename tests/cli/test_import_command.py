"""`retarget import` as a user meets it."""

import shlex
from pathlib import Path

import pytest

from command_line import said_by as run
from messages import mentions, shows
from unknown_robots import small_bust, table_arm


@pytest.fixture
def bust(tmp_path: Path) -> Path:
    path = tmp_path / "bust.urdf"
    path.write_text(small_bust())
    return path


def test_it_is_listed_and_explained(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--help")
    assert code == 0
    mentions(out, "URDF", "MJCF")
    code, out, _ = run(capsys, "import", "--help")
    assert code == 0 and "--no-meshes" in out


def test_import_then_check(bust: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    code, out, err = run(capsys, "import", bust, "--out", folder, "--samples", "20", "--name", "bust")
    assert code == 0 and not err
    shows(out, folder, "bust", "bust.urdf", 4, "MX-28", "--robot", folder / "robot.yaml", "--bus")
    code, out, _ = run(capsys, "check", folder)
    assert code == 0
    shows(out, 9, "DRAFT")
    text = (folder / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(text.replace("# DRAFT", "#"))
    code, out, _ = run(capsys, "check", folder)
    assert code == 0 and "DRAFT" not in out


def test_what_to_do_next_can_be_pasted_into_a_shell(
    bust: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "import", bust, "--out", tmp_path / "my bust; it's mine", "--samples", "20")
    words = shlex.split(out.split("Next: ")[1].splitlines()[0])
    assert code == 0 and words == [
        "retarget",
        "demo",
        "--robot",
        f"{tmp_path}/my bust; it's mine/robot.yaml",
        *words[4:],
    ]


def test_import_again(bust: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, "import", bust, "--out", tmp_path)
    assert code == 2 and err.count("error:") == 1
    shows(err)


def test_what_is_not_complete(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(table_arm())
    code, out, _ = run(capsys, "import", path, "--out", tmp_path / "arm", "--samples", "20")
    assert code == 0
    shows(out, "l_hand")
    code, _, err = run(capsys, "check", tmp_path / "arm")
    assert code == 2
    shows(err, "l_hand")
