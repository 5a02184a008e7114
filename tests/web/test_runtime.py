"""The body tracker's runtime comes into the cache whole or not at all, and its models know how to scale pictures."""

import errno
import gzip
import hashlib
import io
import os
import struct
import tarfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import InputError, UsageError
from retarget.web import runtime
from retarget.web.runtime import MODEL, Package, install, runtime_folder, with_scaling

WASM = ("package/wasm/vision_wasm_module_internal.js", "package/wasm/vision_wasm_module_internal.wasm")


def model() -> bytes:
    """A model by hand: version 3, no codes and subgraphs, two buffers of which one holds data."""
    layout = struct.pack("<9H", 18, 16, 4, 0, 0, 8, 12, 0, 0)  # slots: version, codes, graphs, description, buffers
    root = struct.pack("<iIII", len(layout), 3, 8, 16)  # the layout before, the description and buffers behind
    text = struct.pack("<I", 4) + b"tiny" + b"\0" * 4
    buffers = struct.pack("<III", 2, 20, 20)
    empty, full = struct.pack("<HH", 4, 4), struct.pack("<HHHH", 6, 8, 4, 0)
    tables = empty + full + struct.pack("<i", 12) + struct.pack("<iI", 12, 4)
    data = struct.pack("<I", 5) + b"bytes" + b"\0" * 7
    start = 8 + 2 + len(layout)
    return struct.pack("<I4s", start, b"TFL3") + b"\0\0" + layout + root + text + buffers + tables + data


class Reader:
    """A reader of FlatBuffers, by the format's own description."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def at(self, place: int, code: str) -> int:
        assert place % struct.calcsize(code) == 0, "not aligned"
        return int(struct.unpack_from("<" + code, self.data, place)[0])

    def to(self, place: int) -> int:
        return place + self.at(place, "I")

    def field(self, table: int, slot: int) -> int:
        """Place of a field, 0 for none."""
        layout = table - self.at(table, "i")
        there = 4 + 2 * slot < self.at(layout, "H")
        offset = self.at(layout + 4 + 2 * slot, "H") if there else 0
        return table + offset if offset else 0

    def child(self, table: int, *slots: int) -> int:
        for slot in slots:
            table = self.to(self.field(table, slot))
        return table

    def tables(self, vector: int) -> list[int]:
        return [self.to(vector + 4 + 4 * number) for number in range(self.at(vector, "I"))]

    def raw(self, vector: int) -> bytes:
        return self.data[vector + 4 : vector + 4 + self.at(vector, "I")]

    def number(self, vector: int) -> float:
        assert self.at(vector, "I") == 1
        return float(struct.unpack_from("<f", self.data, vector + 4)[0])


def check_model(data: bytes, mean: float, deviation: float, *, times: int = 1) -> None:
    """A scaled `model()`: all of the old, and the scaling where the runtime looks for it."""
    read = Reader(data)
    assert data[4:8] == b"TFL3"
    root = read.to(0)
    assert read.at(read.field(root, 0), "I") == 3
    assert read.raw(read.child(root, 3)) == b"tiny"
    buffers = read.tables(read.child(root, 4))
    assert len(buffers) == 2 + times
    assert read.field(buffers[0], 0) == 0
    assert read.raw(read.child(buffers[1], 0)) == b"bytes"
    entries = read.tables(read.child(root, 6))
    assert [read.raw(read.child(entry, 0)) for entry in entries] == times * [b"TFLITE_METADATA"]
    held = read.child(buffers[read.at(read.field(entries[-1], 1), "I")], 0)
    assert (held + 4) % 16 == 0
    inner = Reader(read.raw(held))
    assert inner.data[4:8] == b"M001"
    (graph,) = inner.tables(inner.child(inner.to(0), 3))
    (tensor,) = inner.tables(inner.child(graph, 2))
    content = inner.child(tensor, 3)
    assert (inner.data[inner.field(content, 0)], inner.data[inner.field(inner.child(content, 1), 0)]) == (2, 1)
    (unit,) = inner.tables(inner.child(tensor, 4))
    assert inner.data[inner.field(unit, 0)] == 1
    assert [inner.number(inner.child(unit, 1, slot)) for slot in (0, 1)] == [mean, deviation]


def test_a_model_is_told_how_to_scale() -> None:
    check_model(with_scaling(model(), 127.5, 255.0), 127.5, 255.0)
    check_model(with_scaling(with_scaling(model(), 1.0, 2.0), 0.5, 4.0), 0.5, 4.0, times=2)


def archive(path: Path, contents: Mapping[str, bytes]) -> str:
    """Write an archive as npm does, and return its checksum."""
    raw = io.BytesIO()
    with tarfile.open(fileobj=raw, mode="w") as tar:
        for name, data in contents.items():
            member = tarfile.TarInfo(name)
            member.size = len(data)
            tar.addfile(member, io.BytesIO(data))
    path.write_bytes(gzip.compress(raw.getvalue(), mtime=0))
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def archives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Both packages, small; the cache is empty."""
    vision, pose = tmp_path / "a-vision-1.tgz", tmp_path / "a-pose-2.tgz"
    code = {"package/vision_bundle.mjs": b"code", **dict.fromkeys(WASM, b"wasm"), "package/README.md": b"-"}
    models = {f"package/{name}": model() for name in ("pose_solution_packed_assets.data", "pose_landmark_lite.tflite")}
    monkeypatch.setattr(runtime, "VISION", Package("@a/vision", "1", archive(vision, code)))
    monkeypatch.setattr(runtime, "POSE", Package("@a/pose", "2", archive(pose, models)))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return [vision, pose]


