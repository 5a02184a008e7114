"""C3D marker recordings: sensors from markers, lost points, and one clear error for everything that is wrong."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import refuses, shows, shows_lines
from motion_texts import C3D_PROCESSORS, MARKERS, c3d_bytes
from retarget.errors import ConfigError, InputError
from retarget.frames import SensorFrames
from retarget.sources.c3d import read_c3d, read_c3d_file
from retarget.sources.files import ReadOptions
from retarget.sources.markers import MARKER_GROUPS, split_label


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


def test_a_file_of_the_c3d_package_is_read_as_it_was_written(tmp_path: Path) -> None:
    c3d = pytest.importorskip("c3d")
    writer, points = c3d.Writer(point_rate=100.0, analog_rate=100.0, point_scale=-1.0), np.zeros((len(MARKERS), 5))
    points[:, :3] = [*MARKERS.values()]
    writer.add_frames([(points.astype(np.float32), np.zeros((0, 1), np.float32))] * 4)
    writer.set_point_labels([*MARKERS])
    writer.set_screen_axis("+X", "+Z")
    buffer = io.BytesIO()
    writer.write(buffer)
    ours = read_c3d(write(tmp_path, c3d_bytes()))
    theirs = read_c3d(write(tmp_path, buffer.getvalue()))
    np.testing.assert_array_equal(theirs.position, ours.position)
    assert theirs.rate_hz == ours.rate_hz and len(theirs) == len(ours)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> SensorFrames:
    return read_c3d(write(tmp_path_factory.mktemp("c3d"), c3d_bytes()))


WORDS = {"mm": 1.0, "m": 1e-3, "Meters": 1e-3, "centimetres": 0.1, "millimeter(s)": 1.0, "[mm]": 1.0, "in": 1 / 25.4}


@settings(max_examples=60, deadline=None)
@given(
    processor=st.sampled_from([*C3D_PROCESSORS]),
    whole=st.booleans(),
    subject=st.sampled_from(["", "Anna:", "anna_", "Trial 1*", "A.b:", "LFHD_"]),
    end=st.sampled_from(["", "\0", " \0\0"]),
    unit=st.sampled_from([*WORDS]),
    each=st.booleans(),
    first=st.sampled_from([0, 1, 700, 65_530]),
    analog=st.sampled_from([0, 6]),
    shape=st.sampled_from([(2,), (2, 1), (1, 2)]),
)
def test_one_motion_reads_alike_however_it_is_written(
    tmp_path_factory: pytest.TempPathFactory,
    plain: SensorFrames,
    processor: str,
    whole: bool,
    subject: str,
    end: str,
    unit: str,
    each: bool,
    first: int,
    analog: int,
    shape: tuple[int, ...],
) -> None:
    """Byte order, whole numbers or floats, prefixes and NUL in labels, units and how often they are written, the number
    of the first frame, analog channels, and the dimensions of parameters change nothing."""
    scale = WORDS[unit]
    markers = {name: (scale * x, scale * y, scale * z) for name, (x, y, z) in MARKERS.items()}
    ends = {"START": first, "END": first + 3}
    more = {f"TRIAL:ACTUAL_{key}_FIELD": np.array([at % 65_536, at >> 16]).reshape(shape) for key, at in ends.items()}
    content = c3d_bytes(
        markers=markers,
        processor=processor,
        steps=0.1 * scale if whole else 0.0,
        prefix=subject,
        names={name: name.lower() + end for name in markers},
        first=min(first, 65_530),
        analog=analog,
        more={"POINT:UNITS": [unit] * len(markers) if each else unit, "POINT:RATE": np.array([[100.0]]), **more},
    )
    frames = read_c3d(write(tmp_path_factory.getbasetemp(), content))
    assert frames.names == plain.names and frames.rate_hz == 100.0 and frames.valid.all()
    np.testing.assert_allclose(frames.position, plain.position, atol=1e-4)


def test_the_longest_known_end_of_a_label_is_its_marker() -> None:
    labels = {"LFHD": ("", "LFHD"), "*lfhd": ("", "LFHD"), "Bo:L_TOP": ("Bo", "L_TOP"), "a.b_LFHD": ("a.b", "LFHD")}
    for label, found in (labels | dict.fromkeys(("XLFHD", "LFHD_2"))).items():
        assert split_label(label, {*MARKERS, "L_TOP", "TOP"}) == found, label


def test_unit_and_rate_may_be_said_by_the_user(tmp_path: Path, plain: SensorFrames) -> None:
    path = write(tmp_path, c3d_bytes(unit="m", rate=0.0))
    for unit in (None, "inch"):
        with refuses(InputError, "--unit", "5 m"):
            read_c3d(path, ReadOptions(unit=unit, rate=50.0))
    with refuses(InputError, "0 Hz"):
        read_c3d(path, ReadOptions(unit="mm"))
    said = read_c3d(path, ReadOptions(unit="mm", rate=50.0))
    np.testing.assert_allclose(said.position, plain.position, atol=1e-6)
    assert said.rate_hz == 50.0 and said.time[1] == 0.02
    with refuses(InputError, found="'furlong'"):
        read_c3d(write(tmp_path, c3d_bytes(unit="furlong")))
    unstated = read_c3d(write(tmp_path, c3d_bytes(more={"POINT:UNITS": None})))
    assert unstated.notes[0] == "unit not stated: taken as mm (change it with --unit)"


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("screen", ["+Z", "-Z", "Y", "-x", None, "?"])
def test_the_body_decides_which_axis_is_up(
    tmp_path: Path, plain: SensorFrames, turned: bool, screen: str | None
) -> None:
    away = {name: (x + 1000.0, y + 2000.0, z) for name, (x, y, z) in MARKERS.items()}
    path = write(tmp_path, c3d_bytes(markers=away, y_up=turned, more={"POINT:Y_SCREEN": screen}))
    frames = read_c3d(path)
    np.testing.assert_allclose(frames.position, np.add(plain.position, [1.0, 2.0, 0.0]), atol=1e-6)
    agrees = screen == ("Y" if turned else "+Z")
    assert any("axis" in note for note in frames.notes) is not agrees
    said = read_c3d(path, ReadOptions(up=np.array([0.0, 0.0, -1.0])))
    head, ankle = (said.position[0, said.index(name), 2] for name in ("head", "l_ankle"))
    assert head - ankle == pytest.approx(0.0 if turned else -1.55, abs=0.05)


def test_a_lost_marker_takes_its_sensor_for_that_frame_and_is_counted(tmp_path: Path) -> None:
    frames = read_c3d(write(tmp_path, c3d_bytes(lost=[(1, "LWRA"), (2, "LWRB"), (2, "RANK")])))
    np.testing.assert_array_equal(frames.valid[:, frames.index("l_wrist")], [True, False, False, True])
    assert np.isnan(frames.position[1, frames.index("l_wrist")]).all()
    assert np.isfinite(frames.position[1, frames.index("r_wrist")]).all()
    assert {"l_wrist lost in 2 of 4 frames", "r_ankle lost in 1 of 4 frames"} <= {*frames.notes}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e30, 0.0, -16_512.0, 7_000.0])
@pytest.mark.parametrize("processor", ["intel", "mips"])
def test_points_that_are_nowhere_are_lost(tmp_path: Path, value: float, processor: str) -> None:
    content = c3d_bytes(at={(0, "LFHD"): (value,) * 3}, processor=processor)
    frames = read_c3d(write(tmp_path, content))
    assert not frames.valid[0, 0] and frames.valid[1:].all() and frames.valid[0, 1:].all()
    assert np.isnan(frames.position[0, 0]).all()
    assert any(note.startswith("1 marker") for note in frames.notes) == (1.0 < abs(value) < 1e9)


def test_of_several_performers_the_best_seen_is_read(tmp_path: Path, plain: SensorFrames) -> None:
    both = {"Bo:LANK": (9e3, 9e3, 90.0), **{f"Ann:{name}": at for name, at in MARKERS.items()}, "LFHD": (0.0, 0.0, 1.0)}
    frames = read_c3d(write(tmp_path, c3d_bytes(markers=both)))
    np.testing.assert_allclose(frames.position, plain.position, atol=1e-6)
    shows_lines("\n".join(frames.notes), ("2 performers", "Bo", "only 'Ann'"))
    crowd = {f"{number:0200}:{name}": MARKERS[name] for number in range(80) for name in ("LANK", "LTOE")}
    assert all(len(note) < 5000 for note in read_c3d(write(tmp_path, c3d_bytes(1, markers=crowd))).notes)


def test_files_without_known_markers_are_refused_with_what_they_hold(tmp_path: Path) -> None:
    names = {name: f"M{i}" for i, name in enumerate(MARKERS)}
    with refuses(InputError, "LFHD", "--markers", found=("M0", "M1")):
        read_c3d(write(tmp_path, c3d_bytes(names=names)))
    with refuses(InputError, "--markers", found=("1", "2")):
        read_c3d(write(tmp_path, c3d_bytes(more={"POINT:LABELS": None})))
    for used, analog in ((0.0, 0), (-1.0, 4)):  # at -1, the values of a frame would be none
        with refuses(InputError, "holds no markers", found=f"{used:.0f} points"):
            read_c3d(write(tmp_path, c3d_bytes(analog=analog, more={"POINT:USED": used})))
    some = {name: f"M{i}" for i, name in enumerate(MARKERS) if "WR" in name}
    note = next(note for note in read_c3d(write(tmp_path, c3d_bytes(names=some))).notes if "--markers" in note)
    assert "l_wrist, r_wrist" in note and f"{', '.join(some.values())}" in note
    shows((note,))


TABLE = """\
markers:
  head: [Head Top, {head}]
  l_wrist: [L_Wrist]
