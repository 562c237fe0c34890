"""BenchMARL: the example's task and independent Q-learning, for two iterations."""

import math
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))

import benchmarl_task

from swarm.envs.torchrl import SwarmEnv

CELLS, LIFE = 4, 8.0


def steps():
    decisions = SwarmEnv(2, n_swimmers=CELLS, life=LIFE).rollout(20).shape[-1]
    return f"{decisions} decisions of 2 × {CELLS} cells"


def trains():
    with tempfile.TemporaryDirectory() as folder:
        gain = benchmarl_task.main(iterations=2, cells=CELLS, life=LIFE, folder=folder)
    assert math.isfinite(gain), "no life was told of"
    return f"IQL, 2 lives of {CELLS} cells"
