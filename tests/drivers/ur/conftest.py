"""An emulated arm, connected."""

from collections.abc import Iterator

import pytest
from emulated_ur import Arm, connected

from sim_backend.phantom.phantom import Respond


@pytest.fixture
def arm(winkler: Respond, request: pytest.FixtureRequest) -> Iterator[Arm]:
    """Under control, unless `emulated_ur.arm_with` says otherwise."""
    how = {"enable": True} | getattr(request, "param", {})
    enable = how.pop("enable")
    with connected(winkler, **how) as made:
        if enable:
            made.stage.enable()
        yield made
