"""`retarget check --reach FILE`: a picture of the places that a hand reaches from the stance, by strategy."""

from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from hardware.errors import counted
from retarget.errors import UsageError
from retarget.ik.support_polygon import Stance
from retarget.model.robot import RobotBody
from retarget.pictures.plots import new_figure, plain, save_figure
from retarget.robot.reach_map import HANDS
from retarget.robot.strategies import ORDER, Strategies, Strategy
from retarget.types import FloatArray, IntArray

COLOURS = {Strategy.ARM: "#0072b2", Strategy.TRUNK: "#56b4e9", Strategy.CROUCH: "#e69f00", Strategy.STEP: "#f2f2f2"}
VIEWS = (("from the right", 0, 2, 1), ("from behind", 1, 2, 0), ("from above", 0, 1, 2))
"""Name, the axes to the right and up, and the axis across the slice, which holds the left hand of the stance."""
PIXELS = 120
"""Pixels of a side of a slice."""
LINES = (
    ("head", "neck", "pelvis"),
    *((f"{side}_shoulder", f"{side}_elbow", f"{side}_hand") for side in "lr"),
    *(("pelvis", f"{side}_hip", f"{side}_knee", f"{side}_ankle", f"{side}_toe") for side in "lr"),
)
"""Frames that the lines of a robot join."""


def reach_numbers(strategies: Strategies) -> list[str]:
    """The volume of each strategy, litres, a line for each hand."""
    lines = []
    for number, hand in enumerate(strategies.reach.hands):
        nodes = hand.nodes.reshape(-1, 3)
        found = _strategies(strategies, number, nodes)
        litres = [1e3 * hand.spacing**3 * np.count_nonzero(found == index) for index in range(len(ORDER) - 1)]
        rooms = ", ".join(f"{one.value} {room:.1f}" for one, room in zip(ORDER, litres, strict=False))
        grid = f"{counted(len(nodes), 'place')} every {1e3 * hand.spacing:.0f} mm"
        lines.append(f"{HANDS[number]}: reached by {rooms} litres ({grid})")
    return lines


def draw_reach(robot: RobotBody, stance: Stance, strategies: Strategies, path: Path) -> None:
    """Write slices of the map of the left hand as PNG. Raises UsageError if the file cannot be written."""
    figure = new_figure(12.0, 4.6, f"{robot.profile.name}: places of the left hand from its stance")
    hand = strategies.reach.hands[0]
    nodes, at = hand.nodes.reshape(-1, 3), stance.points[HANDS[0]]
    for axes, (name, right, up, across) in zip(figure.subplots(1, len(VIEWS)), VIEWS, strict=True):
        sides = [np.linspace(nodes[:, axis].min(), nodes[:, axis].max(), PIXELS) for axis in (right, up)]
        places = np.zeros((PIXELS, PIXELS, 3))
        places[..., right], places[..., up] = np.meshgrid(*sides)
        places[..., across] = at[across]
        found = _strategies(strategies, 0, places.reshape(-1, 3)).reshape(PIXELS, PIXELS)
        colours = ListedColormap([COLOURS[one] for one in ORDER])
        extent = (sides[0][0], sides[0][-1], sides[1][0], sides[1][-1])
        axes.imshow(found, cmap=colours, vmin=0, vmax=len(ORDER) - 1, origin="lower", extent=extent)
        for names in LINES:
            line = [stance.points[name] for name in names if name in stance.points]
            axes.plot([one[right] for one in line], [one[up] for one in line], color="#333333", linewidth=1.6)
        axes.set_title(f"{name}, at {'xyz'[across]} = {at[across]:.2f} m", fontsize=9)
        axes.set_xlabel(f"{'xyz'[right]} (m)", fontsize=8)
        axes.set_ylabel(f"{'xyz'[up]} (m)", fontsize=8)
        if right == 1:
            axes.invert_xaxis()  # from behind, left is left
        plain(axes)
    words = [*(one.value for one in ORDER[:-1]), Strategy.STEP.words]
    patches = [
        Patch(facecolor=COLOURS[one], edgecolor="#999999", label=word) for one, word in zip(ORDER, words, strict=True)
    ]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(ORDER), fontsize=9, frameon=False)
    try:
        save_figure(figure, path)
    except (OSError, ValueError) as error:
        raise UsageError("cannot write the picture", where="--reach", found=f"{path}: {error}") from error


def _strategies(strategies: Strategies, hand: int, places: FloatArray) -> IntArray:
    """Indices in ORDER (n,) of the cheapest strategy for places (n, 3), m, of a hand, 0 or 1."""
    return np.array([ORDER.index(strategies.cheapest_standing(hand, (x, y, z))) for x, y, z in places.tolist()])
