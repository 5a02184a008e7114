"""A saved run as a motion; and everything that is none, in one clear message."""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from exported import SLIDER, moved, saved, slider, with_servos
from retarget.errors import InputError
from retarget.exporting.motion import Motion
from retarget.exporting.reading import read_run
from retarget.pipeline import Pipeline
from retarget.save import write_npz
from rig import StubReconstructor, person, result, scripted_run, short_clip
from support.messages import Facts, refuses


@pytest.fixture
def motion() -> Motion:
    return with_servos(moved(slider()))


@pytest.fixture
def body(tmp_path: Path) -> Path:
    path = tmp_path / "slider.xml"
    path.write_text(SLIDER)
    return path


def test_everything_comes_back(motion: Motion, body: Path, tmp_path: Path) -> None:
    found = read_run(saved(motion, tmp_path / "run.npz", body))
    assert found.robot == "slider" and found.joint_names == motion.joint_names == ("lift", "swing", "roll")
    assert found.joint_units == ("m", "rad", "rad")
    np.testing.assert_allclose(found.q, motion.q, atol=1e-12)
    for ours, theirs in ((found.servos, motion.servos), (found.goal_ticks, motion.goal_ticks)):
        assert ours is not None and theirs is not None
        np.testing.assert_array_equal(ours, theirs)
    assert found.asked is not None and found.asked.names == ("hand", "lost")


def test_what_run_saves_is_read(tmp_path: Path) -> None:
    run = scripted_run()
    write_npz(run, tmp_path / "run.npz")
    assert run.record.robot is not None
    robot = read_run(tmp_path / "run.npz")
    assert robot.robot == "op3" and robot.rate_hz == 125.0
    np.testing.assert_allclose(robot.q, run.record.robot.q, atol=1e-12)
    followed = read_run(tmp_path / "run.npz", of_human=True)
    assert followed.robot == "human" and followed.servos is None
    np.testing.assert_allclose(followed.q, run.record.human.q, atol=1e-9)


def test_a_run_of_the_human_alone_needs_no_body_file(tmp_path: Path) -> None:
    human, clip = person(), short_clip(rate_hz=None)
    run = result(Pipeline(clip=clip, reconstructor=StubReconstructor(human)).run(), clip, human, None)
    write_npz(run, tmp_path / "run.npz")
    (tmp_path / "run_human.xml").unlink()
    found = read_run(tmp_path / "run.npz")
    assert found.robot == "human" and found.goal_ticks is None
    assert found.asked is not None and found.asked.names == clip.frames.names
    np.testing.assert_allclose(found.q, run.record.human.q, atol=1e-9)


def test_a_body_that_moved_away(motion: Motion, body: Path, tmp_path: Path) -> None:
    run = saved(motion, tmp_path / "run.npz", tmp_path / "gone" / "elsewhere.xml")
    with refuses(InputError, "--body"):
        read_run(run)
    with refuses(InputError):
        read_run(saved(motion, tmp_path / "long.npz", Path("x" * 5000)))
    assert read_run(run, body=body).joint_names == motion.joint_names
    body.rename(tmp_path / "elsewhere.xml")  # beside the run is where a colleague would have put it
    assert read_run(run).joint_names == motion.joint_names


def test_another_robots_body(motion: Motion, tmp_path: Path) -> None:
    other = tmp_path / "other.xml"
    other.write_text(SLIDER.replace('"swing"', '"swung"'))
    with refuses(InputError, "swing", "--body"):
        read_run(saved(motion, tmp_path / "run.npz", other))


BAD: dict[str, tuple[np.ndarray[tuple[int, ...], np.dtype[Any]], Facts]] = {
    "time": (np.arange(39) / 50.0, "(39, 3)"),
    "joint_positions": (np.full((40, 3), np.nan), ("joint_positions", "nan", 1)),
    "root_position": (np.full((40, 3), np.inf), "root_position"),
    "root_quaternion": (np.zeros((40, 4)), "[0. 0. 0. 0.]"),
    "joint_names": (np.arange(3), "joint_names"),
    "servo_positions": (np.zeros((40, 2)), "servo_positions"),
    "goal_ticks": (np.zeros((40, 3)), "goal_ticks"),
    "landmarks_asked": (np.zeros((40, 1, 3)), "landmarks_asked"),
    "phase": (np.full(40, "dance"), ("phase", "dance")),
}


@pytest.mark.parametrize("key", BAD)
def test_wrong_content_is_told_by_its_key(key: str, motion: Motion, body: Path, tmp_path: Path) -> None:
    value, facts = BAD[key]
    with refuses(InputError, facts):
        read_run(saved(motion, tmp_path / "run.npz", body, **{key: value}))


@pytest.mark.parametrize("time", [np.zeros(40), np.zeros(0), np.arange(40)[::-1].astype(float)])
def test_time_goes_on(
    time: np.ndarray[tuple[int], np.dtype[np.float64]], motion: Motion, body: Path, tmp_path: Path
) -> None:
    with refuses(InputError):
        read_run(saved(motion, tmp_path / "run.npz", body, time=time))


def test_missing_keys_are_listed_all_at_once(motion: Motion, body: Path, tmp_path: Path) -> None:
    run = saved(motion, tmp_path / "run.npz", body, time=None, root_position=None)
    with refuses(InputError, "root_position"):
        read_run(run)


def test_what_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("time, x\n")
    (tmp_path / "empty.npz").touch()
    np.savez(tmp_path / "other.npz", poses=np.zeros(3))
    with zipfile.ZipFile(tmp_path / "zip.npz", "w") as archive:
        archive.writestr("time.npy", b"no array")
    (tmp_path / "folder.npz").mkdir()
    for name in ("text", "empty", "other", "zip", "folder", "missing"):
        with refuses(InputError, f"{name}.npz"):
            read_run(tmp_path / f"{name}.npz")
    with refuses(InputError):
        read_run(tmp_path / "run.csv")


def test_pickles_are_never_loaded(motion: Motion, body: Path, tmp_path: Path) -> None:
    stream = io.BytesIO()
    np.save(stream, np.array([{}], dtype=object), allow_pickle=True)
    run = saved(motion, tmp_path / "run.npz", body, time=None)
    with zipfile.ZipFile(run, "a") as archive:
        archive.writestr("time.npy", stream.getvalue())
    with refuses(InputError):
        read_run(run)


def test_wherever_a_file_is_cut_it_is_one_message(motion: Motion, body: Path, tmp_path: Path) -> None:
    whole = saved(motion, tmp_path / "run.npz", body).read_bytes()
    for share in np.linspace(0.0, 0.999, 40):
        (tmp_path / "cut.npz").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError):
            read_run(tmp_path / "cut.npz")


def test_a_flipped_bit_is_found_or_does_not_matter(motion: Motion, body: Path, tmp_path: Path) -> None:
    whole = saved(motion, tmp_path / "run.npz", body).read_bytes()
    rng = np.random.default_rng(5)
    refused = 0
    for place in rng.integers(0, len(whole), 150):
        hurt = bytearray(whole)
        hurt[place] ^= 1 << int(rng.integers(8))
        (tmp_path / "hurt.npz").write_bytes(hurt)
        try:
            read_run(tmp_path / "hurt.npz")
        except InputError:
            refused += 1
    assert refused > 100
