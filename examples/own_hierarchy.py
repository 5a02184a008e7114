"""Strict priorities: a hand is asked for a point out of reach; balance and feet do not give a millimetre."""

from retarget import ik
from retarget.model.human import build_human
from retarget.model.human_dimensions import proportional_dimensions


def main() -> None:
    """Ask for the impossible for a second, and print who paid for it."""
    human = build_human(proportional_dimensions(1.75))
    balance = ik.CentreOfMass(weight=(1.0, 1.0, 0.0))
    left, right, hand = (ik.Position(name) for name in ("l_ankle", "r_ankle", "r_wrist"))
    levels = [[balance], [left, right], [hand], [ik.Posture()]]
    solver = ik.Solver(human.body, levels, start=human.posture("attractor"))
    targets = {left: solver.position("l_ankle"), right: solver.position("r_ankle"), balance: solver.centre_of_mass}
    targets[hand] = solver.position("r_wrist") + 2.0
    for _ in range(120):
        solver.solve(targets, 1 / 120)
    for name, task in {"centre of mass": balance, "l_ankle": left, "r_ankle": right, "r_wrist": hand}.items():
        print(f"{name:15s} {1000 * solver.error(task):8.2f} mm off")


if __name__ == "__main__":
    main()
