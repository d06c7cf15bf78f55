"""The way in, at once or in steps that are held: to depths or to forces."""

from drivers import Pose
from probe.planning.planner import Press
from probe.scan.force_press import REACHED, press_to_force
from probe.scan.indenting import press_to_depth
from probe.scan.run_loop import RunLoop


def press_in(loop: RunLoop, surface: Pose, press: Press) -> float:
    """Hold each of the plan's steps that ``press`` goes beyond, and arrive at its end; how deep
    that is [m]."""
    plan = loop.plan
    if press.force_n is not None:
        force_n = 0.0
        for step_n in (n for n in plan.steps_n if n < press.force_n):
            depth_m, force_n = press_to_force(loop, surface, press, step_n, force_n)
            loop.wait_until(loop.clock.now() + plan.step_hold_s)
            if force_n < (1 - REACHED) * step_n:
                return depth_m  # nor are those after it
        return press_to_force(loop, surface, press, press.force_n, force_n)[0]
    at_m = 0.0
    for step_m in (m for m in plan.steps_m if m < press.depth_m):
        press_to_depth(loop, surface, step_m, plan.ramp_s * (step_m - at_m) / press.depth_m)
        loop.wait_until(loop.clock.now() + plan.step_hold_s)
        at_m = step_m
    return press_to_depth(
        loop, surface, press.depth_m, plan.ramp_s * (press.depth_m - at_m) / press.depth_m
    )
