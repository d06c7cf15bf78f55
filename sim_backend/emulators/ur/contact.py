"""What the library's program does by ``tool_contact``: detect a contact, stop there and go back.

Of `rtde_control.script` in ur-rtde 1.6.5: its ``contact_thread`` waits until there is no contact,
then for one; the program's main loop then stops the move and goes to where the contact began. The
contact is looked for at the controller's cycles, however late the emulator gets to them.
"""

import numpy as np

from sim_backend.phantom.phantom import Phantom

STOP_M_S2 = 3.0
BACK_M_S, BACK_M_S2 = 0.25, 1.2  # ``movel``'s own defaults
LONGEST_S = 5.0
"""How far back the beginning of a contact is looked for."""


class Contact:
    """A contact is a push of ``contact_n`` or more against the motion; at rest, in any direction.

    ``steps_back``: cycles from just before the last contact found to its detection, 0 for none.
    ``stops``: the program obeys nothing, since it stops and goes back. ``misled``: it has a
    contact all the time, from its first look on.
    """

    def __init__(self, phantom: Phantom, period_s: float, contact_n: float) -> None:
        self.steps_back = 0
        self.stops = self.misled = False
        self.contact_n = contact_n
        self._phantom, self._period_s = phantom, period_s
        self._looked_s: float | None = None
        self._free = False
        self._back: tuple[float, float, float] | None = None

    def start(self, now: float) -> None:
        """Detect from now on."""
        self.steps_back, self._free, self._looked_s = 0, self.misled, now

    def end(self) -> None:
        """Detect no more."""
        self._looked_s = None

    def end_program(self) -> None:
        """The program has ended, and all that it was about."""
        self.stops, self._back = False, None
        self.end()

    def found(self, now: float) -> float | None:
        """When the program's main loop has heard of a contact; the detection then ends."""
        period_s = self._period_s
        while self._looked_s is not None and self._looked_s + 2 * period_s <= now:
            self._looked_s += period_s
            touches = self._touches(self._looked_s)
            if touches and self._free:
                found_s, self._looked_s = self._looked_s, None
                self.steps_back = self.steps(found_s)
                return found_s + period_s
            self._free = self._free or not touches
        return None

    def stop(self, heard_s: float) -> None:
        """Stop as of ``heard_s``, and then go back."""
        tip = self._phantom.tip
        self._back = tip.point(heard_s - (1 + self.steps_back) * self._period_s)
        self.stops = True
        tip.halt(heard_s, STOP_M_S2)

    def go_on(self, now: float) -> bool:
        """Go back once the tip rests; True when that is done."""
        tip = self._phantom.tip
        if not tip.moving(now) and self._back is not None:
            back, self._back = self._back, None
            tip.move(tip.all_legs()[-1].end_s, back, BACK_M_S, BACK_M_S2)
        self.stops = self._back is not None or tip.moving(now)
        return not self.stops

    def steps(self, time_s: float) -> int:
        """What ``tool_contact`` returns: cycles back to just before the contact; 0 without one."""
        if not self._touches(time_s):
            return 0
        before = np.linspace(time_s - LONGEST_S, time_s, 1 + round(LONGEST_S / self._period_s))
        free = np.flatnonzero(self._phantom.force_n(before) <= 0)
        return max(len(before) - 1 - int(free[-1] if len(free) else 0), 1)

    def _touches(self, time_s: float) -> bool:
        if self.misled:
            return True
        force_n = self._phantom.force_at(time_s)
        return force_n >= self.contact_n and self._phantom.tip.velocity(time_s)[2] <= 0
