"""With and without what was compiled."""

import pytest

from sim_backend.fem import kernel


@pytest.fixture(params=["kernel", "numpy"])
def with_and_without_kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """A test runs twice: with what was compiled, and with what stands in for it."""
    if request.param == "numpy":
        monkeypatch.setattr(kernel, "BUILT", False)
    elif not kernel.BUILT:
        pytest.skip("the kernel was not built: no compiler, or no headers of Python")
    return str(request.param)
