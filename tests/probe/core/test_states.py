import pytest
from paths import ROOT

from probe.core.events import Phase
from probe.core.states import ALLOWED, diagram, follow


def test_the_drawing_in_the_docs_is_the_codes() -> None:
    drawn = ROOT / "docs" / "reference" / "states.md"
    assert diagram() in drawn.read_text(encoding="utf-8")


def test_every_phase_can_be_reached_and_can_finish() -> None:
    assert set(ALLOWED) == set(Phase)
    reached = {Phase.IDLE}
    for _ in Phase:
        reached |= {then for now in reached for then in ALLOWED[now]}
    assert reached == set(Phase)
    for phase in set(Phase) - {Phase.IDLE, Phase.FINISHED, Phase.STOPPING}:
        assert Phase.STOPPING in ALLOWED[phase]
    assert Phase.FINISHED in ALLOWED[Phase.STOPPING]


def test_a_wrong_step_is_refused() -> None:
    assert follow(Phase.INDENTING, Phase.HOLDING) is Phase.HOLDING
    with pytest.raises(RuntimeError, match="indenting cannot follow travelling"):
        follow(Phase.TRAVELLING, Phase.INDENTING)
