"""C3D marker recordings: sensors from markers, lost points, and one clear error for everything that is wrong."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from messages import refuses
from motion_texts import MARKERS, c3d_bytes
from retarget.errors import InputError
from retarget.sources.c3d import (
    MarkerTracks,
    _metres,
    _one_subject,
    read_c3d,
    read_markers,
)

pytestmark = pytest.mark.filterwarnings("ignore:No analog data found:UserWarning")


def write(folder: Path, content: bytes) -> Path:
    path = folder / "trial.c3d"
    path.write_bytes(content)
    return path


def test_a_sensor_is_the_mean_of_its_markers_in_metres(tmp_path: Path) -> None:
    frames = read_c3d(write(tmp_path, c3d_bytes()))
    assert frames.names == ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle", "pelvis", "l_toe", "r_toe")
    assert frames.rate_hz == 100.0 and len(frames) == 4 and frames.valid.all()
    np.testing.assert_allclose(frames.position[0, 1], [0.0, 0.7, 1.38], atol=1e-6)
    np.testing.assert_allclose(frames.position[0, 5], [0.0, 0.0, 1.0], atol=1e-6)
    assert np.isnan(frames.orientation).all() and frames.joints is None and frames.skeleton is None


def test_prefixes_up_axis_and_unit_are_the_files_own(tmp_path: Path) -> None:
    plain = read_c3d(write(tmp_path, c3d_bytes()))
    for other in (c3d_bytes(prefix="Ann:"), c3d_bytes(y_up=True), c3d_bytes(names={"LFHD": "lfhd"})):
        np.testing.assert_allclose(read_c3d(write(tmp_path, other)).position, plain.position, atol=1e-6)
    metres = read_c3d(write(tmp_path, c3d_bytes(unit="m")))
    np.testing.assert_allclose(metres.position, 1000.0 * plain.position, rtol=1e-6, atol=1e-6)
    said = read_c3d(write(tmp_path, c3d_bytes(unit="m")), unit="mm", rate=50.0)
    np.testing.assert_allclose(said.position, plain.position, atol=1e-6)
    assert said.rate_hz == 50.0 and said.time[1] == 0.02


def test_a_lost_marker_takes_its_sensor_for_that_frame_and_is_counted(tmp_path: Path) -> None:
    frames = read_c3d(write(tmp_path, c3d_bytes(lost=[(1, "LWRA"), (2, "LWRB"), (2, "RANK")])))
    np.testing.assert_array_equal(frames.valid[:, frames.index("l_wrist")], [True, False, False, True])
    assert np.isnan(frames.position[1, frames.index("l_wrist")]).all()
    assert np.isfinite(frames.position[1, frames.index("r_wrist")]).all()
    assert frames.notes[:2] == ("l_wrist lost in 2 of 4 frames", "r_ankle lost in 1 of 4 frames")


def float_points(content: bytes) -> int:
    """Offset of the first point: the data block of the header."""
    (block,) = struct.unpack_from("<H", content, 16)
    return (int(block) - 1) * 512


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e30, 0.0])
def test_points_that_are_nowhere_are_lost(tmp_path: Path, value: float) -> None:
    content = bytearray(c3d_bytes())
    head = float_points(bytes(content)) + 16 * list(MARKERS).index("LFHD")
    struct.pack_into("<3f", content, head, *([value] * 3))
    frames = read_c3d(write(tmp_path, bytes(content)))
    assert not frames.valid[0, 0] and frames.valid[1:].all() and frames.valid[0, 1:].all()
    assert np.isnan(frames.position[0, 0]).all()


def test_of_several_performers_the_best_seen_is_read() -> None:
    labels = ("Bo:LANK", *(f"Ann:{name}" for name in MARKERS), "LFHD", "Ann:LFHD")
    columns, notes = _one_subject(labels)
    assert columns["LFHD"] == 1 and len(columns) == len(MARKERS)
    assert notes == ("2 performers in the file (Bo, Ann): only 'Ann' is read",)


def test_units_unknown_and_unstated() -> None:
    tracks = MarkerTracks(("LANK",), np.zeros((1, 1, 3)), np.ones((1, 1), bool), 100.0, "", np.array([0.0, 0.0, 1.0]))
    assert _metres(tracks, None, Path("a.c3d")) == (0.001, ("unit not stated: taken as mm (change it with --unit)",))
    odd = MarkerTracks(tracks.labels, tracks.position, tracks.seen, 100.0, "furlong", tracks.up)
    with refuses(InputError, found="'furlong'"):
        _metres(odd, None, Path("a.c3d"))
    assert _metres(odd, "cm", Path("a.c3d"))[0] == 0.01


def test_files_without_known_markers_are_refused_with_what_they_hold(tmp_path: Path) -> None:
    names = {name: f"M{i}" for i, name in enumerate(MARKERS)}
    with refuses(InputError, "LFHD", found=("M0", "M1")):
        read_c3d(write(tmp_path, c3d_bytes(names=names)))


@pytest.mark.parametrize("share", [0.01, 0.2, 0.4, 0.8, 0.95])
def test_a_file_cut_short_is_refused(tmp_path: Path, share: float) -> None:
    content = c3d_bytes(40)
    with refuses(InputError):
        read_c3d(write(tmp_path, content[: int(share * len(content))]))


def test_without_the_package_the_error_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, c3d_bytes())
    monkeypatch.setitem(sys.modules, "c3d", None)
    with refuses(InputError, "'retarget[c3d]'"):
        read_c3d(path)


def test_recordings(shared: Path) -> None:
    for name, count, points in (
        ("cmu_c3d/02_01", 343, 41),
        ("cmu_c3d/05_13", 1095, 330),
        ("other/Movement_trial", 323, 239),
    ):
        path = shared / f"mocap/{name}.c3d"
        frames = read_c3d(path)
        assert len(frames) == count and frames.rate_hz == 120.0 and len(frames.names) == 15
        assert len(read_markers(path).labels) < points
        assert frames.valid.mean() > 0.99
        head, ankle = (frames.position[:, frames.index(sensor), 2] for sensor in ("head", "l_ankle"))
        assert 1.2 < np.nanmedian(head - ankle) < 1.7
        across = frames.position[:, frames.index("l_shoulder")] - frames.position[:, frames.index("r_shoulder")]
        assert 0.25 < np.nanmedian(np.linalg.norm(across, axis=1)) < 0.5
