"""What an object is called: the three kinds against something else and against nothing."""

import numpy as np
import pytest

from drivers.core.arrays import Array
from probe.detection.classify.kinds import (
    ELSE,
    SIZES,
    Seen,
    against_nothing,
    judge,
    posterior,
)

NO_PULSE = np.exp(-0.5 * (SIZES / 3e-4) ** 2)
"""Of a sensor that would have seen pulses of a thousandth of the force."""


def beats(contrast: float, pulse: float) -> Seen:
    return Seen(pulse, 0.02 * pulse, contrast, 0.02, chance=1e-9, moving=0.999)


def still(contrast: float, chance: float = 1e-9, hidden: Array = NO_PULSE) -> Seen:
    return Seen(0.0, 0.0, contrast, 0.02, chance=chance, moving=0.0, hidden=hidden)


def test_what_no_kind_is_like_is_something_else() -> None:
    """A peak four times its surroundings that beats: no solved vessel or lump has both."""
    strange = Seen(0.5, 0.01, 2.8, 0.02)
    assert posterior(strange)[0][ELSE] > 0.5
    assert judge(strange).kind == "undecided"


@pytest.mark.parametrize("contrast", [-0.99, -0.5, 6.0])
@pytest.mark.parametrize("pulse", [0.03, 2.0])
def test_a_contrast_beyond_all_kinds_is_no_kind_s(contrast: float, pulse: float) -> None:
    """The kind of which least is left there took all: of an artery whose zero was off."""
    assert posterior(beats(contrast, pulse))[0][ELSE] > 0.99


@pytest.mark.parametrize("chance", [1e-6, 1e-3, 0.02, 0.3])
def test_a_bump_that_chance_could_make_may_be_nothing(chance: float) -> None:
    share = posterior(still(0.25, chance))[0]
    assert sum(share.values()) == pytest.approx(1.0)
    # e p ln p against one (Sellke, Bayarri & Berger 2001)
    odds = -np.e * chance * np.log(chance)
    assert share["nothing"] == pytest.approx(odds / (1 + odds))


def test_no_chance_speaks_for_something_more_than_one() -> None:
    assert against_nothing(1.0) == against_nothing(np.exp(-1.0)) == pytest.approx(1.0)


def test_a_lump_is_named_and_a_pulse_takes_the_name_away() -> None:
    assert judge(still(0.25)).kind == "tumour"
    assert judge(beats(0.25, 0.03)).kind != "tumour"


@pytest.mark.parametrize("contrast", [0.25, 60.0])
def test_a_sensor_that_any_pulse_would_show_to_still_finds_the_lump_that_has_none(
    contrast: float,
) -> None:
    share = posterior(still(contrast, hidden=np.zeros_like(SIZES)))[0]
    assert sum(share.values()) == pytest.approx(1.0)
    assert max(share, key=lambda kind: share[kind]) == ("tumour" if contrast < 1 else ELSE)
