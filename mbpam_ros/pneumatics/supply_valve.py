"""The valve before all others: it shuts the supply and dumps what stands before the valves.

========================================== ======= ==========================================
what is so                                 supply  until
========================================== ======= ==========================================
the air was never switched on              shut    ``enable``
the air is on                              open    anything below
the operator has switched the air off      shut    ``enable``
a stop, or a fault that vents all          shut    ``reset``
over-pressure for :data:`CURED_S`          shut    it is gone, and nothing is found that rises
a chamber rises without its valve          shut    the finding is gone
no pressures for the watchdog's time       shut    there are some
========================================== ======= ==========================================
"""

from __future__ import annotations

import math

CURED_S = 0.02
"""What venting has not cured by then, it does not cure."""


class SupplyValve:
    """Decides whether the supply is open."""

    def __init__(self) -> None:
        self._over_since_s = math.inf
        self._shut_for_over = False
        self.open = False

    def update(self, time_s: float, switched_on: bool, vented: bool, over: bool, rising: bool, blind: bool) -> bool:
        """Return whether it is to be open now.

        Args:
            switched_on: the operator's switch.
            vented: whether everything vents after a stop or fault.
            over: whether any chamber is in over-pressure.
            rising: whether any rises without its valve.
            blind: whether the pressures stay out.
        """
        if not over:
            self._over_since_s, self._shut_for_over = math.inf, False
        else:
            self._over_since_s = min(self._over_since_s, time_s)
            self._shut_for_over |= time_s - self._over_since_s >= CURED_S - 1e-9
        self.open = switched_on and not (vented or self._shut_for_over or rising or blind)
        return self.open
