"""CSV and Parquet: names with units, every number, and nothing invented."""

import csv
import io
import json

import numpy as np
import pytest

from exported import moved, slider, with_servos
from retarget.recording.motion import Motion
from retarget.recording.tables import arrow, columns_of, write_csv, write_parquet


@pytest.fixture
def motion() -> Motion:
    return with_servos(moved(slider()))


def test_the_header_says_what_and_in_which_unit(motion: Motion) -> None:
    names = [column.name for column in columns_of(motion)]
    assert names[:8] == [
        *("time_s", "root_x_m", "root_y_m", "root_z_m", "root_qw", "root_qx", "root_qy", "root_qz"),
    ]
    assert names[8:11] == ["lift_m", "swing_rad", "roll_rad"]
    assert names[11:15] == ["servo_lift_m", "servo_swing_rad", "ticks_lift", "ticks_swing"]
    assert names[15:] == [f"asked_{name}_{axis}_m" for name in ("hand", "lost") for axis in "xyz"]


def test_a_csv_is_read_by_numpy_alone(motion: Motion) -> None:
    stream = io.BytesIO()
    write_csv(motion, stream)
    table = np.genfromtxt(io.StringIO(stream.getvalue().decode()), delimiter=",", names=True)
    assert len(table) == len(motion)
    np.testing.assert_allclose(table["swing_rad"], motion.joints[:, 1], rtol=1e-9)
    np.testing.assert_allclose(table["root_qy"], motion.root_quaternion[:, 2], rtol=1e-9)
    assert np.isnan(table["asked_lost_x_m"][0]) and table["asked_lost_x_m"][1] == 1.0
    assert (table["ticks_lift"] == motion.goal_ticks[:, 0]).all()  # type: ignore[index]


def test_names_with_commas_and_quotes_survive() -> None:
    from retarget.model.body import load_body_text

    text = '<mujoco><worldbody><body name="b"><freejoint/><geom size="0.1"/><body name="c">'
    text += '<joint name="a, &quot;b&quot;"/><geom size="0.1"/></body></body></worldbody></mujoco>'
    stream = io.BytesIO()
    write_csv(moved(load_body_text(text, source="odd")), stream)
    assert next(csv.reader(io.StringIO(stream.getvalue().decode())))[8] == 'a, "b"_rad'


def test_parquet_has_every_digit_and_the_units(motion: Motion) -> None:
    stream = io.BytesIO()
    write_parquet(motion, stream)
    table = arrow().parquet.read_table(io.BytesIO(stream.getvalue()))
    assert table.column_names == [column.name for column in columns_of(motion)]
    assert (table["swing_rad"].to_numpy() == motion.joints[:, 1]).all()
    assert table.schema.field("lift_m").metadata == {b"unit": b"m"}
    assert table["asked_lost_x_m"].null_count == 1
    about = json.loads(table.schema.metadata[b"retarget"])
    assert about["root_link"] == "base" and about["rows"] == len(motion) and "z up" in about["world"]
