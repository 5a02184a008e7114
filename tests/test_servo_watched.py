"""What is watched: rows where everybody looks for them, and the words for each."""

from math import inf

import numpy as np

from hardware.guard_state import GuardLimits, StopCause
from hardware.servo_watched import Row, name_servos, watched
from servos import four_servos
from support.messages import shows

CAUSES = {
    Row.ALERT: StopCause.SERVO_ALERT,
    Row.AGE: StopCause.SERVO_LOST,
    Row.LIMP: StopCause.SERVO_LIMP,
    Row.TEMPERATURE: StopCause.TEMPERATURE,
    Row.VOLTAGE: StopCause.VOLTAGE,
    Row.CURRENT: StopCause.CURRENT,
    Row.FAR: StopCause.FOLLOWING_ERROR,
    Row.STILL_FAR: StopCause.FOLLOWING_ERROR,
}


def test_every_row_stands_where_its_name_says() -> None:
    rows = watched(GuardLimits())
    assert {place: row.cause for place, row in enumerate(rows)} == CAUSES
    assert {row.cause for row in rows if row.slows} == {StopCause.TEMPERATURE, StopCause.CURRENT}


def test_levels_are_those_of_the_limits() -> None:
    limits = GuardLimits(
        max_temperature=65.0, warn_temperature=60.0, lasting_error=0.2, lasting_time=0.3, max_current=2.0
    )
    rows = watched(limits)
    assert rows[Row.TEMPERATURE].stop == (-inf, 65.0) and rows[Row.TEMPERATURE].warn == (-inf, 60.0)
    assert rows[Row.STILL_FAR].stop == (0, 0.2) and rows[Row.STILL_FAR].patience == 0.3
    assert rows[Row.FAR].stop == (0, inf) and rows[Row.FAR].patience == 0.0
    assert rows[Row.CURRENT].stop == (0, 2.0) and rows[Row.CURRENT].patience == limits.current_time
    shows(rows[Row.STILL_FAR].complaint, "0.2", "0.3")


def test_servos_are_named_with_their_values() -> None:
    rows, values = watched(GuardLimits()), np.array([61.4, 0.0, np.nan, 70.0])
    names = name_servos(four_servos(), np.array([True, False, True, False]), rows[Row.TEMPERATURE].tell, values)
    assert names == "shoulder (id 1) 61, waist (id 3) not known"
    alerts = np.array([0x24, 0.0, 0x02, 0.0])
    named = name_servos(four_servos(), alerts > 0, rows[Row.ALERT].tell, alerts)
    assert named == "shoulder (id 1) OVERHEATING+OVERLOAD, waist (id 3) 0x02"


def test_all_servos_are_named_as_such() -> None:
    rows, every = watched(GuardLimits()), np.ones(4, dtype=bool)
    volts, degrees = rows[Row.VOLTAGE].tell, rows[Row.TEMPERATURE].tell
    assert name_servos(four_servos(), every, volts, np.full(4, 10.2)) == "all 4 servos 10.2 V"
    assert (
        name_servos(four_servos(), every, volts, np.array([10.2, 10.1, 10.2, 10.1])) == "all 4 servos 10.1 V and 10.2 V"
    )
    assert name_servos(four_servos(), every, degrees, np.array([63.0, 60.0, 61.0, 62.0])) == "all 4 servos 60 to 63"
    assert name_servos(four_servos(), every, rows[Row.AGE].tell, np.ones(4)) == "all 4 servos"
    few = four_servos()[:3]
    assert name_servos(few, np.ones(3, dtype=bool), volts, np.full(3, 10.2)).count("(id") == 3
