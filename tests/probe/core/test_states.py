import runpy

import pytest
from paths import ROOT

from probe.core.events import Phase
from probe.core.states import ALLOWED, follow


def test_the_drawing_and_the_table_in_the_docs_are_the_codes() -> None:
    drawing = runpy.run_path(str(ROOT / "docs" / "pictures" / "states.py"))["drawing"]()
    stored = ROOT / "docs" / "pictures" / "states.svg"
    assert stored.read_text(encoding="utf-8") == drawing
    to_stopping = sum(Phase.STOPPING in after for after in ALLOWED.values())  # drawn as one
    arrows = sum(map(len, ALLOWED.values())) - to_stopping + 1
    assert drawing.count('<path d="M') == arrows + 1  # the arrows' tip
    page = (ROOT / "docs" / "reference" / "states.md").read_text(encoding="utf-8")
    for phase, after in ALLOWED.items():
        assert f"| {phase.value} | {', '.join(one.value for one in after) or 'nothing'} |" in page


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
