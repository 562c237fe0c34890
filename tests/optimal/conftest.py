import pytest

from swarm.optimal import physical_limit, store


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv(store.CACHE, str(tmp_path / "cache"))


@pytest.fixture
def coarse(monkeypatch):
    """Grids and spheres that are computed in a moment."""
    monkeypatch.setattr(physical_limit, "GRIDS", ((16, 24), (20, 24), (28, 32)))
    monkeypatch.setattr(physical_limit, "POLICY_GRID", (28, 32))
    monkeypatch.setattr(physical_limit, "SPHERES", (12, 16, 32))
    monkeypatch.setattr(physical_limit, "POLICY_SPHERE", 24)
