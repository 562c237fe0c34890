"""The page on own fields and flows does what it says."""

import re
import shlex
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from trainers.settings.composition import settings_from

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "own_field.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_every_block_of_the_page_runs(tmp_path, monkeypatch, capsys):
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in BLOCKS:
        exec(compile(block, str(PAGE), "exec"), names)
    command = re.search(
        r"```shell\n(swarm train .*?)\nswarm evaluate", PAGE.read_text(encoding="utf-8"), re.S
    )
    words = shlex.split(command[1].replace("\\\n", ""))
    made = settings_from([word for word in words[2:] if not word.startswith("hydra.")])
    assert made.world["field"]["shape"] == made.world["flow"]["shape"] == [81, 41]
    assert (tmp_path / "my_field.png").stat().st_size > 10_000
    shown = capsys.readouterr().out
    assert "GriddedField(81 × 41 points" in shown
    assert "dqn" in shown
    gains = names["results"]["gain"].sel(policy="greedy").values
    assert np.all(np.isfinite(gains))
    assert gains.mean() > 1.0  # the greedy strategy climbs this plume
    assert len(names["observations"]) == 3


def test_the_way_from_a_file_to_a_figure_takes_at_most_forty_lines():
    to_the_figure = [line for block in BLOCKS[:3] for line in block.splitlines() if line.strip()]
    assert len(to_the_figure) <= 40


@pytest.mark.parametrize("name", ["ripples", "saddle"])
def test_functions_of_the_page_run_on_every_library(xp, name):
    names = {}
    exec(BLOCKS[3].split("world =")[0], names)
    values = names[name](xp.ones((4, 2), dtype=xp.float32))
    assert values.shape[0] == 4
    assert values.dtype == xp.float32