def check_installed(folder: Path) -> None:
    assert runtime_folder() == folder
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert names == {"vision_bundle.mjs", MODEL, "NOTICE.txt", *(name.removeprefix("package/") for name in WASM)}
    with zipfile.ZipFile(folder / MODEL) as bundle:
        assert all(one.compress_type == zipfile.ZIP_STORED for one in bundle.infolist())
        check_model(bundle.read("pose_detector.tflite"), 127.5, 127.5)
        check_model(bundle.read("pose_landmarks_detector.tflite"), 0.0, 255.0)


def test_from_archives_in_any_order(archives: list[Path]) -> None:
    assert runtime_folder() is None
    said = list[str]()
    folder = install(archives, said.append)
    check_installed(folder)
    first = (folder / MODEL).read_bytes()
    (folder / "vision_bundle.mjs").unlink()  # what is damaged is made anew
    assert runtime_folder() is None
    check_installed(install(archives[::-1], said.append))
    assert (folder / MODEL).read_bytes() == first
    assert said


def test_other_archives_are_refused(archives: list[Path], tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.tgz"
    damaged.write_bytes(archives[0].read_bytes()[:-1])
    for paths in ([damaged, archives[1]], archives[:1], [*archives, tmp_path], [tmp_path / "none.tgz"]):
        with refuses(InputError):
            install(paths, list[str]().append)
    assert runtime_folder() is None


@pytest.mark.parametrize("at", [0, 2])
def test_a_full_disk_leaves_nothing(archives: list[Path], monkeypatch: pytest.MonkeyPatch, at: int) -> None:
    synced, left = os.fsync, iter(range(at + 1))

    def full(descriptor: int) -> None:
        synced(descriptor)
        if next(left, None) is None or at == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch, refuses(UsageError, "No space left"):
        patch.setattr(os, "fsync", full)
        install(archives, list[str]().append)
    assert runtime_folder() is None
    install(archives, list[str]().append)
    folder = runtime_folder()
    assert folder is not None and [*folder.parent.iterdir()] == [folder]


def test_by_the_npm_client(archives: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A client that gives what is there; one that is offline; none."""
    tools = tmp_path / "tools"
    tools.mkdir()
    npm = tools / "npm"
    monkeypatch.setenv("PATH", str(tools))
    with refuses(UsageError, "there is no npm client"):
        install(None, list[str]().append)
    npm.write_text("#!/bin/sh\necho 'npm error code ENOTFOUND' >&2\nexit 1\n")
    npm.chmod(0o755)
    with refuses(UsageError, "npm could not fetch"):
        install(None, list[str]().append)
    npm.write_text(f'#!/bin/sh\nfor one; do case "$one" in /*) /bin/cp {tmp_path}/a-*.tgz "$one";; esac; done\n')
    check_installed(install(None, list[str]().append))
