"""A motion file that ends too early says so; any other fault of a frame says what to do."""

from collections.abc import Callable
from pathlib import Path

import pytest

from messages import refuses
from motion_texts import amc_text, asf_text, bvh_text
from retarget.errors import InputError
from retarget.sources.asf_amc import read_amc
from retarget.sources.bvh import read_bvh


def written(folder: Path, text: str) -> Path:
    path = folder / "motion.bvh"
    path.write_text(text)
    return path


@pytest.mark.parametrize("end", ["rto", "rtoes", "rtoes -", "lfemur 1.0 2"])
def test_an_amc_cut_in_its_last_line_is_refused_as_cut_short(tmp_path: Path, end: str) -> None:
    (tmp_path / "01.asf").write_text(asf_text())
    lines = amc_text(frames=3).splitlines()
    place = next(i for i in reversed(range(len(lines))) if lines[i].startswith(end.split()[0][:3]))
    path = tmp_path / "01_01.amc"
    path.write_text("\n".join([*lines[:place], end]))
    with refuses(InputError, where=f":{place + 1}"):
        read_amc(path)


@pytest.mark.parametrize("value", ["nan", "inf", "text", "1 2"])
def test_a_bad_value_says_what_to_do(tmp_path: Path, value: str) -> None:
    (tmp_path / "01.asf").write_text(asf_text())
    lines = amc_text(frames=3).splitlines()
    place = next(i for i, line in enumerate(lines) if line.startswith("rtoes"))
    path = tmp_path / "01_01.amc"
    path.write_text("\n".join([*lines[:place], f"rtoes {value}", *lines[place + 1 :]]))
    with refuses(InputError):
        read_amc(path)


@pytest.mark.parametrize("share", [0.5, 0.0])
def test_a_bvh_cut_in_its_last_line_is_refused_as_cut_short(tmp_path: Path, share: float) -> None:
    lines = bvh_text().rstrip().splitlines()
    cut = lines[-1][: int(share * len(lines[-1]))] + " -"
    with refuses(InputError, where=f":{len(lines)}"):
        read_bvh(written(tmp_path, "\n".join([*lines[:-1], cut])))


def test_wrong_counts_say_what_to_do(tmp_path: Path) -> None:
    text = bvh_text()
    first = text.index("CHANNELS 6")
    with refuses(InputError):
        read_bvh(written(tmp_path, text[:first] + "CHANNELS 5" + text[first + 10 :]))
    lines = text.rstrip().splitlines()
    lines[-2] += " 1.0"
    with refuses(InputError):
        read_bvh(written(tmp_path, "\n".join(lines)))


@pytest.mark.parametrize("read", [read_amc, read_bvh])
def test_what_is_no_recording_says_what_to_do(tmp_path: Path, read: Callable[[Path], object]) -> None:
    (tmp_path / "motion.asf").write_text(asf_text())
    with refuses(InputError):
        read(written(tmp_path, "PK\x03\x04"))
