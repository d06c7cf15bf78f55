"""The hold: as long as its planner wants, and no longer than was asked for."""

from probe.planning.planner import Press
from probe.scan.choosing import Chooser
from probe.scan.run_loop import RunLoop


def hold(loop: RunLoop, chooser: Chooser, press: Press, began_s: float) -> float:
    """Stay until the planner has enough, at most until the last of ``press.holds_s``; how long."""
    last_s = press.holds_s[-1]
    for held_s in press.holds_s:
        loop.wait_until(began_s + held_s)
        if held_s == last_s:
            break
        loop.publish_samples()
        judged = chooser.enough(loop.clock.now(), threaded=loop.monitor.threaded)
        if loop.wait_for(judged, began_s + last_s) and judged.result():
            break
    return held_s
