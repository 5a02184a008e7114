"""`python -m benchmarks.paper`: pictures, numbers and a table, with and without recordings; and what is refused."""

import json
from pathlib import Path

import pytest

from benchmarks.paper.__main__ import main
from messages import shows
from retarget.cli.exit import DONE, REFUSED


def paper(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as leaving:
        main([*map(str, words)])
    return int(leaving.value.code or 0)


@pytest.mark.long
def test_figures_without_recordings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("figure4", "figure5", "figure6")
    assert paper("--out", tmp_path / "new", "--only", ",".join(("jog", "jump", *names))) == DONE
    files = {path.name for path in (tmp_path / "new").iterdir()}
    assert files == {"experiments.json", *(f"{name}.png" for name in names)}
    for name in names:
        picture = (tmp_path / "new" / f"{name}.png").read_bytes()
        assert picture.startswith(b"\x89PNG") and 10_000 < len(picture) < 1_000_000
    data = json.loads((tmp_path / "new/experiments.json").read_text())
    assert set(data) == set(names)
    assert data["figure6"]["one_obstacle"]["most_links_acting"] == 1
    assert data["figure6"]["two_obstacles"]["most_links_acting"] == 2
    assert "figure6.png" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words, hint",
    [
        (("--only", "figure7"), "figure4"),
        (("--only", ","), "nothing"),
        (("--mocap", "no/such/folder"), "--mocap"),
        (("--n-ik", "0"), "n-ik"),
    ],
)
def test_refused_before_anything_is_written(
    words: tuple[str, ...], hint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert paper("--out", tmp_path / "new", *words) == REFUSED
    assert hint in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_folder_of_the_users_own_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "experiments.json").write_text("mine", encoding="utf-8")
    assert paper("--out", tmp_path, "--only", "figure4") == REFUSED
    shows(capsys.readouterr().err)
    assert (tmp_path / "experiments.json").read_text(encoding="utf-8") == "mine"
    assert paper("--out", tmp_path, "--only", "figure4", "--overwrite") == DONE


@pytest.mark.long
def test_all_of_them_on_the_synthetic_performer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert paper("--out", tmp_path) == DONE
    shown = capsys.readouterr().out
    assert "52.6" in shown and "42.5" in shown and "40.6" in shown
    assert {"experiment_1.png", "experiment_2.png", "experiment_3.png"} <= {path.name for path in tmp_path.iterdir()}
