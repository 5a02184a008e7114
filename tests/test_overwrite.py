"""Nothing that is there is replaced unless --overwrite asks for it, and that is said before anything runs."""

import shlex
from pathlib import Path

import pytest

from recordings import Recorded, record
from retarget.cli import main
from retarget.cli.boundary import DONE, REFUSED
from retarget.cli.outputs import PICTURE_NAMES
from retarget.errors import UsageError
from retarget.outputs import check_place, refuse_existing
from retarget.plots import PICTURES
from retarget.recording.reading import read_recording
from support.messages import refuses, shows

MINE = b"mine"


def code_of(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as left:
        main([*map(str, words)])
    return int(left.value.code or 0)


@pytest.fixture
def short(shared: Path) -> list[str | Path]:
    source = shared / "mocap" / "cmu_asfamc" / "02_06.amc"
    return ["run", "--robot", "op3", "--source", source, "--end", "0.1"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("overwrite") / "run.mcap", seconds=0.1)


OUTPUTS = {
    "report": (("--report", "r.json"), "r.json"),
    "page": (("--report", "."), "report.html"),
    "report of a page": (("--report", "."), "report.json"),
    "save": (("--save", "r.npz"), "r.npz"),
    "plots": (("--plots", "."), "angles.png"),
    "record": (("--record", "r.mcap"), "r.mcap"),
}


@pytest.mark.parametrize("case", OUTPUTS)
def test_a_run_is_refused_before_it_begins(
    case: str,
    short: list[str | Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words, name = OUTPUTS[case]
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_bytes(MINE)
    assert code_of(*short, *words) == REFUSED
    told = capsys.readouterr()
    shows(told.err, words[0], name, "--overwrite")
    assert told.out == "" and (tmp_path / name).read_bytes() == MINE
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_all_of_them_are_replaced_where_that_is_asked_for(
    short: list[str | Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for _, name in OUTPUTS.values():
        (tmp_path / name).write_bytes(MINE)
    words = [word for (option, place), name in OUTPUTS.values() if name != "r.json" for word in (option, place)]
    assert code_of(*short, *words, "--overwrite") == DONE
    kept = {name for _, name in OUTPUTS.values() if (tmp_path / name).read_bytes() == MINE}
    assert kept == {"r.json"}
    assert read_recording(tmp_path / "r.mcap").damage == ""


def test_a_link_is_something_too(short: list[str | Path], tmp_path: Path) -> None:
    (tmp_path / "r.json").symlink_to(tmp_path / "nothing")
    assert code_of(*short, "--report", tmp_path / "r.json") == REFUSED
    with refuses(UsageError):
        refuse_existing(tmp_path / ("x" * 5000), option="--out")


def test_a_replay(recorded: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "again.npz"
    out.write_bytes(MINE)
    assert code_of("replay", recorded.path, "--save", out) == REFUSED
    shows(capsys.readouterr().err)
    assert out.read_bytes() == MINE
    assert code_of("replay", recorded.path, "--save", out, "--overwrite") == DONE
    assert out.read_bytes() != MINE


def test_a_recording_that_is_played_is_not_replaced_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = tmp_path / "a.raw"
    raw.write_bytes(MINE)
    words: list[str | Path] = ["run", "--robot", "op3", "--source", f"replay://{raw}", "--record-raw", raw]
    assert code_of(*words, "--overwrite") == REFUSED
    shows(capsys.readouterr().err)
    assert raw.read_bytes() == MINE


def test_a_proposal_of_observers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "observers.yaml"
    out.write_bytes(MINE)
    words: list[str | Path] = ["fit-observers", "op3", "--samples", "50", "--out", out]
    assert code_of(*words) == REFUSED and out.read_bytes() == MINE
    assert code_of(*words, "--overwrite") == DONE and out.read_bytes() != MINE


def test_a_folder_of_the_users_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The default folder under out/ is the command's, and is made anew."""
    (tmp_path / "report.json").write_bytes(MINE)
    assert code_of("demo", tmp_path) == REFUSED
    shows(capsys.readouterr().err)
    assert {path.read_bytes() for path in tmp_path.iterdir()} == {MINE}


def test_a_folder_to_be_made_can_be_pasted_into_a_shell(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as refused:
        check_place(tmp_path / "my runs" / "r.npz", option="--save")
    command = str(refused.value).split("Make it first: ")[1].removesuffix(".")
    assert shlex.split(command) == ["mkdir", "-p", str(tmp_path / "my runs")]


def test_pictures_are_known_by_name_without_drawing_them() -> None:
    assert tuple(PICTURES) == PICTURE_NAMES
