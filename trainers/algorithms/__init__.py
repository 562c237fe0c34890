"""Ways to learn: what the training loop needs of one (`base`), and those there are."""

from trainers.algorithms.base import Algorithm
from trainers.algorithms.dqn import DQN
from trainers.algorithms.ppo import PPO

ALGORITHMS: dict[str, type[Algorithm]] = {"dqn": DQN, "ppo": PPO}
