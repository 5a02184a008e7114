"""The recording that ships: a person's motion, and safe on every robot."""

import json
from pathlib import Path

import pytest

from messages import refuses
from retarget.cli import main
from retarget.cli.exit import DONE, REFUSED
from retarget.errors import InputError
from retarget.frames import SENSORS, SensorFrames
from retarget.schema.catalogue import Kind, entries
from retarget.setup.motion_summary import summarise
from retarget.sources.open import SAMPLE, open_source

RATE_HZ, DURATION_S = 30.0, 11.0


def command(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as leaving:
        main([*map(str, words)])
    return int(leaving.value.code or 0)


@pytest.fixture(scope="module")
def sample() -> SensorFrames:
    return open_source(SAMPLE)


def test_it_is_a_whole_person_who_moves_as_persons_do(sample: SensorFrames) -> None:
    summary = summarise(sample)
    assert summary.rate_hz == RATE_HZ and summary.frames == round(DURATION_S * RATE_HZ)
    assert 8.0 <= summary.duration_s <= 12.0
    assert set(sample.names) == set(SENSORS) and len(summary.joints) == 21
    assert summary.stature_m == pytest.approx(1.65, abs=0.1)
    assert not summary.jumps and not summary.notes


SHIPPED_ROBOTS = [entry.name for entry in entries(Kind.ROBOT) if entry.shipped]


@pytest.mark.long  # `make demo` and the golden runs play it, too
@pytest.mark.parametrize("robot", SHIPPED_ROBOTS)
def test_every_shipped_robot_follows_it_within_all_limits(robot: str, tmp_path: Path) -> None:
    assert command("run", "--robot", robot, "--source", SAMPLE, "--report", tmp_path / "run.json") == DONE
    report = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert report["frames"] == round(DURATION_S * RATE_HZ) and report["stop"]["reason"] is None
    assert report["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    assert report["penetrating_frames"] == 0 and report["com_outside_support_frames"] == 0
    assert report["hand_path_ratio"] > 0.8 and report["pelvis_excursion_ratio"] > 0.5


def test_the_bare_word_is_the_sample_and_everything_else_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sample: SensorFrames
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sample").write_text("nothing", encoding="utf-8")
    assert len(open_source("sample")) == len(sample)
    for file in ("./sample", Path("sample"), str(tmp_path / "sample")):
        with refuses(InputError):
            open_source(file)
    for file in ("sample.bvh", "Sample"):
        with refuses(InputError):
            open_source(file)
    assert command("inspect", "./sample") == REFUSED
