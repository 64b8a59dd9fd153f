"""Who may let the pressure loops open a valve: the operator's switch, and over it the arbiter's word on the air.

============ ======================= ========================================= =====================
the arbiter  operator on, set-points operator off, or no set-points yet        ends
============ ======================= ========================================= =====================
regulate     loops follow them       valves closed                             by hold or vent
hold         valves closed           valves closed                             by regulate or vent
vent         all open to ambient     all open to ambient                       by clear and regulate
============ ======================= ========================================= =====================

A vent is latched, whoever asked for it: the arbiter's word, or the operator beside it (``valve_controller/vent``). An
arbiter started anew, which knows of none, does not lift it; only a clear does, which ``grasp/reset`` asks for.

What the arbiter says is worth something only while there is one, and no more than one:

===================================== ======================= =============== ===================
                                      a grasp that closes     one that holds  new set-points
===================================== ======================= =============== ===================
the arbiter has fallen silent         vented, latched         goes on         refused
two of one name, or two who command   vented, latched         valves closed   refused
===================================== ======================= =============== ===================

A managed node bars the switch while it is inactive (:meth:`AirSwitch.bar`): the air is off then, as by the operator,
and nobody switches it on.

Over-pressure vents its chamber whatever is said here (:class:`~mbpam_ros.pneumatics.controller.PressureController`).
"""

from __future__ import annotations

from enum import Enum

from numpy.typing import ArrayLike

from mbpam_ros.answer import Answer
from mbpam_ros.pneumatics.controller import PressureController, SetpointError


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
        self._closing = False
        self._has_setpoints = False
        self._vent_reason = ""
        self._arbiter_lost = False
        self._barred = ""
        self._contested: dict[str, str] = {}

    @property
    def air(self) -> Air:
        """What the valves do: the arbiter's word, unless a vent is latched."""
        return Air.VENT if self._vent_reason else self._air

    @property
    def vent_reason(self) -> str:
        """Why a vent is latched; empty where none is."""
        return self._vent_reason

    @property
    def switched_on(self) -> bool:
        """Whether the operator has the air on."""
        return self._switched_on

    @property
    def objection(self) -> str | None:
        """Why nobody's set-points are taken now, or None."""
        if self._contested:
            return "; ".join(self._contested.values())
        return "the arbiter has fallen silent" if self._arbiter_lost else None

    @property
    def parting_opening(self) -> float:
        """Spool opening to leave all valves with when nobody will move them afterwards: closed, or venting."""
        return -1.0 if self.air is Air.VENT else 0.0

    def request(self, setpoint_gauge_pa: ArrayLike) -> bool:
        """Take set-points, shape (16,) [Pa gauge]; return whether they are the first, which may open valves.

        Raises:
            SetpointError: as :meth:`PressureController.request`, or nobody may ask now; nothing was changed.
        """
        if self.objection is not None:
            raise SetpointError(f"no set-points are taken: {self.objection}")
        self._controller.request(setpoint_gauge_pa)
        if self._has_setpoints:
            return False
        self._has_setpoints = True
        self._apply()
        return True

    def obey(self, air: Air, closing: bool = False, reason: str = "") -> bool:
        """Take the arbiter's word, whether a grasp closes now, and why; return whether the word changed anything."""
        self._closing = closing
        if air is self._air:
            return False
        before, self._air = self.air, air
        if air is Air.VENT and not self._vent_reason:
            self._vent_reason = reason or "the arbiter said so"
        self._apply()
        return self.air is not before

    def vent(self, reason: str) -> Answer:
        """Vent everything at once, and until it is cleared."""
        self._vent_reason = self._vent_reason or reason
        self._closing = False
        self._apply()
        return Answer(True, "venting until grasp/reset")

    def clear(self) -> Answer:
        """Lift a latched vent; the valves go on venting for as long as the arbiter says so."""
        if not self._vent_reason:
            return Answer(True, "no vent is latched")
        self._vent_reason = ""
        self._apply()
        return Answer(True, "the vent is no longer latched")

    def lose_arbiter(self) -> None:
        """Go on without an arbiter: it has given no sign of life."""
        self._arbiter_lost = True
        if self._closing:
            self.vent("the arbiter fell silent while a grasp closed")

    def find_arbiter(self) -> None:
        """Listen to the arbiter again: it lives."""
        self._arbiter_lost = False

    def contest(self, by: str, reason: str | None) -> None:
        """Take notice that there are two (``by`` whom, and in words), or of one no longer (None)."""
        if reason is None:
            self._contested.pop(by, None)
        else:
            self._contested[by] = reason
            if self._closing:
                self.vent(reason)
        self._apply()

    def switch(self, on: bool) -> Answer:
        """Take the operator's switch; on is refused unless the arbiter lets the loops regulate."""
        if on and self._vent_reason:
            return Answer(False, f"all is vented ({self._vent_reason}); call grasp/reset first")
        if on and self._air is not Air.REGULATE:
            return Answer(False, f"the arbiter says {self._air.value}; call grasp/reset first")
        if on and (self._barred or self.objection is not None):
            return Answer(False, f"nothing new is opened: {self._barred or self.objection}")
        self._switched_on = on
        self._apply()
        valves = "valves vent until grasp/reset" if self.air is Air.VENT else "valves closed"
        return Answer(True, "air on" if on else f"air off, {valves}")

    def bar(self, reason: str) -> None:
        """Switch the air off, and refuse to switch it on for this reason until :meth:`unbar`."""
        self._barred = reason
        self.switch(False)

    def unbar(self) -> None:
        """Leave it to the operator again; the air stays off until somebody switches it on."""
        self._barred = ""

    def _apply(self) -> None:
        if self.air is Air.VENT:
            self._controller.vent_all()
            return
        if self._controller.vented:
            self._controller.enable(True)  # ends the vent, also where the loops are not to run
        # Started beside a gripper that holds, the loops must not take their own zeros for set-points.
        regulating = self._air is Air.REGULATE and self._switched_on and self._has_setpoints
        self._controller.enable(regulating and not self._contested)
