"""RLlib: the example's PPO, for one iteration."""

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))

import rllib_ppo

CELLS, LIFE, DECISIONS = 3, 8.0, 200


def steps():
    env, count, ended = rllib_ppo.make_env({"n_swimmers": CELLS, "life": LIFE}), 0, False
    seen, _ = env.reset(seed=0)
    while not ended:
        seen, _, terminated, truncated, _ = env.step(dict.fromkeys(seen, 1))
        ended, count = terminated["__all__"] or truncated["__all__"], count + 1
    return f"a life of {count} decisions in its wrapper"


def trains():
    gain = rllib_ppo.main(iterations=1, cells=CELLS, life=LIFE, decisions=DECISIONS)
    assert math.isfinite(gain), "no life was told of"
    return f"PPO, {DECISIONS} decisions of {CELLS} cells"
