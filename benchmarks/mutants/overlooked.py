"""What no test noticed when breakages were chosen by somebody who had not seen the others."""

from mutants.mutant import Mutant

RETREAT, MONITOR = "probe/acquisition/retreat.py", "probe/acquisition/safety_monitor.py"
CALIBRATED, SCAN_PLAN = "probe/config/calibrated.py", "probe/config/scan_plan.py"
WAY_OUT = ("tests/probe/acquisition/test_way_out.py",)
MONITORED = ("tests/probe/acquisition/test_safety_monitor.py",)
LINE_STAGES = ("tests/drivers/test_line_stages.py",)

OVERLOOKED = (
    Mutant("lift down to the travel height from above it", RETREAT,
           "z=max(self._lift_z_m, pose.z)", "z=self._lift_z_m", WAY_OUT),
    Mutant("the time of a long lift is its way times its speed", RETREAT,
           "(self._lift_z_m - pose.z) / self._speed_m_s",
           "(self._lift_z_m - pose.z) * self._speed_m_s", WAY_OUT),
    Mutant("a lift that goes sideways goes on", RETREAT,
           "if down_m > WRONG_WAY_M or aside_m > 5 * WRONG_WAY_M:",
           "if down_m > WRONG_WAY_M:", WAY_OUT),
    Mutant("a second objection lifts what must stay", MONITOR,
           "self._begin_retreat(lift=can_retract and self.trip.can_retract)",
           "self._begin_retreat(lift=can_retract)", MONITORED),
    Mutant("the monitor forgets that the last order led down", MONITOR,
           "            self._down_m_s > 0,\n        )",
           "            False,\n        )", MONITORED),
    Mutant("what a calibrated sensor has lost is forgotten", CALIBRATED,
           "Block(time_s, values, saturated, block.lost, block.jumped_s)",
           "Block(time_s, values, saturated, 0, block.jumped_s)",
           ("tests/probe/config/test_calibrated.py",)),
    Mutant("the depth that is allowed holds along the normal only", SCAN_PLAN,
           "deepest_mm = 1e3 * plan.deepest_below_m", "deepest_mm = 1e3 * plan.deepest_m",
           ("tests/probe/config/test_rig.py",)),
    Mutant("zaber: the reply to another command is taken", "drivers/zaber.py",
           "words[:3] == text.split()[:3]", "words[:2] == text.split()[:2]", LINE_STAGES),
    Mutant("tmcl: a motor that has not set off yet has arrived", "drivers/tmcl.py",
           "return since_s < SETS_OFF_S and not self._axis(name, GAP, REACHED)",
           "return False", LINE_STAGES),
    Mutant("standa: axes behind a lost one are not stopped", "drivers/standa.py",
           "continue  # a lost axis shows in", "break  # a lost axis shows in",
           ("tests/drivers/test_standa.py",)),
)  # fmt: skip
