"""Evolution strategies: they learn, go on where they were, and leave the global generators alone."""

import dataclasses

import numpy as np
import pytest
import torch

from trainers.settings.composition import settings_from
from trainers.training import checkpoint
from trainers.training.checkpoint import CheckpointError
from trainers.training.loop import Training

pytest.importorskip("cma")

SHORT = (
    "algorithm=evolution",
    "tensorboard=false",
    "validation={cells: 10, life: 20.0, every: 2}",
    "world.life=20.0",
)
SMALL = (*SHORT, "learning={n_swimmers: 6, n_worlds: 8, epochs: 8, hidden: [], collect: 60}", "compile=never")


def trained(training, epochs):
    while training.epoch < epochs:
        training.run_epoch()
    return training


def test_a_network_without_nodes_comes_close_to_the_limit_by_the_worth_of_its_second_action_alone():
    made = trained(Training(settings_from(SMALL)), 8)
    assert made.best_gain[0] > 0.85 * 2.9
    (network,) = made.policies()
    assert not network.weights[-1][0].any()
    assert network.weights[-1][1].any()


@pytest.mark.parametrize("hidden", [[], [2], [3, 2]])
def test_a_search_that_is_stopped_goes_on_bit_for_bit_and_alone_as_in_a_stack(hidden):
    words = [*SMALL, f"learning.hidden={hidden}", "n_seeds=2", "learning.epochs=3", "world.life=8.0"]
    settings = settings_from(words)
    whole, stopped, later = Training(settings), Training(settings), Training(settings)
    state = np.random.get_state()[1].tolist(), torch.random.get_rng_state().tolist()  # noqa: NPY002
    trained(whole, 3)
    trained(stopped, 2)
    checkpoint.restore(later, checkpoint.tensors_of(stopped), checkpoint.record_of(stopped))
    trained(later, 3)
    np.testing.assert_array_equal(later.measures, whole.measures)
    for name, tensor in whole.algorithm.tensors().items():
        assert torch.equal(later.algorithm.tensors()[name], tensor), name
    alone = trained(Training(dataclasses.replace(settings, seed=1, n_seeds=1)), 3)
    np.testing.assert_allclose(alone.measures[:, 0], whole.measures[:, 1])
    assert (np.random.get_state()[1].tolist(), torch.random.get_rng_state().tolist()) == state  # noqa: NPY002


def test_each_candidate_lives_in_its_world_whatever_the_blocks():
    words = (*SHORT, "learning={n_swimmers: 2, n_worlds: 5, hidden: [2]}", "n_seeds=2", "world.life=8.0")
    one, other = (
        trained(Training(settings_from([*words, f"learning.block={size}"])), 1).algorithm.fitness
        for size in (0, 4)
    )
    torch.testing.assert_close(other, one, rtol=1e-5, atol=1e-5)


def test_a_checkpoint_with_a_fitness_that_is_no_number_is_refused():
    settings = settings_from(SMALL)
    stopped = trained(Training(settings), 1)
    held, record = checkpoint.tensors_of(stopped), checkpoint.record_of(stopped)
    held["fitness"][0, 0, 0] = np.nan
    with pytest.raises(CheckpointError, match="fitness must be finite"):
        checkpoint.restore(Training(settings), held, record)
