"""The contract of planners finds what is wrong with one, and nothing with those that are right."""

import math
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from probe.config.rig import Rig
from probe.config.scan_plan import plan_for
from probe.core.recording import Recording
from probe.deciding.coarse_to_fine import CoarseToFine
from probe.planning.contract import check_planner
from probe.planning.plan import Place, Plan
from probe.planning.planner import Done, Press, Raster, whole_press
from probe.scan.session import scan
from probe.storage.run import open_run

RIG = Rig.model_validate(
    {"scan": {"hold_s": 5.0, "stations": 15}, "sensor": [{"driver": "virtual", "rate_hz": 100}]}
)
PLAN = plan_for(RIG)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> Recording:
    out: Path = tmp_path_factory.mktemp("runs")
    return open_run(scan(RIG, "TIT", out, respond=winkler)).recording()


@pytest.mark.parametrize(("make", "presses"), [(Raster, 15), (CoarseToFine, 11)])
def test_those_that_come_along_keep_it(make: Any, presses: int, recording: Recording) -> None:
    assert len(check_planner(make, PLAN, recording)) == presses


class Wrong:
    """A raster with one mistake."""

    _made = count()

    def __init__(self, plan: Plan, **mistake: Any) -> None:
        self.plan, self.mistake, self.left = plan, mistake, list(plan.places)
        if mistake.get("random") and next(self._made) % 2:
            self.left.reverse()

    def ask(self) -> Any:
        if len(self.left) == 10 and "instead" in self.mistake:
            return self.mistake["instead"]
        if not self.left:
            return Done(self.mistake.get("reason", "all are pressed"))
        place = self.left[0] if self.mistake.get("stays") else self.left.pop(0)
        return replace(whole_press(self.plan, place), **self.mistake.get("press", {}))


@pytest.mark.parametrize("mistake, said", [
    ({"instead": None}, "not for Press or Done"),
    ({"press": {"depth_m": 3e-3}}, "depth_m = 0.003"),
    ({"press": {"holds_s": (1.0, math.inf)}}, "holds_s"),
    ({"press": {"place": Place(3, 0.5, 0.0)}}, "none of the plan's stations"),
    ({"stays": True}, "nothing but stations that are complete"),
    ({"random": True}, "chooses otherwise"),
    ({"reason": ""}, "needs a reason"),
])  # fmt: skip
def test_a_mistake_is_named(mistake: dict[str, Any], said: str, recording: Recording) -> None:
    with pytest.raises(AssertionError, match=said):
        check_planner(lambda plan: Wrong(plan, **mistake), PLAN, recording)


def test_one_that_loses_itself_in_a_resumed_scan_is_noticed(recording: Recording) -> None:
    class Forgetful(Wrong):
        """Counts what it is told of as if it had asked for it."""

        def tell(self, reading: Recording) -> None:
            self.asked.remove(reading.stations[0].index)

        def ask(self) -> Any:
            choice = super().ask()
            if isinstance(choice, Press):
                self.asked = [choice.place.index]
            return choice

    with pytest.raises(AttributeError, match="asked"):
        check_planner(Forgetful, PLAN, recording)
