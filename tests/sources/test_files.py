"""Reading motion files as bytes and lines, and the checks every reader shares."""

from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import InputError
from retarget.sources import files


def test_lines_of_any_line_ends_and_encodings(tmp_path: Path) -> None:
    path = tmp_path / "a"
    for content in (b"a\nb\n", b"a\r\nb\r\n", b"a\rb\r", b"\xef\xbb\xbfa\nb\n"):
        path.write_bytes(content)
        assert files.read_lines(path) == ["a", "b", ""]
    path.write_bytes(b"J\xfcrgen")
    assert files.read_lines(path) == ["Jürgen"]


def test_binary_content_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"a\nb\n\0")
    with refuses(InputError, where="a:3"):
        files.read_lines(path)


def test_the_head_of_a_file_is_short(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"x" * 10_000)
    assert len(files.read_head(path)) == 4096 and len(files.read_bytes(path)) == 10_000


def test_numbers_are_finite_and_of_plausible_size() -> None:
    assert files.numbers(["1", "-2.5", "7.6e-016"], "here") == [1.0, -2.5, 7.6e-16]
    for token in ("nan", "inf", "-Infinity", "1e10", "x", "", "1,5"):
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
