"""What answers a fault, in each phase of a grasp.

A held object is kept wherever that is safe; over-pressure is never trapped; nothing fills blind. The answers:

================== ============================================================ ===================================
answer             what happens                                                 the grasp
================== ============================================================ ===================================
regulate on        the loops go on; no new grasp begins while the finding       goes on
                   stands
grip harder        the other chambers take over what that one held, within the  fault, latched; the object stays
                   limit; the loops go on
hold               all valves closed                                            fault, latched; the object stays
vent that channel  that valve vents, all others are closed                      fault, latched; the object may stay
cut the supply     supply shut and dumped, all valves closed                    fault, latched; the object may stay
vent all           all valves vent, supply shut and dumped                      fault, latched; the object is let go
================== ============================================================ ===================================

The way back is the same for all: mend it, ``grasp/release`` where something is held, ``grasp/reset`` once the pressures
are down and nothing odd is seen of them for a second. A fault that was only reset is found again in the next grasp.

"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

from mbpam_ros.grasp.phases import Phase
from mbpam_ros.pneumatics.air_switch import Air
from mbpam_ros.pneumatics.findings import Fault, Finding


class Response(Enum):
    """What answers a fault; the later one wins where several are called for."""

    REGULATE = "regulate on"
    GRIP_HARDER = "grip harder"
    HOLD = "hold"
    VENT_CHANNEL = "vent that channel"
    CUT_SUPPLY = "cut the supply"
    VENT_ALL = "vent all"

    @property
    def air(self) -> Air:
        """What the valves have to do; the channel and the supply are seen to where the fault is found."""
        return _AIR[self]


_AIR = {
    Response.REGULATE: Air.REGULATE,
    Response.GRIP_HARDER: Air.REGULATE,
    Response.HOLD: Air.HOLD,
    Response.VENT_CHANNEL: Air.HOLD,
    Response.CUT_SUPPLY: Air.HOLD,
    Response.VENT_ALL: Air.VENT,
}
_SEVERITY = list(Response)
_PHASES = (Phase.IDLE, Phase.CLOSING, Phase.HOLDING, Phase.RELEASING)


def _row(idle: Response, closing: Response, holding: Response, releasing: Response) -> dict[Phase, Response]:
    return dict(zip(_PHASES, (idle, closing, holding, releasing), strict=True))


_ON, _HOLD, _CUT, _VENT = Response.REGULATE, Response.HOLD, Response.CUT_SUPPLY, Response.VENT_ALL
_HARDER = Response.GRIP_HARDER

RESPONSES: dict[Fault, dict[Phase, Response]] = {
    Fault.NOT_FOLLOWING: _row(_ON, _VENT, _HARDER, _ON),
    Fault.NOT_VENTING: _row(_ON, _VENT, _HOLD, _VENT),
    Fault.JUMPED: _row(_ON, _VENT, _HOLD, _ON),
    Fault.SWAPPED: _row(_ON, _VENT, _HOLD, _ON),
    Fault.RISES: _row(_VENT, _VENT, _CUT, _VENT),
    Fault.LEAKS_IN: _row(_VENT, _VENT, _ON, _VENT),
    Fault.LEAK: _row(_ON, _ON, _ON, _ON),
    Fault.LEAK_OR_DRIFT: _row(_ON, _ON, _ON, _ON),
    Fault.DRIFT: _row(_ON, _VENT, _HARDER, _ON),
    Fault.SLOW_VALVE: _row(_ON, _VENT, _HOLD, _ON),
    Fault.NOISY: _row(_ON, _ON, _ON, _ON),
    Fault.SUPPLY_LOW: _row(_ON, _VENT, _HOLD, _ON),
    Fault.NO_READING: _row(_ON, _VENT, _HOLD, _ON),
    Fault.OVER_PRESSURE: _row(_VENT, _VENT, _VENT, _VENT),
}
"""The table: fault, phase, answer. In the phase fault what holds keeps to the column of holding, what vents goes on."""


def goes_on(fault: Fault) -> bool:
    """Return whether a grasp goes on with this fault, whatever its phase."""
    return all(answer is Response.REGULATE for answer in RESPONSES[fault].values())


def respond(findings: Sequence[Finding], phase: Phase) -> tuple[Response, str]:
    """Return the gravest answer that findings call for in a phase, and what called for it, in words."""
    column = Phase.HOLDING if phase is Phase.FAULT else phase
    answer, cause = Response.REGULATE, ""
    for finding in findings:
        own = RESPONSES[finding.fault][column]
        if not cause or _SEVERITY.index(own) > _SEVERITY.index(answer):
            answer, cause = own, finding.text
    return answer, cause


def table_text() -> str:
    """Return the table as it stands in the manual."""
    header = ("fault", *(phase.value for phase in _PHASES))
    rows = [(fault.value, *(row[phase].value for phase in _PHASES)) for fault, row in RESPONSES.items()]
    widths = [max(len(line[i]) for line in (header, *rows)) for i in range(len(header))]
    rule = " ".join("=" * width for width in widths)
    lines = [" ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in (header, *rows)]
    return "\n".join([rule, lines[0].rstrip(), rule, *(line.rstrip() for line in lines[1:]), rule]) + "\n"


__doc__ = f"{__doc__}{table_text()}"
