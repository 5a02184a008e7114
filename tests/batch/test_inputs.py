"""Files, folders, patterns and lists become clips: each source once, each output of its own, in one order."""

import re
from pathlib import Path

import pytest

from messages import refuses
from retarget.batch.inputs import Shard, find_clips
from retarget.errors import UsageError


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for name in ("walk.bvh", "a/walk.bvh", "a/run.c3d", "a/b/run.AMC", "a/b/02.asf", "a/notes.md", "a/.hidden.bvh"):
        path = tmp_path / "data" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return tmp_path / "data"


def outputs(*inputs: Path | str, out: Path) -> dict[str, str]:
    clips = find_clips([str(one) for one in inputs], out=out, ending=".npz")
    assert [clip.output for clip in clips] == sorted(clip.output for clip in clips)
    return {clip.output: clip.source for clip in clips}


def test_a_folder_is_searched_with_all_below_it_and_one_without_clips_is_refused(data: Path, tmp_path: Path) -> None:
    found = outputs(data, out=tmp_path / "out")
    assert list(found) == ["a/b/run.npz", "a/run.npz", "a/walk.npz", "walk.npz"]
    assert found["a/b/run.npz"] == str(data / "a/b/run.AMC")
    assert list(outputs(data, out=data / "a")) == ["walk.npz"], "outputs are no inputs"
    twice = outputs(data, data / "a/../walk.bvh", data / "*.bvh", out=tmp_path / "out")
    assert len(twice) == 4, "a source that is given twice is one clip"
    (data / "empty").mkdir()
    for text in ("empty", "nowhere.bvh", "*.glb"):
        with refuses(UsageError, where="INPUT", found=text):
            outputs(data / text, out=tmp_path / "out")


@pytest.mark.parametrize("inputs", ["data", "data/*.bvh", "data/**/*.bvh", "link"])
def test_the_folder_of_outputs_is_no_input(inputs: str, data: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(data)
    with refuses(UsageError, "--out", where="INPUT"):
        outputs(tmp_path / inputs, out=data)
    if inputs != "link":
        with refuses(UsageError, "--out", where="INPUT"):
            outputs(tmp_path / inputs, out=tmp_path / "link")


def test_an_output_that_would_replace_a_source_is_refused(data: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(data)
    (data / "amass.npz").touch()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/amass.npz").symlink_to(data / "amass.npz")
    inside = data / "run_sonic/jump.bvh"
    inside.parent.mkdir()
    inside.touch()
    for inputs, out, ending in (
        ([data / "amass.npz"], data, ".npz"),
        ([tmp_path / "link/amass.npz"], data, ".npz"),
        ([data / "amass.npz"], tmp_path / "link", ".npz"),
        ([data / "amass.npz"], tmp_path / "out", ".npz"),
        ([tmp_path / "out/amass.npz"], data, ".npz"),
        ([data / "walk.bvh"], data, ".bvh"),
        ([data / "a/run.c3d", inside], data, "_sonic"),
    ):
        with refuses(UsageError, "source", where="--out"):
            find_clips([str(one) for one in inputs], out=out, ending=ending)


def test_no_output_has_the_name_of_a_table_of_the_index(data: Path, tmp_path: Path) -> None:
    for name in ("index.bvh", "INDEX-3-of-40.bvh", "index-of.bvh", "a/index.bvh"):
        (data / name).touch()
    found = [clip.output for clip in find_clips([str(data)], out=tmp_path / "out", ending=".parquet")]
    assert {"a/index.parquet", "index-of.parquet"} < set(found)
    for marked in (r"index-[0-9a-f]{8}\.parquet", r"INDEX-3-of-40-[0-9a-f]{8}\.parquet"):
        assert sum(re.fullmatch(marked, name) is not None for name in found) == 1
    assert "index.npz" in outputs(data, out=tmp_path / "out")


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("**/*.bvh", {"walk.npz", "a/walk.npz"}),
        ("*/*.bvh", {"a/walk.npz"}),
        ("a*/", {"a/walk.npz", "a/run.npz", "a/b/run.npz"}),
        ("a/[rw]*", {"walk.npz", "run.npz"}),
    ],
)
def test_a_pattern_finds_what_the_shell_would(pattern: str, found: set[str], data: Path, tmp_path: Path) -> None:
    assert set(outputs(data / pattern, out=tmp_path / "out")) == found


def test_a_list_names_files_beside_it_and_elsewhere_also_what_is_not_there(data: Path, tmp_path: Path) -> None:
    listed = data / "some.txt"
    listed.write_text(f"# two\na/walk.bvh\n\n{tmp_path}/else/where.bvh\n")
    found = outputs(listed, out=tmp_path / "out")
    assert found == {"a/walk.npz": str(data / "a/walk.bvh"), "where.npz": f"{tmp_path}/else/where.bvh"}


def test_sources_of_one_name_have_outputs_of_their_own_whatever_their_order(data: Path, tmp_path: Path) -> None:
    (data / "walk.C3D").touch()
    inputs = [data / "walk.bvh", data / "a/walk.bvh", data / "walk.C3D", data / "a/run.c3d"]
    found = outputs(*inputs, out=tmp_path / "out")
    assert len(found) == 4 and "run.npz" in found
    assert all(name.startswith("walk-") for name in found if name != "run.npz")
    assert outputs(*reversed(inputs), out=tmp_path / "out") == found


def test_a_source_keeps_its_output_whatever_comes_beside_it(data: Path, tmp_path: Path) -> None:
    """As the index has it, files of the same name that come later rename and remake none."""

    def found(*names: str, known: dict[str, str]) -> dict[str, str]:
        inputs = [str(data / name) for name in names]
        clips = find_clips(inputs, out=tmp_path / "out", ending=".npz", sources=known)
        return {clip.output: clip.source for clip in clips}

    first = found("walk.bvh", known={})
    assert first == {"walk.npz": str(data / "walk.bvh")}
    (data / "walk.c3d").touch()
    both = found("walk.bvh", "walk.c3d", known=first)
    assert len(both) == 2 and first.items() < both.items()
    (marked,) = both.keys() - first.keys()
    assert marked.startswith("walk-") and found("walk.c3d", known=both) == {marked: both[marked]}
    # Where the folder has moved, the old sources are none of this batch: its names are as before.
    (data / "walk.bvh").rename(data / "a/b/walk.bvh")
    assert found("a/b/walk.bvh", known=first) == {"walk.npz": str(data / "a/b/walk.bvh")}
    # The name may be that of an output in another format.
    assert found("walk.c3d", "a/run.c3d", known={"WALK.npz": str(data / "a/run.c3d")}).keys() == {marked, "run.npz"}


def test_shards_hold_each_clip_once(data: Path, tmp_path: Path) -> None:
    for number in range(10):
        (data / f"{number}.bvh").touch()
    clips = find_clips([str(data)], out=tmp_path, ending=".npz")
    for count in (1, 3, 14, 20):
        held = [clip for number in range(1, count + 1) for clip in Shard.parsed(f"{number}/{count}").of(clips)]
        assert sorted(held, key=lambda clip: clip.output) == list(clips)


@pytest.mark.parametrize("text", ["0/4", "5/4", "3", "a/b", "-1/2", "1/", "1/1000000000000000"])
def test_a_shard_that_cannot_be_is_refused(text: str) -> None:
    with refuses(UsageError, where="--shard", found=text):
        Shard.parsed(text)
