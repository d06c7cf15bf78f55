"""One small table for all tests of models: training takes seconds."""

import pytest
from small_block import BLOCK

from sim_backend.models import kept_tables, trained_states
from sim_backend.models.surrogate import Surrogate, surrogate

DEEPEST_MM = 1.0


@pytest.fixture(scope="session")
def small_surrogate(tmp_path_factory: pytest.TempPathFactory) -> Surrogate:
    """Of a narrow block: few places."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            kept_tables.platformdirs, "user_cache_dir", lambda *_: tmp_path_factory.mktemp("c")
        )
        patch.setattr(trained_states, "VALIDATION_STATES", 4)
        return surrogate(BLOCK, DEEPEST_MM)
