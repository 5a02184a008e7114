"""A small robot for tests: four joints with every kind of difference that a servo map must bear."""

from hardware.servo import ServoSpec, find_model


def four_servos() -> tuple[ServoSpec, ...]:
    """Plain, reversed, geared and AX servos, in that order."""
    x_series = find_model("XM430-W350")
    return (
        ServoSpec("shoulder", 1, x_series, "main", 1, 2048, -1.5, 1.5, 4.0, 40.0),
        ServoSpec("elbow", 2, x_series, "main", -1, 2100, -0.5, 2.0, 4.0, 40.0),
        ServoSpec("waist", 3, x_series, "main", 1, 2048, -0.6, 0.6, 1.5, 10.0, gear=2.0),
        ServoSpec("head", 4, find_model("AX-12A"), "main", -1, 512, -1.0, 1.0, 5.0, 60.0),
    )
