"""Who may let the pressure loops open a valve: the operator's switch, and over it the arbiter's word on the air.

============ ======================= ========================================= =====================
the arbiter  operator on, set-points operator off, or no set-points yet        ends
============ ======================= ========================================= =====================
regulate     loops follow them       valves closed                             by hold or vent
hold         valves closed           valves closed                             by regulate or vent
vent         all open to ambient     all open to ambient                       by regulate alone
============ ======================= ========================================= =====================

Over-pressure vents its chamber whatever is said here (:class:`~mbpam_ros.pneumatics.controller.PressureController`).
"""

from __future__ import annotations

from enum import Enum

from numpy.typing import ArrayLike

from mbpam_ros.answer import Answer
from mbpam_ros.pneumatics.controller import PressureController


class Air(Enum):
    """What the valves have to do with the set-points."""

    REGULATE = "regulate"
    """Follow the set-points."""
    HOLD = "hold"
    """Close all valves; the set-points stay as they were."""
    VENT = "vent"
    """Vent at once, without any rate limit; all set-points are zero. Only a fault does this."""


class AirSwitch:
    """Stands before the pressure loops; nobody else enables, disables or vents them.

    Args:
        controller: the loops.
        switched_on: whether the operator has the air on from the start.
    """

    def __init__(self, controller: PressureController, switched_on: bool = False) -> None:
        self._controller = controller
        self._switched_on = switched_on
        self._air = Air.REGULATE
        self._has_setpoints = False

    @property
    def air(self) -> Air:
        """The arbiter's word that holds."""
        return self._air

    @property
    def switched_on(self) -> bool:
        """Whether the operator has the air on."""
        return self._switched_on

    @property
    def parting_opening(self) -> float:
        """Spool opening to leave all valves with when nobody will move them afterwards: closed, or venting."""
        return -1.0 if self._air is Air.VENT else 0.0

    def request(self, setpoint_gauge_pa: ArrayLike) -> bool:
        """Take set-points, shape (16,) [Pa gauge]; return whether they are the first, which may open valves.

        Raises:
            SetpointError: as :meth:`PressureController.request`; nothing was changed.
        """
        self._controller.request(setpoint_gauge_pa)
        if self._has_setpoints:
            return False
        self._has_setpoints = True
        self._apply()
        return True

    def obey(self, air: Air) -> bool:
        """Take the arbiter's word; return whether it changed anything.

        An arbiter started anew does not know of a stop before it and would keep what is still in the chambers: a vent
        does not yield to a hold.
        """
        if air is self._air or (self._air is Air.VENT and air is Air.HOLD):
            return False
        self._air = air
        self._apply()
        return True

    def switch(self, on: bool) -> Answer:
        """Take the operator's switch; on is refused unless the arbiter lets the loops regulate."""
        if on and self._air is not Air.REGULATE:
            return Answer(False, f"the arbiter says {self._air.value}; call grasp/reset first")
        self._switched_on = on
        self._apply()
        valves = "valves vent until grasp/reset" if self._air is Air.VENT else "valves closed"
        return Answer(True, "air on" if on else f"air off, {valves}")

    def _apply(self) -> None:
        if self._air is Air.VENT:
            self._controller.vent_all()
        elif self._air is Air.HOLD:
            self._controller.enable(False)
        else:
            self._controller.enable(True)  # ends a vent, also where the air is switched off
            # Started beside a gripper that holds, the loops must not take their own zeros for set-points.
            self._controller.enable(self._switched_on and self._has_setpoints)
