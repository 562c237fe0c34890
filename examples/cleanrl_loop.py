"""Deep Q-learning in one loop that reads top to bottom, as CleanRL has it, over the PettingZoo environment.

pip install torch
python examples/cleanrl_loop.py
"""

import copy

import numpy as np
import torch
from torch import nn

import swarm


def main(episodes: int = 20, cells: int = 40, life: float = 80.0, seed: int = 0) -> list[float]:
    """Trains one network that all cells share; returns the mean gain of every episode."""
    torch.manual_seed(seed)
    chance = np.random.default_rng(seed)
    env = swarm.parallel_env(cells, life=life)
    size, actions = env.observation_space("swimmer_0").shape[0], env.action_space("swimmer_0").n
    hidden = [nn.Linear(size, 24), nn.Tanh(), nn.Linear(24, 24), nn.Tanh(), nn.Linear(24, 24), nn.Tanh()]
    network = nn.Sequential(*hidden, nn.Linear(24, actions))
    target = copy.deepcopy(network)
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    memory, gains, decisions = [], [], 0

    for episode in range(episodes):
        epsilon = max(0.05, 1 - episode / (0.5 * episodes))
        optimizer.param_groups[0]["lr"] = 3e-3 * (1 - episode / episodes)
        observations, infos = env.reset(seed=seed if episode == 0 else None)
        while env.agents:
            agents = env.agents
            before = np.stack([observations[agent] for agent in agents])
            with torch.no_grad():
                best = network(torch.as_tensor(before)).argmax(-1).numpy()
            explores = chance.random(len(agents)) < epsilon
            chosen = np.where(explores, chance.integers(actions, size=len(agents)), best)
            observations, rewards, terminated, _, infos = env.step(dict(zip(agents, chosen, strict=True)))
            after = np.stack([observations[agent] for agent in agents])
            reward = [rewards[agent] for agent in agents]
            ended = [terminated[agent] for agent in agents]  # not: out of time, which has a future
            memory += zip(before, chosen, reward, after, ended, strict=True)
            decisions += 1

            if decisions % 4 == 0:
                picked = [memory[i] for i in chance.integers(len(memory), size=512)]
                columns = (np.array(column) for column in zip(*picked, strict=True))
                seen, taken, gained, then, last = map(torch.as_tensor, columns)
                with torch.no_grad():
                    choice = network(then).argmax(-1, keepdim=True)  # double DQN
                    future = target(then).gather(-1, choice)[:, 0]
                wanted = gained.float() + 0.98 * torch.where(last, 0.0, future)
                value = network(seen).gather(-1, taken[:, None])[:, 0]
                optimizer.zero_grad()
                nn.functional.smooth_l1_loss(value, wanted).backward()
                optimizer.step()
            if decisions % 200 == 0:
                target.load_state_dict(network.state_dict())
        gains.append(float(np.mean([info["gain"] for info in infos.values()])))
        print(f"episode {episode + 1}: ε {epsilon:.2f}, mean gain {gains[-1]:.2f}")
    return gains


if __name__ == "__main__":
    main()
