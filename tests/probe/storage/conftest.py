"""A finished scan of two stations beside an artery, only to be read."""

from pathlib import Path
from typing import Any

import pytest

from probe.config.rig import Rig
from probe.scan.session import scan


@pytest.fixture(scope="session")
def path(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> Path:
    rig = Rig.model_validate({"scan": {"start_mm": 28, "stations": 2}})
    return scan(rig, "TIHA", tmp_path_factory.mktemp("runs"), seed=4, respond=winkler).path
