"""What no test noticed when breakages were chosen by somebody who had not seen the others."""

from mutants.mutant import Mutant

RETREAT, MONITOR = "probe/acquisition/retreat.py", "probe/acquisition/safety_monitor.py"
CALIBRATED, SCAN_PLAN = "probe/config/calibrated.py", "probe/config/scan_plan.py"
WAY_OUT = ("tests/probe/acquisition/test_way_out.py",)
MONITORED = ("tests/probe/acquisition/test_safety_monitor.py",)
LINE_STAGES = ("tests/drivers/test_line_stages.py",)
LIMITED = ("tests/probe/acquisition/test_force_limit.py",)
WAYS = ("tests/probe/acquisition/test_ways.py",)
LOST = ("tests/probe/storage/test_lost_files.py",)
POSE_GUARD, PRESS_GUARD = "probe/acquisition/pose_guard.py", "probe/acquisition/press_guard.py"
ENGINE = "probe/acquisition/engine.py"

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
    Mutant("ur: a state from before the order says that the arm has arrived",
           "drivers/ur/stage.py",
           "if state.busy or not rests or state.arrival_s < self._set_off_s:",
           "if state.busy or not rests:", ("tests/drivers/ur/test_motion.py",)),
    Mutant("standa: axes behind a lost one are not stopped", "drivers/standa.py",
           "continue  # a lost axis shows in", "break  # a lost axis shows in",
           ("tests/drivers/test_standa.py",)),
    Mutant("the way that was commanded has no end", POSE_GUARD,
           "share = min(max(along / length2, 0.0), 1.0) if length2 else 0.0",
           "share = along / length2 if length2 else 0.0", MONITORED),
    Mutant("beyond the other end of the workspace a lift is forbidden", POSE_GUARD,
           'above = axis == "z" and at > high', 'above = axis == "z" and at < low', MONITORED),
    Mutant("the time without a reading forgets the force there is", PRESS_GUARD,
           "room_n = max(limits.max_force_n - abs(one.force_n), 0.0)",
           "room_n = limits.max_force_n", LIMITED),
    Mutant("the rise amid which a press begins is its noise", PRESS_GUARD,
           "self._noise_n = min(self._noise_n, noise_n) if down else noise_n",
           "self._noise_n = noise_n", LIMITED),
    Mutant("only the newest reading of a block is held to the one before",
           "probe/acquisition/plausibility.py", "for reading in values.tolist():",
           "for reading in values[-1:].tolist():", LIMITED),
    Mutant("a soft rig is followed without bound", ENGINE,
           "yielded_m = min(yielded_m, plan.max_deflection_m)", "yielded_m = max(yielded_m, 0.0)",
           WAYS),
    Mutant("sideways to a station before up", ENGINE,
           "            self.go(here._replace(z=above.z), plan.travel_m_s)\n",
           "            pass\n", WAYS),
    Mutant("the load before the tare is what the next is held to", ENGINE,
           "self.known_levels = {name: (0.0, error) for name, (_, error) in near.items()}",
           "self.known_levels = near", WAYS),
    Mutant("who takes over lifts amid a homing", "probe/acquisition/guard_process.py",
           'self._monitor.object("guard", why, can_retract=lift)',
           'self._monitor.object("guard", why, can_retract=True)',
           ("tests/probe/acquisition/test_guards_of_guards.py",)),
    Mutant("a tare takes readings from before a gap", "drivers/core/reader.py",
           "[s.values for s in recent if s.time_s > newest_s - TARE_S]",
           "[s.values for s in recent]", ("tests/drivers/core/test_reader.py",)),
    Mutant("crosstalk is taken out of the other channel", CALIBRATED,
           "np.linalg.inv(force.sensitivity).T", "np.linalg.inv(force.sensitivity)",
           ("tests/probe/config/test_calibrated.py",)),
    Mutant("the seal is not held to the chain", "probe/storage/verify.py",
           "if sealed[1] != chain:", "if sealed[1] is None:", LOST),
    Mutant("a run is unsealed in its log only", "probe/storage/schema.py",
           '    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()\n', "", LOST),
)  # fmt: skip
