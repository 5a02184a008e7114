"""What a profile hands to the servo side and its guard, and warnings that would come too late."""

from math import inf
from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import ConfigError
from retarget.model.robot import load_profile
from retarget.schema.profile_parts import DEFAULT_WATCHDOG, Bus, Safety, safety_facts

LEAST = {"rate_hz": 100.0, "freshness": 0.1, "temperature_c": 65.0, "voltage": [10.0, 14.8], "following_error": 0.35}
ALL = {
    "freshness_warn": 0.05,
    "temperature_warn_c": 58.0,
    "voltage_warn": [11.0, 14.0],
    "following_error_sustained": 0.2,
    "following_error_s": 0.3,
    "following_error_warn": 0.15,
    "current_a": 2.0,
    "current_warn_a": 1.5,
    "current_s": 0.7,
    "speed_caps": {"warm": 0.4},
}


def safety(**keys: object) -> Safety:
    return Safety.model_validate(LEAST | keys)


def test_what_is_left_out_is_not_watched_but_heat_warns_five_degrees_before() -> None:
    limits = safety().guard_limits()
    assert (limits.max_age, limits.max_temperature, limits.following_error) == (0.1, 65.0, 0.35)
    assert limits.warn_temperature == 60.0 and limits.slow_share == 0.5
    assert limits.warn_age == limits.max_current == limits.warn_current == limits.sustained_error == inf
    assert limits.warn_voltage == (-inf, inf) and limits.warn_following_error == inf


def test_every_key_arrives_at_the_guard() -> None:
    limits = safety(**ALL).guard_limits()
    assert (limits.warn_age, limits.warn_temperature, limits.warn_voltage) == (0.05, 58.0, (11.0, 14.0))
    assert (limits.sustained_error, limits.sustained_time, limits.warn_following_error) == (0.2, 0.3, 0.15)
    assert (limits.max_current, limits.warn_current, limits.current_time) == (2.0, 1.5, 0.7)
    assert limits.slow_share == 0.4
    plain, given = vars(safety().guard_limits()), vars(limits)
    guards_own = {"lag", "max_pause", "max_silence"}
    same = {key for key in given if plain[key] == given[key]} - guards_own
    assert same == {"max_age", "max_temperature", "voltage", "following_error"}


def test_everything_is_said_in_words() -> None:
    facts = safety_facts(safety(**ALL))
    assert facts["slows"] == "to 40% at 58 degrees Celsius, 1.5 A for 0.7 s"
    assert facts["warns"] == "outside 11 to 14 V, 0.15 rad from the goal for 0.3 s, silent for 0.05 s"
    assert facts["stops"] == (
        "65 degrees Celsius, outside 10 to 14.8 V, 2 A for 0.7 s, 0.35 rad from the goal, 0.2 rad for 0.3 s, "
        "silent for 0.1 s"
    )


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("temperature_warn_c: 65", "temperature_warn_c: must be below temperature_c; found 65 degrees Celsius"),
        ("freshness_warn: 0.1", "freshness_warn: must be below freshness"),
        ("following_error_sustained: 0.4", "following_error_sustained: must be below following_error"),
        ("following_error_warn: 0.25", "following_error_warn: must be below following_error_sustained"),
        ("current_a: 1.0", "current_warn_a: must be below current_a; found 1.5 A"),
        ("voltage_warn: [9.0, 14.0]", "voltage_warn: must lie within voltage; found 9 to 14 V; allowed: 10 to 14.8 V"),
        ("voltage_warn: [14.0, 11.0]", "voltage_warn: inverted limits"),
        ("current_warn_a: -1", "current_warn_a: wrong value; found -1"),
        ("current_s: no", "current_s: wrong value"),
        ("speed_caps: {warm: 0.1}", "speed_caps.warm: wrong value; found 0.1; allowed: greater than or equal to 0.25"),
        ("temperature_warn: 60", "temperature_warn: unknown key"),
    ],
)
def test_a_warning_after_the_stop_is_refused(line: str, fault: str, tmp_path: Path) -> None:
    shipped = load_profile("op3").path
    key = line.split(":")[0]
    kept = [row for row in shipped.read_text().splitlines() if not row.startswith(f"  {key}:")]
    place = kept.index("safety:") + 1
    copy = tmp_path / "robot.yaml"
    copy.write_text("\n".join([*kept[:place], f"  {line}", *kept[place:]]) + "\n")
    for other in shipped.parent.iterdir():
        if other != shipped:
            (tmp_path / other.name).symlink_to(other)
    with refuses(ConfigError, f"safety.{fault}"):
        load_profile(copy)


def bus(protocol: int, **more: object) -> Bus:
    return Bus.model_validate({"port": "/dev/a", "baud": 1000000, "protocol": protocol, "ids": (1, 2), **more})


def test_the_watchdog_is_on_where_there_is_one() -> None:
    buses = (bus(1), bus(2), bus(2, watchdog_s=0.0), bus(2, watchdog_s=2.54))
    first, second, third, fourth = (one.spec("a") for one in buses)
    assert [first.watchdog, second.watchdog, third.watchdog] == [0.0, DEFAULT_WATCHDOG, 0.0]
    assert fourth.watchdog_value == 127


def test_microseconds_become_seconds() -> None:
    spec = bus(2, return_delay_us=508).spec("a")
    assert (spec.return_delay, spec.return_delay_value) == (508e-6, 254)
    assert (spec.name, spec.port, spec.ids, spec.power) == ("a", "/dev/a", (1, 2), None)
