"""`retarget inspect`: what it shows of a motion file, as text and as JSON."""

import json
from pathlib import Path
from random import Random

import pytest

from command_line import Typed, said_by
from messages import shows
from motion_texts import amc_text, bvh_text, c3d_bytes, write_amc
from retarget.sources.streams.raw_record import RawWriter


def test_the_text_has_size_sensors_and_notes(tmp_path: Path, done: Typed) -> None:
    path = write_amc(tmp_path, amc_text(5))
    out = done("inspect", path)
    assert str(path) in out.replace("\n", "")
    shows(out, 5, 120, "0.03", "1.6", "thigh", "0.423", 23)
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines() if line.startswith(("head", "l_wrist"))}
    assert rows["head"][:2] == ["all", "all"] and rows["l_wrist"][2] == "1.30"


def test_a_program_gets_one_json_object_without_nan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(3, lost=[(i, "LANK") for i in range(3)]))
    code, out, err = said_by(capsys, "inspect", str(path), "--json")
    data = json.loads(out)
    assert code == 2 and data["refused"] in err
    assert (data["frames"], data["rate_hz"], data["joints"]) == (3, 100.0, [])
    shows(data["refused"].replace(str(path), "FILE"), "l_ankle never seen")
    ankle = next(sensor for sensor in data["sensors"] if sensor["name"] == "l_ankle")
    assert ankle["valid"] == 0.0 and ankle["highest_m"] is None and ankle["oriented"] == 0.0
    assert data["jumps"] == [] and data["stature_m"] is None


def test_a_recorded_stream_is_shown_by_the_names_of_its_sender(
    shared: Path, tmp_path: Path, done: Typed, refused: Typed
) -> None:
    path = shared / "streams/slimevr/full12_vrcosc_20hz.udprec.gz"
    data = json.loads(done("inspect", f"replay://{path}", "--json"))
    assert data["frames"] == 305 and data["rate_hz"] == pytest.approx(20.0, rel=0.05)
    assert [sensor["name"] for sensor in data["sensors"]][:2] == ["tracker://head", "tracker://6"]
    assert data["notes"] == ["not used: tracker that is none of 1 to 8 and head (1830)"]
    RawWriter(tmp_path / "empty.raw", url="json://:14150").close()
    for words in ([f"replay://{tmp_path}/empty.raw"], [f"replay://{path}", "--unit", "cm"], ["vmc:39539"]):
        shows(refused("inspect", *words).replace(str(path), "FILE").replace(str(tmp_path), "FOLDER"))


# What a run of the virtual human says: `inspect` says the same, accepted or refused, and why.


def _agree(capsys: pytest.CaptureFixture[str], path: Path) -> int:
    """Assert that both say the same; the exit code."""
    code, _, err = said_by(capsys, "inspect", path)
    ran, _, said = said_by(
        capsys, "run", "--robot", "human", "--performer", "five", "--source", path, "--bus", "none", "--end", "0.05"
    )
    refusal, refused = (text[text.index("error:") :] if "error:" in text else "" for text in (err, said))
    assert (code, refusal) == (ran, refused), path
    return code


def _bent_motion(rng: Random) -> str:
    """A BVH with up to three numbers or names exchanged, scaled, zeroed or lost."""
    lines = bvh_text(3, z_up=rng.random() < 0.3).splitlines()
    lines = [line for line in lines if rng.random() > 0.003]
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(lines))
        words = lines[at].split()
        place = rng.randrange(len(words))
        change = rng.choice(("0", "-1", "1e4", f"{rng.gauss(0.0, 60.0):g}", "x", ""))
        lines[at] = " ".join([*words[:place], change, *words[place + 1 :]])
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("seeds", [range(12), pytest.param(range(12, 200), marks=pytest.mark.long)], ids=str)
def test_inspect_and_run_say_the_same_of_damaged_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], seeds: range
) -> None:
    path = tmp_path / "bent.bvh"
    codes = set()
    for seed in seeds:
        path.write_text(_bent_motion(Random(seed)))
        codes.add(_agree(capsys, path))
    assert codes == {0, 2}


@pytest.mark.long
@pytest.mark.parametrize("folder", ["mocap", "cases"])
def test_inspect_and_run_say_the_same_of_recordings(
    shared: Path, capsys: pytest.CaptureFixture[str], folder: str
) -> None:
    files = [path for suffix in ("bvh", "amc", "c3d") for path in sorted((shared / folder).rglob(f"*.{suffix}"))]
    assert 0 in {_agree(capsys, path) for path in files}
