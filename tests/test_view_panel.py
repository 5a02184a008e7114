"""The panel of a page: large letters, what colours mean, and curves of a joint."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from followers import op3
from retarget.viewer.joint_plot import QUANTITIES, JointPlot, curves, heights
from retarget.viewer.legend import legend
from retarget.viewer.limb_colours import current_scale, temperature_scale
from retarget.viewer.moment import Tracks
from retarget.viewer.palette import LEGEND, mixed, web
from retarget.viewer.panel import headline
from support.messages import shows
from viewed import cast_of_op3, moment


def test_letters_say_what_it_does_and_why_and_hold_no_markup() -> None:
    text = headline(moment(state="stopping", why="a <script>", present=np.full(20, 0.1)), "gone")
    shows(text, "STOPPING", "5.7")
    assert "degrees" not in headline(moment(present=np.full(20, np.nan)))


def test_the_legend_has_the_colours_of_what_is_shown() -> None:
    text = legend(["goal", "balance"], temperature_scale(op3()))
    for colour, words in (*LEGEND["goal"].keys, *LEGEND["balance"].keys):
        assert web(colour) in text and words in text
    assert "30 \u00b0C" in text and f"{op3().profile.safety.temperature_c:g} \u00b0C" in text
    assert LEGEND["around"].keys[0][1] not in legend(["goal"], None)


def test_shares_of_a_scale_end_at_its_ends() -> None:
    scale = current_scale(op3())
    assert scale is not None
    values = np.array([0.0, 0.75, -1.5, 9.0, np.nan, *np.zeros(15)])
    np.testing.assert_allclose(scale.shares(values)[:5], [0.0, 0.5, 1.0, 1.0, 0.0])
    assert mixed(0.0) != mixed(0.5) != mixed(1.0)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_curves_of_a_joint_are_no_more_than_can_be_seen(quantity: str) -> None:
    time = np.arange(5000.0)
    tracks = Tracks(time, np.full(5000, 0.2), np.full(5000, 0.1), np.full(5000, 40.0), np.full(5000, 0.5))
    at, goal, servo = curves(tracks, quantity)
    assert len(at) == len(goal) == len(servo) <= 1500 and (at[0], at[-1]) == (0.0, 4999.0)
    expected = {"angle": np.degrees(0.1), "off its goal": np.degrees(0.1), "temperature": 40.0, "current": 0.5}
    np.testing.assert_allclose(servo, expected[quantity])
    assert np.isnan(goal).all() == (quantity != "angle")


@pytest.mark.parametrize(("told", "quantities"), [(True, QUANTITIES), (False, ("angle", "off its goal"))])
def test_a_plot_offers_what_is_known(told: bool, quantities: tuple[str, ...], server: Any) -> None:
    plot = JointPlot(server, replace(cast_of_op3(), servos_told=told), lambda _: None)
    assert plot._quantity.options == quantities


@pytest.mark.parametrize(
    "values", [[np.nan] * 9, [25.0] * 9, [np.nan, 1.0, 7.0], [-40.0, np.nan, 71.5], [1e-4, 2e-4], [1e5, np.inf]]
)
def test_a_plot_reaches_beyond_all_that_is_known(values: list[float]) -> None:
    low, high = heights(np.array(values), np.full(3, np.nan))
    known = [value for value in values if np.isfinite(value)]
    assert (
        low < min(known, default=0.5)
        and max(known, default=0.5) < high
        and high - low < 3 * (np.ptp(known or [0, 1]) + 0.1)
    )


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_page_is_told_how_far_a_plot_reaches(quantity: str, server: Any) -> None:
    """It finds that out by itself only where all is known: a goal that is NaN left the whole plot empty."""
    time, gone = np.arange(50.0), np.where(np.arange(50) < 9, np.nan, 0.1)
    plot: Any = JointPlot(server, cast_of_op3(), lambda _: Tracks(time, gone + 0.1, gone, gone + 40.0, gone))
    plot._quantity.value = quantity
    plot.draw()
    reach, shown = plot._plot.scales["y"]["range"], plot._plot.data[2]
    assert reach[0] < np.nanmin(shown) <= np.nanmax(shown) < reach[1]
