"""What a profile hands to the servo side."""

from retarget.schema.profile_parts import DEFAULT_WATCHDOG, Bus, bus_specs


def bus(protocol: int, **more: object) -> Bus:
    return Bus.model_validate({"port": "/dev/a", "baud": 1000000, "protocol": protocol, "ids": (1, 2), **more})


def test_the_watchdog_is_on_where_there_is_one() -> None:
    first, second, third, fourth = bus_specs(
        {"a": bus(1), "b": bus(2), "c": bus(2, watchdog_s=0.0), "d": bus(2, watchdog_s=2.54)}
    )
    assert [first.watchdog, second.watchdog, third.watchdog] == [0.0, DEFAULT_WATCHDOG, 0.0]
    assert fourth.watchdog_value == 127


def test_microseconds_become_seconds() -> None:
    (spec,) = bus_specs({"a": bus(2, return_delay_us=508)})
    assert (spec.return_delay, spec.return_delay_value) == (508e-6, 254)
    assert (spec.name, spec.port, spec.ids, spec.power) == ("a", "/dev/a", (1, 2), None)
