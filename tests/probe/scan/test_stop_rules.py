"""What ends a scan early, rule by rule, and which of two goes first."""

from pathlib import Path

import pytest
from springs import on_springs, run_springs

import palpate
from probe.config.rig import Rig
from probe.core.events import Event, Finish, Phase, PhaseEntered
from probe.guards.commands import Control, RunCommand
from probe.guards.interruption import Trip
from probe.scan.stop_rules import Seen, interrupted, no_contact

GO_ON = Seen(RunCommand.RESUME, None, None, Phase.HOLDING)
TRIP = Trip(1.0, "cell", "force 6 N; the limit is 5 N", can_retract=False)


def test_nothing_wrong_is_no_reason_to_stop() -> None:
    assert interrupted(GO_ON) is None


@pytest.mark.parametrize(
    ("seen", "finish", "device", "lifts"),
    [
        (Seen(RunCommand.STOP, TRIP, None, Phase.HOLDING), Finish.ABORTED, "user", False),
        (Seen(RunCommand.ABORT, TRIP, "full", Phase.HOLDING),
         Finish.FAULTED, "cell", False),
        (Seen(RunCommand.ABORT, None, "full", Phase.HOLDING),
         Finish.FAULTED, "store", True),
        (Seen(RunCommand.ABORT, None, None, Phase.PAUSED), Finish.ABORTED, "user", True),
        (Seen(RunCommand.PAUSE_NOW, None, None, Phase.HOLDING), None, "user", True),
    ],
    ids=["a stop before a trip", "a trip before a full disk", "a full disk before an abort",
         "an abort in a pause", "a pause"],
)  # fmt: skip
def test_the_first_rule_decides(
    seen: Seen, finish: Finish | None, device: str, lifts: bool
) -> None:
    why = interrupted(seen)
    assert why is not None
    assert (why.finish, why.device, why.retract) == (finish, device, lifts)


def test_a_pause_is_not_begun_twice() -> None:
    assert interrupted(Seen(RunCommand.PAUSE_NOW, None, None, Phase.PAUSED)) is None


@pytest.mark.parametrize(("felt_n", "met"), [(0.0, False), (0.5, True)])
def test_contact_is_more_force_than_noise(felt_n: float, met: bool) -> None:
    """How much more: `tests/probe/guards/test_way_out.py`."""
    why = no_contact({"cell": (felt_n, 0.01)}, {"cell": 100.0}, 5.0, 2.5e-3)
    assert (why is None) == met
    if why is not None:
        assert why.finish is Finish.FAULTED
        assert "2.5 mm deep" in why.reason


def test_a_sensor_slower_than_a_level_is_waited_for(tmp_path: Path) -> None:
    """Five readings a second: the tenth of a second of a level has one or none."""
    slow = {
        "scan": {
            "start_mm": 32.0,
            "stations": 1,
            "hold_s": 3.0,
            "approach_mm_s": 1.0,
            "ramp_s": 2.5,
        },
        "safety": {"late_s": 2.0, "silence_s": 2.0, "hardest_n_mm": 1.0},
        "sensor": [{"driver": "virtual", "rate_hz": 5.0}],
        "scene": {"name": "TI"},
    }
    found = palpate.scan(Rig.model_validate(slow), out=tmp_path, seed=1)
    assert palpate.open_run(found.path).finish is Finish.COMPLETED


def test_a_pause_before_the_probe_went_down_ends_no_scan() -> None:
    """There is nothing to lift then, and the press is made when the scan goes on."""
    bed, stage, sensor = on_springs()
    control, paused = Control(), list[Event]()

    def ask(event: Event) -> None:
        entered = event.phase if isinstance(event, PhaseEntered) else None
        if entered is Phase.TARING and not paused:
            paused.append(event)
            control.pause(now=True)
        elif entered is Phase.PAUSED:
            control.resume()

    ran = run_springs(bed, stage, [sensor], sink=ask, control=control)
    assert ran.raised is None
    assert ran.finish is Finish.COMPLETED, ran.reason
