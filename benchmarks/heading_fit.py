"""`python -m benchmarks.heading_fit [FOLDER]`: fit the weights of `retarget/human/heading.yaml` anew and print them.

FOLDER: `../shared/mocap/cmu_prior`, motions of the CMU Motion Capture Database. `SUBJECTS`: all but 60, 61 and 94, of
another skeleton; trial 01_07, which climbs, is left out. Loss: about the mean angle to the true heading of the hips,
subjects by the root of their length, with a pull towards hands that point 55 degrees inward. Held out: each subject by
weights of the other ten, mean over subjects. Writes no file: ankle and velocity are for `human.yaml`.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from retarget.human.heading import STANCE_S
from retarget.types import FloatArray

Complex = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
Grid = tuple[tuple[float, ...], tuple[float, ...]]
SUBJECTS = ("01", "02", "05", "10", "17", "49", "55", "91", "118", "124", "127")
HAND: Grid = ((0.12, 0.25, 0.40, 0.70), (0.10, 0.35, 0.60, 0.85, 1.10, 1.40))
HEAD: Grid = ((0.10, 0.20, 0.40), (0.50, 0.75, 0.90, 1.00))
ONE: Grid = ((0.12,), (1.0,))
BONES = (("head", "neck"), ("neck", "chest"), ("chest", "spine"), ("l_hip", "l_knee"), ("l_knee", "l_ankle"))
PULL, INWARD, DT, SETTLE_S = 3e-3, np.radians(55.0), 1.0 / 30.0, 0.2


def load(path: Path, hand: Grid, head: Grid) -> Complex:
    """Hints (T, m) of a subject's frames, turned so that the true heading is 1."""
    file = np.load(path)
    pieces = {key: file[key].swapaxes(0, 1) / 1000.0 for key in file.files if f"{key}_rot" in file.files}
    names, column = file["names"].tolist(), file["rot_names"].tolist().index("pelvis")
    pelvis = Rotation.from_quat(np.concatenate([file[f"{key}_rot"] for key in pieces])[:, column, [1, 2, 3, 0]])
    at = dict(zip(names, np.concatenate(list(pieces.values()), axis=1), strict=True))
    bones = [np.median(np.linalg.norm(at[one] - at[other], axis=1)) for one, other in BONES]
    height = float(sum(bones) + np.median(pelvis.inv().apply(at["spine"] - at["l_hip"])[:, 2]))
    kept = [dict(zip(names, piece, strict=True)) for key, piece in pieces.items() if not key.startswith("01_07")]
    return np.concatenate([hints_of(piece, height, hand, head) for piece in kept])


def hints_of(at: dict[str, FloatArray], height: float, hand: Grid, head: Grid) -> Complex:
    """Hints (T, m) of one motion: hands, their mirror image, ankles, velocity, head. height: of the head, standing."""
    ground: dict[str, Complex] = {name: point[:, :2] @ np.array([1.0, 1j]) for name, point in at.items()}
    under = 0.5 * (ground["l_ankle"] + ground["r_ankle"])
    middle = 0.5 * (under + ground["head"])
    up = {name: (point - np.minimum(at["l_ankle"], at["r_ankle"]))[:, 2] / height for name, point in at.items()}
    left, right = (table((ground[name] - middle) / height, up[name], hand) for name in ("l_wrist", "r_wrist"))
    top = table((ground["head"] - under) / height, up["head"], head)
    speed = velocity(at["head"], SETTLE_S)[:, :2] @ np.array([[1.0], [1j]])
    walking = speed * np.clip(2.0 * np.abs(speed) - 1.0, 0.0, 1.0)
    ankles = -1j * (ground["l_ankle"] - ground["r_ankle"])[:, None]
    hints = np.concatenate([left + right, -1j * (left - right), ankles, walking, top], axis=1)
    fastest = np.max([np.linalg.norm(velocity(at[name], 0.05), axis=1) for name in ("l_ankle", "r_ankle")], axis=0)
    means = sum(averaged(hints, np.clip(1.5 - 2.5 * fastest, 0.0, 1.0), longest) for longest in (SETTLE_S, STANCE_S))
    forward = -1j * (ground["l_hip"] - ground["r_hip"])
    return np.asarray(0.5 * means * (forward.conj() / np.abs(forward))[:, None])


