"""Before the first move: the stage made ready, and asked about every pose of the plan."""

from drivers import DeviceFault, Pose, Stage
from drivers.core import abilities
from probe.planning.plan import Plan
from probe.planning.press_direction import pressed


def make_ready(stage: Stage, plan: Plan) -> list[str]:
    """What the stage then says of itself. Raises `DeviceFault` if it cannot make the scan."""
    words = abilities.enable(stage)
    poses: dict[Pose, None] = {}  # each once, in the order of the scan
    for place in plan.places:
        for pose in (plan.above(place), pressed(plan.at_surface(place), plan.indentation_m)):
            poses[turned(stage, pose)] = None
    if far := abilities.unreachable(stage, list(poses)):
        pose, why = next(iter(far.items()))
        x, y, z = (1e3 * at for at in pose[:3])
        raise DeviceFault(
            stage.name, f"cannot go to {len(far)} of {len(poses)} planned poses, such as "
            f"{x:.1f}, {y:.1f}, {z:.1f} mm: {why}"
        )  # fmt: skip
    return words


def turned(stage: Stage, target: Pose) -> Pose:
    """The pose as it is given to the stage: only one that ``turns`` is asked to turn the tool."""
    return target if abilities.turns(stage) else Pose(*target[:3])
