"""Small robots for tests: joints with every kind of difference that a servo map must bear."""

from hardware.servo import Coupling, ServoMode, ServoSpec, find_model


def four_servos() -> tuple[ServoSpec, ...]:
    """Plain, reversed, geared and AX servos, in that order."""
    x_series = find_model("XM430-W350")
    return (
        ServoSpec("shoulder", 1, x_series, "main", 1, 2048, -1.5, 1.5, 4.0, 40.0),
        ServoSpec("elbow", 2, x_series, "main", -1, 2100, -0.5, 2.0, 4.0, 40.0),
        ServoSpec("waist", 3, x_series, "main", 1, 2048, -0.6, 0.6, 1.5, 10.0, gear=2.0),
        ServoSpec("head", 4, find_model("AX-12A"), "main", -1, 512, -1.0, 1.0, 5.0, 60.0),
    )


def waist_servos() -> tuple[ServoSpec, ...]:
    """A differential waist of many turns between a plain servo and a geared one of many turns."""
    x_series, small = find_model("XM430-W350"), find_model("XC330-T288")
    waist = Coupling(("roll", "yaw"), ((-0.29166667, 0.29166667), (0.20833333, 0.20833333)))
    many = ServoMode.EXTENDED_POSITION
    return (
        ServoSpec("knee", 7, x_series, "main", -1, 2048, -1.0, 1.0, 4.0, 40.0),
        ServoSpec("roll", 2, small, "main", 1, 2000, -0.5236, 0.5236, 1.5, 10.0, mode=many, coupling=waist),
        ServoSpec("yaw", 3, small, "main", -1, 2100, -1.5708, 1.5708, 1.5, 10.0, mode=many, coupling=waist),
        ServoSpec("neck", 0, small, "main", -1, 1500, -2.618, 2.618, 5.0, 40.0, gear=1.1, mode=many),
    )