def table(away: Complex, up: FloatArray, grid: Grid) -> Complex:
    """Directions (T, cells) on the ground times the bilinear shares of cells. away, up: shares of the height."""
    nodes = ((np.abs(away), (0.0, *grid[0])), (up, grid[1]))
    far, high = (np.stack([np.interp(x, n, row) for row in np.eye(len(n))], axis=-1) for x, n in nodes)
    unit = away / np.maximum(np.abs(away), 0.03)
    return np.asarray((unit[:, None, None] * far[:, 1:, None] * high[:, None, :]).reshape(len(away), -1))


def velocity(path: FloatArray, settle: float) -> FloatArray:
    """Low-passed velocity (T, k), m/s, of a path (T, k), m."""
    share = 1.0 - np.exp(-DT / settle)
    return np.asarray(lfilter([share], [1.0, share - 1.0], np.diff(path, axis=0, prepend=path[:1]) / DT, axis=0))


def averaged(hints: Complex, planted: FloatArray, longest: float) -> Complex:
    """Low-passed hints (T, m); since both feet are planted (1, or less as they begin to move), up to `longest` s."""
    mean, age, out, forget = hints[0], SETTLE_S, np.empty_like(hints), 1.0 - np.exp(-DT / SETTLE_S)
    for k, share in enumerate(planted.tolist()):
        age += DT * share if share > 0.5 else (SETTLE_S - age) * forget
        out[k] = mean = mean + (1.0 - np.exp(-DT / min(age, longest))) * (hints[k] - mean)
    return out


def fit(subjects: list[Complex], cells: int) -> FloatArray:
    """Weights (m,) of the hints of some subjects. cells: of the hand."""
    hints = np.concatenate([hints[::2] for hints in subjects])
    share = np.concatenate([np.full(len(hints[::2]), len(hints) ** -0.5) for hints in subjects])
    share, x_of, y_of = share / share.sum(), hints.real.copy(), hints.imag.copy()
    start = np.zeros(hints.shape[1])
    start[: 2 * cells + 2] = *[0.25 * np.cos(INWARD)] * cells, *[0.25 * np.sin(INWARD)] * cells, 0.25, 0.3

    def loss(weights: FloatArray) -> tuple[float, FloatArray]:
        x, y, off = x_of @ weights, y_of @ weights, weights - start
        length = np.sqrt(x * x + y * y + 4e-4)
        angle = np.sqrt(1.01 - x / length)
        slope = -0.5 / angle * share / length**3
        gradient = x_of.T @ (slope * (length**2 - x * x)) - y_of.T @ (slope * x * y) + 2.0 * PULL * off
        return float(angle @ share + PULL * off @ off), gradient

    return np.asarray(minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 100}).x)


def main() -> None:
    """Both forms held out, and the weights of the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.heading_fit", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("../shared/mocap/cmu_prior"))
    folder = parser.parse_args().folder
    for form, hand, head in (("one weight per sensor", ONE, ONE), ("tables", HAND, HEAD)):
        cells, hints = len(hand[0]) * len(hand[1]), [load(folder / f"{name}.npz", hand, head) for name in SUBJECTS]
        errors = [abs(np.angle(own @ fit(hints[:i] + hints[i + 1 :], cells))).mean() for i, own in enumerate(hints)]
        print(f"{form}: mean error held out {np.degrees(np.mean(errors)):.1f} degrees")
        forward, side, lines, top = np.split(fit(hints, cells), [cells, 2 * cells, 2 * cells + 2])
        named = (("forward", forward, hand), ("side", side, hand), ("ankle, velocity", lines, ONE), ("head", top, head))
        for name, weights, grid in named:
            print(f"{name}:", *weights.reshape(len(grid[0]), -1).round(2).tolist(), sep="\n  - ")


if __name__ == "__main__":
    main()
