"""From a rig to what chooses its presses: a planner by its name, with the keys of its table."""

from pydantic import ValidationError

from drivers import ConfigError, open_driver, settings_of
from probe.config.rig import RASTER, Rig, RigError
from probe.planning.plan import Plan
from probe.planning.planner import Planner, Raster
from sim_backend.scene.explain import explain


def planner_for(rig: Rig, plan: Plan) -> Planner:
    """What chooses among the stations of ``plan``: `scan.planner`, with the keys of `planner`.

    Raises `RigError` where there is no such planner, or it does not take these keys.
    """
    name = rig.scan.planner
    if name == RASTER and not rig.planner:
        return Raster(plan)  # the default works whatever packages are installed
    try:
        planner = open_driver("planners", name, plan, rig.planner)
    except ValidationError as error:
        lines = explain(error, settings_of("planners", name))
        raise RigError("\n".join(f"planner.{line}" for line in lines)) from None
    except ConfigError as error:
        raise RigError(f"scan.{error}") from None
    except Exception as error:  # planners of others may raise anything
        raise RigError(f"scan.planner = {name!r}: {type(error).__name__}: {error}") from error
    if not isinstance(planner, Planner):
        raise RigError(f"scan.planner = {name!r}: it made {planner!r:.60}, which has no ask")
    return planner
