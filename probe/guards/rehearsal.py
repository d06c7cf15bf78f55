"""A rehearsal: a real stage without a real force sensor makes the whole scan in the air.

Nothing that is simulated may guard a real stage, so the plan is lifted off the tissue and its
depth limit with it: the tip stays above the planned surface. What the simulated sensor feels there
is air.
"""

from collections.abc import Sequence
from dataclasses import replace

from drivers import ConfigError, Sensor, Stage
from probe.core.contact_stress import FORCE_ROLES
from probe.guards.device_facts import SensorFacts, StageFacts
from probe.planning.limits import Limits
from probe.planning.plan import Plan, check_reach

AIR_M = 10e-3  # between the deepest point of a rehearsal and the planned surface
SURFACE_M = 0.5e-3  # and between the planned surface and where a guard stops the stage


def needs_rehearsal(stage: Stage | StageFacts, sensors: Sequence[Sensor | SensorFacts]) -> bool:
    """Whether the stage is real and everything that would feel its force is simulated."""
    force_channels = [c for s in sensors for c in s.channels if c.role in FORCE_ROLES]
    return not stage.simulated and bool(force_channels) and all(c.simulated for c in force_channels)


def lift_m(plan: Plan) -> float:
    """How far [m] a plan is lifted so that its deepest point is `AIR_M` over the surface."""
    return plan.deepest_below_m + AIR_M


def in_the_air(plan: Plan, limits: Limits) -> tuple[Plan, Limits]:
    """The same presses above the tissue. Raises `ConfigError` if the workspace is too low."""
    surface, up_m = plan.surface, lift_m(plan)
    lifted = replace(
        plan, surface=lambda x, y: surface(x, y) + up_m, touch_n=None, force_n=None, steps_n=()
    )
    try:
        check_reach(lifted, limits.workspace_m)
    except ConfigError as error:
        raise ConfigError(
            f"without a real force sensor the scan is rehearsed {1e3 * up_m:g} mm higher: {error}"
        ) from None
    return lifted, replace(limits, max_depth_m=up_m - SURFACE_M, in_the_air=True)
