"""What a scan may never exceed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from probe.planning.plan import Box

LEVER_M = 0.3  # from tip to sensor: longer than any finger in use
# A tip that rests so near to where it was sent has arrived: twice what reported poses jitter by.
ARRIVED_M = 0.1e-3

# A finger of 10 mm on 5 mm of tissue over bone: three times what the stiffest of the paper's scenes
# answers with a tumour beneath, twenty times its tissue (0.5 N/mm).
HARDEST_N_M = 10e3


@dataclass(frozen=True)
class Limits:
    """What may never be exceeded.

    ``max_depth_m`` is below the plan's surface. A device is silent after ``silence_s`` without a
    reading (at least five of a sensor's periods). ``face_m2`` turns pressure channels into force.
    ``max_force_n`` also limits the norm of a force of which several components are read;
    ``max_torque_nm`` that of a torque, by default the greatest force on a lever of `LEVER_M`.
    While the stage moves, readings may be ``late_s`` old (at least five periods). An engine that
    does nothing for ``engine_s`` is blocked. ``same_readings`` equal ones are a stuck sensor's.
    ``hardest_n_m`` is the stiffness [N/m] of the hardest thing that may lie beneath the probe: it
    says how soon a force that nobody reads may grow. A press that has gone ``contact_within_m``
    below the surface must have measured the tissue's force.
    ``filter_s`` is the time constant [s] of a sensor's own low pass, by its name.
    ``in_the_air``: a rehearsal, in which no press must meet a force.
    """

    max_force_n: float
    max_depth_m: float
    workspace_m: Box
    max_speed_m_s: float
    silence_s: float = 0.25
    clock_jump_s: float = 0.25
    face_m2: float | None = None
    max_torque_nm: float | None = None
    late_s: float = 0.2
    engine_s: float = 2.0
    same_readings: int = 100
    hardest_n_m: float = HARDEST_N_M
    contact_within_m: float = math.inf
    in_the_air: bool = False
    filter_s: Mapping[str, float] = field(default_factory=dict)
