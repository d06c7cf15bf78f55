"""The way out: bring the stage to rest, then lift the tip, as soon as the stage lets it.

One step every few milliseconds. Stops are ordered until the stage is seen at rest (`stopping`), one
that does not answer is asked again, and a lift that makes matters worse is broken off.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress

from drivers import DeviceFault, Pose, Stage
from drivers.core import abilities
from drivers.core.abilities import StopMeans
from probe.guards.stopping import SEEN_S, Stopping
from probe.planning.limits import ARRIVED_M, Limits

# None of these times and ways is critical: halved and doubled one by one, they change the 0.7 s in
# which a stage leaves a spring, a pulse of 12 % or a cough by at most 0.1 s, and after five refused
# lifts the 1.2 s by 0.5 s (`Stage` of tests/probe/guards/test_way_out.py).
STILL_M = 20e-6  # at rest: not further than this from where it was `SEEN_S` ago
LIFT_AGAIN_S = 0.1
LIFT_SHARE = 0.25  # of the greatest speed: a lift is no emergency once the stage rests
LIFTS = 3  # a patient who moves may make the first ones worse
PATIENCE_S = 10.0  # for a stage that does not answer, stop or lift
WRONG_WAY_M = 0.1e-3  # a lift may begin with this much slack of the stage
WORSE = 1.2  # a lift may begin with this much more force: friction, the end of a pulse
UP_M = 5e-6  # not worth a lift; after one, `ARRIVED_M` is close enough


def lift_speed_m_s(stage: Stage, limits: Limits) -> float:
    """Never more than the stage takes: a lift that it refuses leaves the probe in the tissue."""
    return min(LIFT_SHARE * limits.max_speed_m_s, abilities.max_speed_m_s(stage))


class Retreat:
    """``means`` are the stage's ways to stop; ``start`` begins a move; ``force_n`` is the latest
    force; ``lift_z_m`` None: only stop.

    ``led_down``: the last order led below ``lift_z_m``, so the tip is lifted even if the pose says
    that it is up.

    ``why_not`` says why the tip could not be brought up, once ``done``; ``lifting`` is true from
    the first order to lift on, ``up`` once the tip was lifted; ``unsure`` where it was told to lift
    and its place, which never changed, does not say whether it did.
    """

    def __init__(
        self,
        means: Sequence[StopMeans],
        start_again: Callable[[], None],
        moving: Callable[[], bool],
        start: Callable[[Pose, float], None],
        force_n: Callable[[], float],
        lift_z_m: float | None,
        speed_m_s: float,
        began_s: float,
        most_n: float,
        led_down: bool,
    ) -> None:
        self.done = False
        self.lifting = self.up = self.unsure = False
        self.why_not: str | None = None
        self._stopping = Stopping(means)
        self._moving, self._start, self._force_n = moving, start, force_n
        self._start_again = start_again
        self._lift_z_m, self._speed_m_s = lift_z_m, speed_m_s
        self._most_n, self._led_down = most_n, led_down
        self._deadline_s = began_s + PATIENCE_S
        self._tried_s = -math.inf
        self._trouble = "it does not come to rest"
        self._broken_off = 0
        self._poses: deque[tuple[float, Pose]] = deque()
        self._from: Pose | None = None
        self._frozen: tuple[Pose, float] | None = None  # where, and the force, when told to lift
        self._limit_n = math.inf
        self._stays = False

    @property
    def unheeded(self) -> tuple[str, ...]:
        """The ways to stop that were not seen to work."""
        return self._stopping.unheeded

    def stay(self) -> None:
        """Do not lift (any more): rest where it is. From any thread; the next `step` obeys."""
        self._stays = True

    def step(self, now_s: float, pose: Pose | None, trouble: str) -> None:
        """Look at the newest ``pose`` (None: the stage gives none, for ``trouble``) and act."""
        if self.done:
            return
        if self._stays:
            self._lift_z_m = self._from = None
        if self._frozen and pose and math.dist(pose[:3], self._frozen[0][:3]) > STILL_M:
            self._frozen = None
        try:
            moving = self._moving()
        except DeviceFault as fault:
            pose, trouble = None, str(fault)
        if pose is None:
            self._trouble = trouble
            self._poses.clear()
            self._wake(now_s)
        elif self._from is not None:
            self._watch_the_lift(now_s, pose, moving)
            return
        elif self._at_rest(now_s, pose, moving):
            self._stopping.worked()
            self._rested(now_s, pose)
            return
        self._stopping.order(now_s, seen=pose is not None)
        if now_s > self._deadline_s:
            self._stopping.exhaust()
            self._end(f"the stage: {self._trouble}")

    def _wake(self, now_s: float) -> None:
        """A stage that its own watchdog has halted lifts nothing until it is started again."""
        if self._lift_z_m is not None and now_s - self._tried_s >= LIFT_AGAIN_S:
            self._tried_s = now_s
            with suppress(DeviceFault):  # the stage's own trouble says more
                self._start_again()

    def _rested(self, now_s: float, pose: Pose) -> None:
        near_m = ARRIVED_M if self.lifting else UP_M
        if self._lift_z_m is None:
            self._end(self.why_not)
        elif pose.z >= self._lift_z_m - near_m and (self.lifting or not self._led_down):
            self.up = True
            self._end(self.why_not)
        elif not self._stopping.lifts:
            self._end(
                f"the stage obeyed no stop but {self._stopping.name}, after which the program "
                "cannot move it"
            )
        elif now_s > self._deadline_s:
            self._end(f"the stage: {self._trouble}")
        elif now_s - self._tried_s >= LIFT_AGAIN_S:
            self._tried_s = now_s
            force_n = abs(self._force_n())
            self._limit_n = max(WORSE * force_n, self._most_n) if math.isfinite(force_n) else 0.0
            try:
                self._start(pose._replace(z=max(self._lift_z_m, pose.z)), self._speed_m_s)
            except DeviceFault as fault:
                self._trouble = str(fault)
                with suppress(DeviceFault):  # the harder ways to stop end what the stage runs
                    self._start_again()
                return
            if not self.lifting:  # once: a stage that rests short for ever must not be asked so
                way_s = (self._lift_z_m - pose.z) / self._speed_m_s
                self._deadline_s = max(self._deadline_s, now_s + 2 * way_s + PATIENCE_S)
                self._frozen = pose, force_n
            self.lifting, self._from = True, pose
            self._trouble = "it has not arrived"
            self._poses.clear()

    def _watch_the_lift(self, now_s: float, pose: Pose, moving: bool) -> None:
        assert self._from is not None
        assert self._lift_z_m is not None
        down_m = self._from.z - pose.z
        aside_m = math.dist(self._from[:2], pose[:2])
        force_n = abs(self._force_n())
        if down_m > WRONG_WAY_M or aside_m > 5 * WRONG_WAY_M:
            self._break_off(now_s, "commanded to lift, the stage went another way")
        elif force_n > self._limit_n > 0:
            self._break_off(now_s, f"lifting raised the force to {force_n:.3f} N")
        elif now_s > self._deadline_s:
            self._give_up(now_s, f"the stage: {self._trouble}")
        elif self._at_rest(now_s, pose, moving):
            self._from = None
            self._rested(now_s, pose)

    def _break_off(self, now_s: float, why: str) -> None:
        """Stop, and lift again from rest: it may have been the patient who moved, or a hand."""
        self._broken_off += 1
        if self._broken_off >= LIFTS:
            self._give_up(now_s, why)
            return
        self._trouble, self._from, self._tried_s = why, None, now_s
        self._poses.clear()
        self._stopping.order(now_s, seen=True)

    def _give_up(self, now_s: float, why: str) -> None:
        self.why_not = why
        self._stays, self._lift_z_m, self._from = True, None, None
        self._poses.clear()
        self._stopping.order(now_s, seen=True)

    def _at_rest(self, now_s: float, pose: Pose, moving: bool) -> bool:
        self._poses.append((now_s, pose))
        while len(self._poses) > 1 and self._poses[1][0] <= now_s - SEEN_S:
            self._poses.popleft()
        then_s, then = self._poses[0]
        still = then_s <= now_s - SEEN_S and math.dist(then[:3], pose[:3]) < STILL_M
        return still and not moving

    def _end(self, why_not: str | None) -> None:
        if self._frozen is not None and why_not is not None:
            before_n, now_n = self._frozen[1], abs(self._force_n())
            self.unsure = not now_n > before_n / 2 > 0  # what still presses has lost less than that
            why_not = (
                "the stage was told to lift, and the place that it reports has not changed since; "
                f"the force went from {before_n:.3f} N to {now_n:.3f} N"
            )
        self.why_not, self.done = why_not, True
