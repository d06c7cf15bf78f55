"""Every mutant breaks a line that is there, and is asked of tests that are there."""

import pytest
from mutants.catalogue import MUTANTS
from mutants.mutant import Mutant
from paths import ROOT


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_mutant_and_its_witnesses_are_in_the_source(mutant: Mutant) -> None:
    assert mutant.mutated(ROOT)
    assert mutant.tests or mutant.runs
    for witness in mutant.tests:
        file, _, test = witness.partition("::")
        assert (ROOT / file).exists(), file
        assert f"def {test.partition('[')[0]}(" in (ROOT / file).read_text("utf-8") or not test
