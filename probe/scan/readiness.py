"""Every pose of a plan, as it is given to the stage."""

from drivers import Pose
from probe.planning.plan import Plan
from probe.planning.press_direction import pressed


def planned_poses(plan: Plan, *, turns: bool) -> list[Pose]:
    """Each once, in the order of the scan."""
    poses: dict[Pose, None] = {}
    for place in plan.places:
        for pose in (plan.above(place), pressed(plan.at_surface(place), plan.indentation_m)):
            poses[turned(pose, turns=turns)] = None
    return list(poses)


def turned(target: Pose, *, turns: bool) -> Pose:
    """The pose as it is given to the stage: only one that ``turns`` is asked to turn the tool."""
    return target if turns else Pose(*target[:3])
