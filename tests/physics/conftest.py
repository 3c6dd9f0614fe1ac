"""Fixtures shared by the physics tests."""

import pytest

from radartwin.simulation import variant


@pytest.fixture(params=["compiled loops", "Dr.Jit"])
def spreading(request, monkeypatch):
    """Spread paths by the compiled loops of the CPU, and by the Dr.Jit program of the GPU, which also runs on the CPU."""
    variant.activate()
    monkeypatch.setattr(variant, "on_gpu", lambda: request.param == "Dr.Jit")
