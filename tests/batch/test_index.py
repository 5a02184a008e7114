"""The index: what it keeps, what a killed driver leaves of it, and which clips are run again."""

import os
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from benchmarks.batch_driver import in_loop, instant
from messages import refuses
from retarget.batch.batch import run_batch
from retarget.batch.clip import BatchClip, BatchSettings, ClipRow, ClipStatus, batch_settings, process_clip
from retarget.batch.index import BatchIndex, remove_parts, still_to_do
from retarget.batch.inputs import Shard
from retarget.errors import InputError, UsageError
from retarget.run.options import RunOptions

LOOP = partial(in_loop, work=partial(process_clip, follow=instant))


@pytest.fixture
def settings(tmp_path: Path) -> BatchSettings:
    return batch_settings(tmp_path / "out", RunOptions(robot="op3"), bench="none")


def clips(folder: Path, *names: str) -> list[BatchClip]:
    for name in names:
        (folder / f"{name}.bvh").write_text(name)
    return [BatchClip(str(folder / f"{name}.bvh"), f"{name}.npz") for name in names]


def rows(settings: BatchSettings, *of: BatchClip) -> list[ClipRow]:
    return [process_clip(clip, settings, instant) for clip in of]


def kept(settings: BatchSettings, *of: BatchClip, shard: Shard | None = None) -> None:
    with BatchIndex(settings.out, shard) as index:
        for row in rows(settings, *of):
            index.add(row)


def left(settings: BatchSettings, of: list[BatchClip], *, retry_failed: bool = False) -> list[str]:
    with BatchIndex(settings.out) as index:
        todo = still_to_do(of, settings, index.known(), retry_failed=retry_failed)
    assert len(todo.clips) + todo.done + todo.failed == len(of)
    return [clip.output for clip in todo.clips]


def test_only_lost_outputs_and_those_of_other_sources_or_settings_are_run_again(
    settings: BatchSettings, tmp_path: Path
) -> None:
    a, b = clips(tmp_path, "a", "b")
    assert left(settings, [a, b]) == ["a.npz", "b.npz"]
    kept(settings, a)
    assert left(settings, [a, b]) == ["b.npz"]
    kept(settings, b)
    (settings.out / "a.npz").unlink()
    assert left(settings, [a, b]) == ["a.npz"]
    os.utime(b.source, (1, 1))  # touched, and the same
    assert left(settings, [a, b]) == ["a.npz"]
    Path(b.source).write_text("other")
    assert left(settings, [a, b]) == ["a.npz", "b.npz"]
    kept(settings, a, b)
    assert left(settings, [a, b]) == []
    assert left(replace(settings, hash="other"), [a, b]) == ["a.npz", "b.npz"]


def test_the_hash_of_settings_changes_with_all_that_an_output_depends_on(tmp_path: Path) -> None:
    def of(options: RunOptions, **more: object) -> str:
        return batch_settings(tmp_path, options, bench="none", **more).hash  # type: ignore[arg-type]

    op3 = RunOptions(robot="op3")
    found = [
        of(op3),
        of(RunOptions(robot="poppy")),
        of(RunOptions(robot="human")),
        of(replace(op3, priorities="balanced")),
        of(replace(op3, iterations=3)),
        of(op3, reading={"unit": "cm"}),
        of(op3, form="csv"),
        of(op3, form="csv", fps=30.0),
    ]
    assert len(set(found)) == len(found) and of(op3) == found[0]


def begun(settings: BatchSettings, *of: BatchClip) -> None:
    with BatchIndex(settings.out) as index:
        index.begin(of, settings, index.known())


def test_a_batch_replaces_only_what_was_made_of_the_same_source(settings: BatchSettings, tmp_path: Path) -> None:
    a, b = clips(tmp_path, "a", "b")
    kept(settings, a)
    state, other = Path(a.source).stat(), BatchClip(b.source, a.output)
    os.utime(b.source, ns=(state.st_atime_ns, state.st_mtime_ns))  # of the same size and time
    assert left(settings, [other]) == [a.output]
    begun(settings, a, b)
    with refuses(UsageError, where="--out", found="a.npz"):
        begun(settings, other)
    (settings.out / "a.npz").unlink()
    begun(settings, other)


@pytest.mark.parametrize(
    "make", [Path.touch, Path.mkdir, lambda place: place.symlink_to("nowhere")], ids=["file", "folder", "link"]
)
def test_a_batch_that_would_replace_what_no_batch_wrote_does_not_begin(
    make: Callable[[Path], None], settings: BatchSettings, tmp_path: Path
) -> None:
    a, b = clips(tmp_path, "a", "b")
    place = settings.out / "a.npz"
    settings.out.mkdir()
    make(place)
    for _ in range(2):
        with BatchIndex(settings.out) as index, refuses(UsageError, where="--out", found="a.npz"):
            run_batch([a, b], settings, index, LOOP)
        assert os.path.lexists(place) and {path.name for path in settings.out.iterdir()} == {"a.npz", "index.jsonl"}


@pytest.mark.parametrize("name", ["index.jsonl", "index.parquet"])
def test_an_index_or_table_of_others_stays(name: str, settings: BatchSettings, tmp_path: Path) -> None:
    settings.out.mkdir()
    (settings.out / name).write_text("theirs")
    with refuses((UsageError, InputError), name):
        begun(settings, *clips(tmp_path, "a"))
    assert (settings.out / name).read_text() == "theirs"