"""


def test_a_table_of_the_user_names_markers(tmp_path: Path) -> None:
    names = {"LFHD": "head top", "RFHD": "HeadBack", "LWRA": "L_WRIST"}
    path, table = write(tmp_path, c3d_bytes(prefix="Ann_", names=names)), tmp_path / "table.yaml"
    table.write_text(TABLE.format(head="HEADBACK"))
    frames = read_c3d(path, ReadOptions(markers=table))
    np.testing.assert_allclose(frames.position[0, 0], 0.5e-3 * np.add(MARKERS["LFHD"], MARKERS["RFHD"]), atol=1e-6)
    np.testing.assert_allclose(frames.position[0, frames.index("l_wrist")], 1e-3 * np.array(MARKERS["LWRA"]), atol=1e-6)
    assert "r_ankle" in frames.names  # by its usual markers
    for table_text, problems in (
        (TABLE.format(head="HeadBak"), ["no marker 'HEADBAK' in the file"]),
        ("markers: {head: [LBHD, nobody], l_wrist: [none]}", ["no marker 'NOBODY' in the file", "no marker 'NONE' in"]),
    ):
        table.write_text(table_text)
        with refuses(InputError) as refused:
            read_c3d(path, ReadOptions(markers=table))
        assert [one.what[: len(text)] for one, text in zip(refused.value.problems, problems, strict=True)] == problems
    for bad, fact in (("markers: {l_wirst: [LWRA]}", "l_wrist"), ("markers: {head: []}", "head"), ("head: [LFHD]", "")):
        table.write_text(bad)
        with refuses(ConfigError, fact):
            read_c3d(path, ReadOptions(markers=table))


def test_points_without_labels_have_numbers(tmp_path: Path) -> None:
    table = tmp_path / "table.yaml"
    number = 1 + [*MARKERS].index("RTOE")
    table.write_text(f"markers: {{r_toe: [{number}]}}")
    frames = read_c3d(write(tmp_path, c3d_bytes(more={"POINT:LABELS": None})), ReadOptions(markers=table))
    assert frames.names == ("r_toe",)
    np.testing.assert_allclose(frames.position[0, 0], 1e-3 * np.array(MARKERS["RTOE"]), atol=1e-6)


@pytest.mark.parametrize("share", [0.01, 0.2, 0.4, 0.8, 0.95])
def test_a_file_cut_short_is_refused(tmp_path: Path, share: float) -> None:
    content = c3d_bytes(40)
    with refuses(InputError):
        read_c3d(write(tmp_path, content[: int(share * len(content))]))


FEW = {name: MARKERS[name] for name in ("LFHD", "RFHD", "LBHD", "RBHD")}


@pytest.mark.parametrize(
    ("held", "more", "read"),
    [
        (70_000, {"header": 4464, "POINT:FRAMES": 4464}, 70_000),  # both wrapped
        (70_000, {"header": 4400, "POINT:FRAMES": 4400}, None),
        (4432, {"header": 4400, "POINT:FRAMES": 4400}, 4432),  # a few more
        (70_000, {"TRIAL:ACTUAL_START_FIELD": np.array([1, 0]), "TRIAL:ACTUAL_END_FIELD": np.array([4464, 1])}, 70_000),
        (70_000, {"POINT:FRAMES": 70_000.0}, 70_000),
        (66_000, {}, 66_000),  # all counters are at their end
        (60_000, {}, None),
        (67_000, {"POINT:FRAMES": 70_000.0}, None),
        (70_000, {"POINT:FRAMES": 70_000.0, "POINT:LONG_FRAMES": float("nan")}, 70_000),
        (64, {"POINT:FRAMES": 64, "TRIAL:ACTUAL_START_FIELD": np.array([9, 9]), "POINT:LONG_FRAMES": 3e9}, 64),
    ],
)
def test_counts_beyond_16_bits(tmp_path: Path, held: int, more: dict[str, object], read: int | None) -> None:
    """The header counts to 65,535; POINT:FRAMES of 16 bits wraps, or stays at its end."""
    header = more.pop("header", 65_535)
    one = c3d_bytes(8, markers=FEW, steps=0.1, more={"POINT:FRAMES": 65_535, **more})
    start = 512 * (struct.unpack_from("<H", one, 16)[0] - 1)
    head = bytearray(one[:start])
    struct.pack_into("<2H", head, 6, 1, header)
    path = write(tmp_path, bytes(head) + one[start : start + 32 * 8] * (held // 8))
    if read is None:
        with refuses(InputError, "frames than declared"):
            read_c3d(path)
    else:
        assert len(read_c3d(path)) == read


def test_one_frame_beside_the_declared_is_read_with_a_note(tmp_path: Path) -> None:
    content = bytearray(c3d_bytes(8, markers=FEW, more={"POINT:FRAMES": None}))  # a frame is 64 bytes, 8 are a block
    struct.pack_into("<2H", content, 6, 0, 8)  # counted from 0, but to the number of frames
    frames = read_c3d(write(tmp_path, bytes(content)))
    assert len(frames) == 8 and frames.notes[0] == "the file declares 9 frames and holds 8: all of these are read"


def test_parameters_are_no_longer_than_the_file_whatever_they_say(tmp_path: Path) -> None:
    names = (bytes((97 + n // 26, 97 + n % 26)) for n in range(100))
    records = b"".join(struct.pack("bb2sHb3B", 2, 1, name, 6, -1, 2, 255, 255) for name in names)
    content = c3d_bytes()[:512] + bytes((1, 0x50, 0, 84)) + records
    file = read_c3d_file(write(tmp_path, content.ljust(100_000, b"x")))
    assert sum(len(parameter.data) for parameter in file.parameters.values()) < 100_000


def test_an_unknown_processor_is_read_as_intel_with_a_note(tmp_path: Path, plain: SensorFrames) -> None:
    content = bytearray(c3d_bytes())
    content[512 + 3] = 7
    frames = read_c3d(write(tmp_path, bytes(content)))
    np.testing.assert_array_equal(frames.position, plain.position)
    shows((frames.notes[0],))


def test_recordings(shared: Path) -> None:
    for name, count in (("cmu_c3d/02_01", 343), ("cmu_c3d/05_13", 1095), ("other/Movement_trial", 323)):
        frames = read_c3d(shared / f"mocap/{name}.c3d")
        assert len(frames) == count and frames.rate_hz == 120.0 and len(frames.names) == 15 == len(MARKER_GROUPS)
        assert frames.valid.mean() > 0.99
        head, ankle = (frames.position[:, frames.index(sensor), 2] for sensor in ("head", "l_ankle"))
        assert 1.2 < np.nanmedian(head - ankle) < 1.7
        across = frames.position[:, frames.index("l_shoulder")] - frames.position[:, frames.index("r_shoulder")]
        assert 0.25 < np.nanmedian(np.linalg.norm(across, axis=1)) < 0.5
