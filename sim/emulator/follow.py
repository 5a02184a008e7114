"""The law of `sim.servo_motion.saturated_lag` for one servo, in plain floats: a bus asks one servo at a time, often."""

from math import exp


def follow(error: float, lag: float, top: float, elapsed: float) -> tuple[float, float]:
    """Return the error (tick) and the velocity (tick/s) that are left `elapsed` s after an `error` (tick).

    d/dt x = clip((goal - x) / lag, -top, top); `lag` s, above 0, `top` tick/s, above 0. Exact for any `elapsed`.
    """
    speed = error / lag
    if -top <= speed <= top:
        left = error * exp(-elapsed / lag)
        return left, left / lag
    limit = top if speed > 0.0 else -top
    cruise = error / limit - lag  # [s] until the loop no longer saturates
    if cruise >= elapsed:
        return error - limit * elapsed, limit
    left = limit * lag * exp((cruise - elapsed) / lag)
    return left, left / lag
