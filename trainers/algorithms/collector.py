"""Collecting: what TorchRL's Collector does, for worlds that are shared out among seeds."""

from typing import Any

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from swarm._support import streams
from swarm.envs.torchrl import SwarmEnv
from trainers.settings.schema import Settings

BLOCK = 64  # decisions whose random numbers are drawn at once
UNIFORM = 2  # random numbers of a cell for each of its decisions


def training_env(settings: Settings, n_worlds: int, n_swimmers: int, **options: Any) -> SwarmEnv:
    """So many worlds of each seed, with so many cells each, where and on so many threads as settings say."""
    torch.set_num_threads(settings.threads)
    # TorchRL moves what it is given where the processor is named.
    device = None if settings.device == "cpu" else settings.device
    shared: dict[str, Any] = {"seeds": settings.seeds, "world": settings.training_world(), **options}
    return SwarmEnv(n_worlds * len(settings.seeds), device, n_swimmers=n_swimmers, **shared)


class SeedCollector:
    """Steers every cell of a `SwarmEnv` by a policy, and hands over what happened.

    TorchRL's Collector costs several times the decision itself for worlds this cheap
    (`benchmarks/training_path.py`), and knows of no seeds. The policy reads `observation`
    (seeds, cells, inputs), `uniform` (seeds, cells, 2), numbers in [0, 1) that are each cell's own, and where
    `poses` is one of its `in_keys`, those; it writes its `out_keys`, among them `action` (seeds, cells).
    What it remembers of each cell is its `hidden` (seeds, cells, ...).
    `cells` are those of one seed; `block` is the number of the part of them that is collected here.
    """

    def __init__(self, env: SwarmEnv, policy: TensorDictModuleBase, block: int = 0) -> None:
        self.env, self.policy, self.block = env, policy, block
        self._uniform_numbers: Tensor | None = None  # of `BLOCK` decisions
        self.cells = env.n_worlds // len(env.seeds) * env.n_swimmers
        self._shape = (len(env.seeds), self.cells)

    @torch.no_grad()
    def collect(self, decisions: int) -> TensorDict:
        """Up to `decisions` decisions of every cell, fewer where all lives end: (decisions, seeds, cells).

        In TorchRL's keys; `mask` of `collector` says which cells were alive.
        """
        env, results = self.env, []
        written: dict[str, list[Tensor]] = {name: [] for name in self.policy.out_keys}
        assert env.observation is not None, "env.restart() must come first"
        observations = [env.observation]
        for _ in range(decisions):
            seen = {"observation": self._by_seed(observations[-1]), "uniform": self._uniform()}
            if "poses" in self.policy.in_keys:
                seen["poses"] = self.poses()
            step = self.policy(TensorDict(seen, self._shape))
            observation, *result = env.advance(step["action"].reshape(env.n_worlds, -1))
            observations.append(observation)
            results.append(result)
            for name, values in written.items():
                values.append(step[name])
            if env.all_finished():
                break
        reward, terminated, truncated, alive = map(torch.stack, zip(*results, strict=True))
        shape = (len(results), *self._shape)
        observation = torch.stack(observations).reshape(len(observations), *self._shape, -1)
        following = {
            "observation": observation[1:],
            "reward": reward.reshape(*shape, 1).float(),
            "terminated": terminated.reshape(*shape, 1),
            "done": (terminated | truncated | ~alive).reshape(*shape, 1),
        }
        taken = {name: torch.stack(values) for name, values in written.items()}
        whole = {"observation": observation[:-1], **taken, "next": following}
        return TensorDict({**whole, "collector": {"mask": alive.reshape(shape)}}, shape)

    def poses(self) -> Tensor:
        """Position [length], heading (unit vector) and κ* of all cells (seeds, cells, 5) as they are now; in
        space (seeds, cells, 8), see `State`.
        """
        state = self.env.state
        assert state is not None, "env.restart() must come first"
        return self._by_seed(torch.cat([state.position, state.heading, state.memory[..., 0, 1:2]], dim=-1))

    def _by_seed(self, values: Tensor) -> Tensor:
        """(worlds, cells of a world, ...) -> (seeds, cells of a seed, ...)."""
        return values.reshape(*self._shape, *values.shape[2:])

    def _uniform(self) -> Tensor:
        """Numbers (seeds, cells, 2) for this decision, named by seed, episode, decision and part; drawn for
        `BLOCK` decisions at once.
        """
        block, place = divmod(int(self.env.decision[0]), BLOCK)
        if place == 0 or self._uniform_numbers is None:
            part = (0, self.block) if self.block else ()
            device, episode = self.env.device or torch.device("cpu"), int(self.env.episode[0])
            draws = []
            for seed in self.env.seeds:
                key = streams.integer_seed("training", "exploration", seed, episode, block, *part)
                generator = torch.Generator(device).manual_seed(key)
                draws.append(torch.rand(UNIFORM, BLOCK, self.cells, generator=generator, device=device))
            # (decisions, seeds, cells, numbers)
            self._uniform_numbers = torch.stack(draws).permute(2, 0, 3, 1)
        return self._uniform_numbers[place]
