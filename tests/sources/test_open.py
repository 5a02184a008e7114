"""Opening any motion file: the right reader by content and suffix, and refusals before anything is read."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from messages import Facts, refuses
from motion_texts import amc_text, asf_text, bvh_text, c3d_bytes, write_amc
from retarget.errors import InputError, UsageError
from retarget.frames import SensorFrames, stature
from retarget.human.calibration import calibrate
from retarget.sources import files
from retarget.sources.files import MAX_FILE_BYTES
from retarget.sources.open import open_source, recognise


def test_content_comes_before_suffix_and_case_does_not_matter(tmp_path: Path) -> None:
    bvh, amc = bvh_text().encode(), amc_text().encode()
    for kind, names, content in (
        ("bvh", ("a.bvh", "A.BVH", "a", "a.amc"), bvh),
        ("bvh", ("a.txt",), b"# exported\n\n" + bvh),
        ("c3d", ("b.c3d", "B.C3D", "b.bin"), c3d_bytes()),
        ("amc", ("c.amc", "C.AMC", "c.txt"), amc),
    ):
        for name in names:
            (tmp_path / name).write_bytes(content)
            assert recognise(tmp_path / name) == kind


def of_each_format(folder: Path) -> tuple[Path, Path, Path]:
    """An AMC, a BVH and a C3D."""
    bvh, c3d = folder / "a.bvh", folder / "a.c3d"
    bvh.write_text(bvh_text())
    c3d.write_bytes(c3d_bytes())
    return write_amc(folder, amc_text()), bvh, c3d


def test_every_format_opens_by_path_or_by_text(tmp_path: Path) -> None:
    amc, bvh, c3d = of_each_format(tmp_path)
    for path in (amc, bvh, c3d):
        assert isinstance(open_source(str(path)), SensorFrames)
        assert open_source(path, rate=25.0).time[1] == 0.04
        assert open_source(path, unit="mm" if path == c3d else "cm").source == str(path)
        with refuses(InputError, "0.1 to 10000", where="--rate"):
            open_source(path, rate=0.0)


def test_a_stature_scales_what_has_joints_and_is_the_size_of_what_has_none(tmp_path: Path) -> None:
    amc, bvh, c3d = of_each_format(tmp_path)
    for path in (amc, bvh):
        plain, scaled = open_source(path), open_source(path, stature=1.5)
        assert plain.skeleton is not None and scaled.skeleton is not None
        assert stature(scaled.skeleton) == pytest.approx(1.5)
        factor = 1.5 / (stature(plain.skeleton) or 0.0)
        np.testing.assert_allclose(scaled.position, factor * plain.position, atol=1e-12)
        with refuses(UsageError, where=("--stature", "--unit")):
            open_source(path, stature=1.5, unit="m")
    assert calibrate(open_source(c3d, stature=1.62)).stature == pytest.approx(1.62, abs=0.01)
    for wrong in (17.0, float("nan")):
        with refuses(UsageError, where="--stature"):
            open_source(bvh, stature=wrong)


def test_the_up_axis_can_be_said_and_a_root_only_for_a_bvh(tmp_path: Path) -> None:
    _, bvh, c3d = of_each_format(tmp_path)
    plain = open_source(bvh)
    at = plain.position[:, plain.index("head")]
    for up, height in (("y", at[:, 2]), ("-y", -at[:, 2]), ("+Z", at[:, 0]), ("x", at[:, 1])):
        lying = open_source(bvh, up=up)
        np.testing.assert_allclose(lying.position[:, lying.index("head"), 2], height, atol=1e-12)
        assert any("--up" in note for note in lying.notes) == (up != "y")
    with refuses(UsageError, where="--up", found="up"):
        open_source(bvh, up="up")
    with refuses(UsageError, next_step="--performer-root"):
        open_source(c3d, performer_root="Hips")


def test_a_skeleton_can_be_named_but_only_for_an_amc(tmp_path: Path) -> None:
    skeleton, amc, bvh = tmp_path / "other.asf", tmp_path / "lone.amc", tmp_path / "a.bvh"
    for path, text in ((skeleton, asf_text()), (amc, amc_text()), (bvh, bvh_text())):
        path.write_text(text)
    with refuses(InputError, "--skeleton"):
        open_source(amc)
    assert len(open_source(amc, skeleton=str(skeleton))) == 3
    with refuses(UsageError, "AMC"):
        open_source(bvh, skeleton=skeleton)
    with refuses(UsageError, "--markers"):
        open_source(bvh, markers=tmp_path / "table.yaml")
    with refuses(InputError):
        open_source(amc, skeleton=tmp_path / "missing.asf")


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("a.asf", asf_text(), "--skeleton"),
        ("a.txt", asf_text(), ()),
        ("a.xyz", "something", ("suffix", "'.xyz'", "amc", "bvh", "c3d", "gltf", "mvnx", "npz", "trc")),
        ("a", "something", "suffix"),
        ("a.bvh", "something", "BVH"),
        ("a.bvh", "\0\1\2", "NUL"),
        ("a.bvh", " \n ", ()),
        ("a.c3d", "something", "C3D"),
        ("a.amc", "", ()),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_file_named(
    tmp_path: Path, name: str, content: str, what: Facts
) -> None:
    path = tmp_path / name
    path.write_text(content)
    with refuses(InputError, what) as caught:
        open_source(path)
    assert str(path) in str(caught.value)


def test_missing_files_folders_and_odd_paths_are_refused(tmp_path: Path) -> None:
    first, lost, long = tmp_path / "missing.bvh", tmp_path / "missing" / "x.amc", tmp_path / ("x" * 5000)
    for path in (first, tmp_path, Path("/dev/null"), lost, Path("a\0b.bvh"), long):
        with refuses(InputError):
            open_source(path)


@pytest.mark.parametrize("suffix", ["amc", "bvh", "c3d"])
def test_two_gigabytes_are_refused_before_they_are_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"huge.{suffix}"
    with path.open("wb") as file:
        file.write(b"HIERARCHY\n" if suffix == "bvh" else b"\2P" if suffix == "c3d" else b"1\n")
        file.truncate(2 * 2**30)  # sparse: takes no room
    with refuses(InputError, found=(2048, "MiB"), allowed=(MAX_FILE_BYTES // 2**20, "MiB")):
        open_source(path)


def test_every_shared_file_opens_or_says_why(shared: Path) -> None:
    opened = 0
    for path in sorted((shared / "mocap").rglob("*")):
        if not path.is_file():
            continue
        try:
            frames = open_source(path)
        except InputError as error:
            assert path.suffix in (".asf", ".csv", ".md", ".npz", ".txt") or path.name == "walking.amc", error
            continue
        opened += 1
        assert len(frames) > 50 and frames.rate_hz in (30.0, 40.0, 120.0)
        assert frames.position[frames.valid].min() > -10.0 and frames.position[frames.valid].max() < 10.0
    assert opened == 26


@pytest.mark.parametrize("address", ["vmc://:39539", Path("vmc://:39539"), "osc://host:1/x"])
def test_live_sources_are_refused_as_files(address: str | Path) -> None:
    with refuses(InputError, "ADDRESS"):
        open_source(address)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("magic", [b"RAWDGM01", b"UDPREC01"])
def test_a_recording_of_datagrams_is_refused_as_such(tmp_path: Path, magic: bytes, packed: bool) -> None:
    path = tmp_path / "session.udprec.gz"
    content = magic + bytes(range(256)) * 40
    path.write_bytes(gzip.compress(content) if packed else content)
    with refuses(InputError, "replay:///", "?kind=vmc"):
        open_source(path)


# Reading motion files as bytes and lines, and the checks every reader shares.


def test_lines_of_any_line_ends_and_encodings_but_no_binary_content(tmp_path: Path) -> None:
    path = tmp_path / "a"
    for content in (b"a\nb\n", b"a\r\nb\r\n", b"a\rb\r", b"\xef\xbb\xbfa\nb\n"):
        path.write_bytes(content)
        assert files.read_lines(path) == ["a", "b", ""]
    path.write_bytes(b"J\xfcrgen")
    assert files.read_lines(path) == ["Jürgen"]
    path.write_bytes(b"a\nb\n\0")
    with refuses(InputError, where="a:3"):
        files.read_lines(path)
    path.write_bytes(b"x" * 10_000)
    assert len(files.read_bytes(path, files.HEAD_BYTES)) == 4096 and len(files.read_bytes(path)) == 10_000


def test_numbers_are_finite_and_of_plausible_size() -> None:
    assert files.numbers(["1", "-2.5", "7.6e-016"], "here") == [1.0, -2.5, 7.6e-16]
    assert files.numbers(["1", "-2,5", ",5E-1"], "here") == [1.0, -2.5, 0.05]
    for token in ("nan", "inf", "-Infinity", "1e10", "x", "", ",", "1,234.5", "1,2,3", "1,"):
        with refuses(InputError):
            files.numbers(["1", token], "here")


def test_counts_and_rates_have_limits() -> None:
    files.check_frame_count(1, "here")
    files.check_frame_count(files.MAX_FRAMES, "here")
    for count in (0, -1, files.MAX_FRAMES + 1):
        with pytest.raises(InputError):
            files.check_frame_count(count, "here")
    assert files.check_rate(120.0, "here") == 120.0
    for rate in (0.0, -120.0, 1e5, float("nan"), 1e-9):
        with refuses(InputError):
            files.check_rate(rate, "here")
