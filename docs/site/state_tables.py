"""The states of a run as tables, from those that the supervisor executes."""

from math import inf

from retarget.run.supervisor import STATES, TRANSITIONS, Event, Transition


def tables_of_states() -> str:
    """The states and the transitions in Markdown."""
    lines = ["| state | who gives the targets | torque | longest |", "|---|---|---|---|"]
    for state, row in STATES.items():
        longest = "" if row.limit_s == inf else f"{row.limit_s:g} s"
        lines.append(f"| {state.value} | {row.controls} | {'on' if row.torque else 'off'} | {longest} |")
    lines += ["", "| from | when | to | stop category |", "|---|---|---|---|"]
    alike: dict[tuple[Event, Transition], list[str]] = {}
    for (state, event), transition in TRANSITIONS.items():
        alike.setdefault((event, transition), []).append(state.value)
    for (event, transition), states in alike.items():
        category = "" if transition.category is None else str(int(transition.category))
        lines.append(f"| {', '.join(states)} | {event.value} | {transition.to.value} | {category} |")
    return "\n".join(lines)
