"""Lives are what they were when they were recorded."""

import numpy as np
import pytest

from tests.physics import golden

COMMITTED = golden.committed()


def deviations(arrays):
    """How far arrays are from the committed ones, in what is allowed of their scale; actions are exact."""
    found = {}
    for name, array in arrays.items():
        single, wanted = "32/" in name, golden.reference(name)
        if wanted is None or (single and name.startswith("paper")):  # where concentrations are large
            continue
        expected = COMMITTED[wanted]
        allowed = (1e-5 if single or array.dtype == np.float32 else 1e-12) * np.abs(expected).max()
        found[name] = np.abs(golden.reduced(array) - expected).max() / max(allowed, 1e-300)
    return found


@pytest.mark.parametrize("case", golden.CASES)
def test_lives_are_what_they_were(case):
    found = deviations(golden.computed([case]))
    assert {name: much for name, much in found.items() if not much <= 1} == {}
    assert set(map(golden.reference, found)) == {name for name in COMMITTED if name.startswith(f"{case}/")}


def test_every_case_is_committed_in_little_space():
    assert {name.split("/")[0] for name in COMMITTED} == set(golden.CASES)
    assert golden.FILE.stat().st_size <= 200_000


def test_a_hundred_billionth_of_the_speed_is_seen(monkeypatch):
    monkeypatch.setitem(
        golden.WORLDS, "flow_vortex", {"flow": "vortex", "sense_flow": True, "speed": 1 + 1e-11}
    )
    assert deviations(golden.computed(["flow_vortex"]))["flow_vortex/random/numpy64/gain"] > 2
