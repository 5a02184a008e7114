"""Judges a run that was hurt before its bus was opened."""

from sim.faults.reaction import Idle, Row
from sim.faults.trace import Trace
from sim.faults.wire_checker import not_reads
from sim.faults.wire_packets import packets

CONTROLLERS = frozenset((200,))
"""Ids of what is no servo: the OpenCR, whose power switch is written."""


def idle_wrong(row: Row, trace: Trace) -> list[str]:
    """What was not as the row says, a line each."""
    match row.idle:
        case Idle.GOES_ON:
            return [f"it did not begin: {trace.error}"] if trace.error or not trace.ticks else []
        case Idle.ANY:
            return []
    wrong = [] if trace.error or (trace.gone is not None and not trace.left) else ["it began"]
    wrong += ["torque is on"] if any(trace.torque) else []
    wrong += [f"the refusal does not name {text!r}" for text in row.refusal if text not in trace.error]
    if row.idle is Idle.ONLY_READS:
        wrong += not_reads(list(packets(trace.sent)), but=CONTROLLERS)
    return wrong