def test_the_body_of_a_virtual_human_is_an_output_too(tmp_path: Path) -> None:
    (tmp_path / "a_human.xml").touch()
    settings = batch_settings(tmp_path, RunOptions(robot="human"), bench="none")
    with refuses(UsageError, where="--out", found="a_human.xml"):
        begun(settings, *clips(tmp_path, "a"))


def test_outputs_of_a_killed_driver_that_have_no_row_are_its_own(settings: BatchSettings, tmp_path: Path) -> None:
    a, b, bad = clips(tmp_path, "a", "b", "raises")

    class Killed(BaseException):
        """Ends the driver between an output and its row."""

    def engine(of: Sequence[BatchClip], settings: BatchSettings) -> Generator[ClipRow, None, None]:
        yield rows(settings, of[0])[0]
        rows(settings, of[1])
        raise Killed

    with BatchIndex(settings.out, Shard(1, 1)) as index, pytest.raises(Killed):
        run_batch([a, b, bad], settings, index, engine)
    assert (settings.out / "b.npz").exists()
    with BatchIndex(settings.out) as index, refuses(UsageError, where="--out", found="b.npz"):
        run_batch([BatchClip(a.source, b.output)], settings, index, LOOP)
    with BatchIndex(settings.out, Shard(1, 1)) as index:
        assert run_batch([a, b, bad], settings, index, LOOP).done_before == 1
    assert not [*settings.out.glob("*.begun")]


def test_a_file_of_begun_clips_that_is_none_is_refused(settings: BatchSettings) -> None:
    settings.out.mkdir()
    for text in ("", "[]", "\xff"):
        (settings.out / "index.begun").write_bytes(text.encode("latin-1"))
        with refuses(InputError, where="index.begun"):
            BatchIndex(settings.out)


def test_what_has_failed_is_run_again_only_if_asked(settings: BatchSettings, tmp_path: Path) -> None:
    a, bad = clips(tmp_path, "a", "raises")
    kept(settings, a, bad)
    assert left(settings, [a, bad]) == []
    assert left(settings, [a, bad], retry_failed=True) == ["raises.npz"]
    Path(bad.source).write_text("fixed")
    assert left(settings, [a, bad]) == ["raises.npz"]


def test_half_a_line_of_a_killed_driver_is_cut_and_a_wrong_one_is_refused_with_its_number(
    settings: BatchSettings, tmp_path: Path
) -> None:
    a, b = clips(tmp_path, "a", "b")
    kept(settings, a)
    whole = (settings.out / "index.jsonl").read_bytes()
    with (settings.out / "index.jsonl").open("ab") as file:
        file.write(b'{"source": "' + b"x" * 200_000)
    kept(settings, b)
    assert (settings.out / "index.jsonl").read_bytes().startswith(whole + b'{"source": "' + b.source.encode())
    assert left(settings, [a, b]) == []
    with (settings.out / "index.jsonl").open("ab") as file:
        file.write(b"{}\n")
    with BatchIndex(settings.out) as index, refuses(InputError, "index.jsonl:3"):
        index.known()


def test_two_drivers_of_one_index_are_refused_and_two_shards_are_not(settings: BatchSettings) -> None:
    with BatchIndex(settings.out), BatchIndex(settings.out, Shard(1, 2)), refuses(UsageError, where="--out"):
        BatchIndex(settings.out)


def test_shards_know_of_each_other_and_the_whole_table_has_each_clip_once(
    settings: BatchSettings, tmp_path: Path
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra record is not installed")
    a, b, bad = clips(tmp_path, "a", "b", "raises")
    kept(settings, a, shard=Shard(1, 2))
    kept(settings, bad, b, bad, shard=Shard(2, 2))
    assert left(settings, [a, b, bad]) == []
    with BatchIndex(settings.out) as index:
        table = parquet.read_table(index.write_table()).to_pydict()
    assert table["output"] == ["a.npz", "b.npz", "raises.npz"]
    assert table["status"] == ["done", "done", "failed"] and table["frames"] == [1, 1, None]
    assert table["error"][2] == "ZeroDivisionError" and "planted" in table["message"][2]


def test_a_row_is_small_whatever_the_error_says(settings: BatchSettings, tmp_path: Path) -> None:
    def talks(clip: BatchClip, settings: BatchSettings) -> ClipRow:
        raise RuntimeError("word " * 100_000)

    row = process_clip(clips(tmp_path, "a")[0], settings, talks)
    assert row.status is ClipStatus.FAILED and len(row.as_json()) < 3000


def test_what_a_killed_process_left_half_is_removed_and_nothing_else(settings: BatchSettings, tmp_path: Path) -> None:
    settings.out.mkdir()
    half = [".a.npz.abcd_123.part", ".a.npz.abcdefgh"]
    others = [".b.npz.abcdefgh.part", "a.npz", ".a.npz", ".a.npz.part"]
    (settings.out / half[1]).mkdir()
    for name in (half[0], *others):
        (settings.out / name).touch()
    remove_parts(settings.out, clips(tmp_path, "a"))
    assert {path.name for path in settings.out.iterdir()} == set(others)
