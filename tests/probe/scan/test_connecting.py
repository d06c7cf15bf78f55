"""A scan that ends before its first move: the tip may stand in the tissue since an earlier one."""

from typing import Any

import pytest
from springs import Bed, Ran, SpringSensor, SpringStage, on_springs, run_springs

from drivers import DeviceFault, SimulatedClock
from probe.core.events import Event, Finish, Phase, PhaseEntered
from probe.guards.commands import Control

DEEP, HIGH = (0.0, 0.0, -2.5e-3), (0.0, 0.0, 5e-3)


class Locked(SpringStage):
    """Does not become ready."""

    def enable(self) -> list[str]:
        raise DeviceFault(self.name, "alarm lock")


def ended_early(stage: SpringStage, *words: str, sensor: SpringSensor | None = None) -> Ran:
    """``words`` of the user while the scan connects."""
    control = Control()

    def ask(event: Event) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.CONNECTING:
            for word in words:
                getattr(control, word)()

    sensors = [sensor or SpringSensor(stage.bed)]
    ran = run_springs(stage.bed, stage, sensors, control=control, sink=ask)
    assert ran.raised is None
    return ran


@pytest.mark.parametrize("clock", [None, SimulatedClock()])
def test_an_abort_lifts_a_tip_that_stands_in_the_tissue(clock: Any) -> None:
    bed, stage, _ = on_springs(clock, home=DEEP)
    ran = ended_early(stage, "abort")
    assert ran.finish is Finish.ABORTED
    assert bed.tip.point(bed.clock.now()) == pytest.approx((0.0, 0.0, 2e-3))


def test_an_abort_moves_no_tip_that_is_up() -> None:
    _, stage, _ = on_springs(home=HIGH)
    ran = ended_early(stage, "abort")
    assert ran.reason == "aborted by the user"
    assert "move" not in {what for _, what in stage.orders}
    assert not [text for text in ran.notes if "not lifted" in text]


def test_a_stop_moves_nothing_and_says_so() -> None:
    _, stage, _ = on_springs(home=DEEP)
    ran = ended_early(stage, "abort", "stop")
    assert ran.reason == "stopped by the user"
    assert "move" not in {what for _, what in stage.orders}
    assert "the probe was not lifted, as asked; it may still press" in ran.notes


@pytest.mark.parametrize(
    ("home", "said"), [(DEEP, "it stands at 0.00, 0.00, -2.50 mm"), (HIGH, None)]
)
def test_a_stage_that_is_not_ready_is_not_moved(
    home: tuple[float, float, float], said: str | None
) -> None:
    stage = Locked(Bed(SimulatedClock(), home=home))
    ran = ended_early(stage)
    assert "alarm lock" in ran.reason
    assert "move" not in {what for _, what in stage.orders}
    noted = [text for text in ran.notes if "the probe was not lifted" in text]
    assert [said in text for text in noted] == ([] if said is None else [True])


def test_where_a_stage_without_a_pose_stands_is_not_known() -> None:
    class Mute(Locked):
        def pose(self) -> Any:
            raise DeviceFault(self.name, "does not answer")

    ran = ended_early(Mute(Bed(SimulatedClock())), "abort")
    (noted,) = [text for text in ran.notes if "the probe was not lifted" in text]
    assert "where it stands is not known" in noted


@pytest.mark.parametrize(
    ("home", "said"), [(DEEP, "it stands at 0.00, 0.00, -2.50 mm"), (HIGH, None)]
)
def test_a_mistake_before_the_guards_begin_blames_no_stage(
    home: tuple[float, float, float], said: str | None
) -> None:
    """Nothing has moved, and there is nobody yet to lift the probe: no use in waiting for it."""

    class Mistaken(SpringSensor):
        def connect(self) -> None:
            raise ValueError("no such mode")

    bed, stage, _ = on_springs(home=home)
    ran = run_springs(bed, stage, [Mistaken(bed)])
    assert isinstance(ran.raised, ValueError)
    assert "move" not in {what for _, what in stage.orders}
    noted = [text for text in ran.notes if "not lifted" in text.lower()]
    assert [said in text for text in noted] == ([] if said is None else [True])


def test_a_pause_while_the_scan_connects_is_a_pause() -> None:
    bed, stage, sensor = on_springs(home=DEEP)
    control = Control()
    control.pause(now=True)

    def go_on(event: Event) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.PAUSED:
            control.resume()

    ran = run_springs(bed, stage, [sensor], control=control, sink=go_on)
    assert ran.reason == "every station is complete"
