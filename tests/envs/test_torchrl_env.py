"""The TorchRL face: TorchRL's own checks, and the same lives as the PettingZoo face."""

import functools
import random
import warnings

import numpy as np
import pytest
import torch
from torchrl.envs import (
    CatFrames,
    EnvCreator,
    ParallelEnv,
    SerialEnv,
    TimeMaxPool,
    TransformedEnv,
    check_env_specs,
)

from swarm import World, parallel_env
from swarm.envs.torchrl import SwarmEnv
from swarm.envs.torchrl import worlds as torchrl_env

GROUP = "swimmers"
NOISE = {"concentration_noise": 0.1, "curvature_noise": 0.1, "rotational_diffusion": 0.01}
VORTICES = {"flow": "taylor_green"}
NEAR_EGG = {"field": "radial", "start_box": ((-2.5, 2.5), (-2.5, 2.5))}


@pytest.fixture(params=["numpy", "torch"], autouse=True)
def library(request, monkeypatch):
    """What computes the decisions of few cells."""
    if request.param == "torch":
        monkeypatch.setattr(torchrl_env, "NUMPY_CELLS", 0)


def environment(n_worlds=2, n_swimmers=3, life=6.0, seed=0, **parameters):
    own = {} if "seeds" in parameters else {"seed": seed}
    return SwarmEnv(n_worlds, n_swimmers=n_swimmers, life=life, **own, **parameters)


def with_action(env, data, action):
    data[GROUP, "action"] = torch.as_tensor(action).reshape(env.n_worlds, env.n_swimmers)
    return data


def random_actions(env, seed=0):
    """Endless actions (worlds, cells)."""
    generator = np.random.default_rng(seed)
    while True:
        yield generator.integers(env.world.n_actions, size=(env.n_worlds, env.n_swimmers))


@pytest.mark.conformance
@pytest.mark.parametrize("n_worlds", [1, 5])
def test_torchrl_finds_the_specs_kept_with_one_world_and_many(n_worlds):
    check_env_specs(environment(n_worlds, max_cycles=4, dtype="float64"), seed=1)


def test_a_cell_that_is_done_waits_masked_until_its_world_is_done():
    env = environment(2, 8, life=8.0, **NEAR_EGG)
    data = env.reset()
    waited = False
    actions = random_actions(env)
    while not data["done"].any():
        before = data.clone()
        data = env.step(with_action(env, data, next(actions)))["next"]
        was_done = before[GROUP, "done"]
        waited |= bool((was_done & ~before["done"][:, None]).any())
        assert not data[GROUP, "reward"][was_done].any()
        for flag in ("done", "terminated", "truncated"):
            assert data[GROUP, flag][was_done].tolist() == before[GROUP, flag][was_done].tolist()
        assert torch.equal(data[GROUP, "gain"][was_done], before[GROUP, "gain"][was_done])
    assert waited


def test_done_is_terminated_or_truncated_and_never_both():
    env = environment(2, 6, life=8.0, **NEAR_EGG)
    data = env.rollout(60, break_when_any_done=False)["next"]
    for level in (data, data[GROUP]):
        assert torch.equal(level["done"], level["terminated"] | level["truncated"])
        assert not (level["terminated"] & level["truncated"]).any()
    assert torch.equal(data["done"], data[GROUP, "done"].all(-2))


class Far:
    """A field that is nowhere near the origin."""

    gradient_scale, box = 1.0, ((2.0, 3.0), (2.0, 3.0))

    def concentration(self, position):
        return position[..., 0]

    def inside(self, position):
        return position[..., 0] > 1.0


@pytest.mark.parametrize("parameters", [{}, NOISE, {"field": Far(), "life": 1.0}], ids=["", "noise", "far"])
def test_a_world_restarts_alone_in_the_seeds_next_episode_and_the_others_go_on(parameters):
    next_episode, undisturbed, joint = (environment(3, 2, **parameters) for _ in range(3))
    next_episode.reset()
    second, other, data = next_episode.reset(), undisturbed.reset(), joint.reset()
    data, other = (env.step(with_action(env, each, np.zeros(6, int)))["next"]
                   for env, each in ((joint, data), (undisturbed, other)))  # fmt: skip
    assert torch.equal(joint.restart(np.zeros(3, bool)), data[GROUP, "observation"])
    data = joint.reset(data.set("_reset", torch.tensor([[False], [True], [False]])))
    assert joint.episode.tolist() == [0, 1, 0]
    for action in (1, 0):
        for row, expected in enumerate((other, second, other)):
            assert torch.equal(data[GROUP, "observation"][row], expected[GROUP, "observation"][row])
        data, other, second = (
            env.step(with_action(env, each, np.full(6, action)))["next"]
            for env, each in ((joint, data), (undisturbed, other), (next_episode, second))
        )


def test_the_same_seed_gives_the_same_rollout_and_another_one_another():
    env = environment(**NOISE)
    rollouts = []
    for seed in (3, 3, 4):
        env.set_seed(seed)
        torch.manual_seed(0)  # of the random actions
        rollouts.append(env.rollout(30, break_when_any_done=False))
    early = environment(seed=3, **NOISE).reset()
    assert torch.equal(early[GROUP, "observation"], rollouts[0][GROUP, "observation"][:, 0])
    assert (rollouts[0] == rollouts[1]).all()
    assert not torch.equal(rollouts[0][GROUP, "observation"], rollouts[2][GROUP, "observation"])


def test_each_of_several_seeds_has_the_worlds_it_would_have_alone():
    stack, alone = environment(4, 2, seeds=[7, 8], **NOISE), environment(2, 2, seed=8, **NOISE)
    joint, single = stack.reset(), alone.reset()
    for action in (1, 0, 1):
        assert torch.allclose(joint[GROUP, "observation"][2:], single[GROUP, "observation"], atol=1e-5)
        joint = stack.step(with_action(stack, joint, np.full((4, 2), action)))["next"]
        single = alone.step(with_action(alone, single, np.full((2, 2), action)))["next"]


def test_without_a_seed_every_environment_lives_its_own_lives_and_says_which():
    first, second = environment(seed=None, **NOISE), environment(seed=None, **NOISE)
    one, other = first.reset(), second.reset()
    assert not torch.equal(one[GROUP, "observation"], other[GROUP, "observation"])
    twin = environment(seed=first.seeds[0], **NOISE)
    for _ in range(2):
        assert torch.equal(one[GROUP, "observation"], twin.reset()[GROUP, "observation"])
        first.set_seed(None)  # its episodes go on
        one = first.reset()
    assert "seeds" not in twin.state_dict_of_env()
    second.load_state_dict_of_env(first.state_dict_of_env())
    assert second.seeds == first.seeds
    assert torch.equal(first.restart(), second.restart())


def make_short():
    return SwarmEnv(n_swimmers=2, life=2.0)


@pytest.mark.parametrize(
    "make", [SerialEnv, pytest.param(ParallelEnv, marks=pytest.mark.slow)], ids=["serial", "parallel"]
)
def test_workers_without_a_seed_live_different_lives_and_with_one_the_same_again(make):
    env = make(2, EnvCreator(make_short) if make is ParallelEnv else make_short)
    seen = []
    try:
        for seed in (None, 4, 4):
            if seed is not None:
                env.set_seed(seed)
            seen.append(env.reset()[GROUP, "observation"].clone())
    finally:
        env.close()
    assert not torch.equal(seen[0][0], seen[0][1])
    assert not torch.equal(seen[1][0], seen[1][1])
    assert torch.equal(seen[1], seen[2])


def test_multi_agent_code_finds_what_it_reads():
    env, zoo = environment(2, 3, return_state=True), parallel_env(n_swimmers=3)
    check_env_specs(env)
    assert env.group_map == {GROUP: env.agents} == {GROUP: zoo.possible_agents}
    assert env.n_agents == 3
    assert env.max_steps == env.world.max_decisions
    assert environment(max_cycles=4).max_steps == 4


@pytest.mark.parametrize(
    "parameters", [{}, {"medium": {"shape": (64, 64), "uptake": 0.4}}], ids=["", "medium"]
)
def test_worlds_are_rendered_one_by_one(parameters):
    env = environment(2, 2, **parameters)
    env.reset()
    first, second = env.render(), env.render(env_index=1)
    assert first.shape == second.shape == (720, 960, 3)
    assert first.dtype == np.uint8
    assert not np.array_equal(first, second)
    env.rand_step()
    assert not np.array_equal(env.render(mode="rgb_array"), first)
    with pytest.raises(ValueError, match="env_index must be below 2, got 2"):
        env.render(env_index=2)
    with pytest.raises(ValueError, match=r"mode must be .*got 'ansi'"):
        env.render("ansi")


@pytest.mark.parametrize(
    ("transform", "begins_with"),
    [
        (functools.partial(CatFrames, N=3, dim=-1), lambda first: first.repeat(1, 1, 3)),
        (
            functools.partial(TimeMaxPool, T=3),
            lambda first: first.clamp(min=0),
        ),  # it takes 0 for what was not
    ],
    ids=["CatFrames", "TimeMaxPool"],
)
def test_transforms_forget_a_life_that_is_over(transform, begins_with):
    whole = (GROUP, "observation")
    env = environment(3, 2, life=12.0, varying_speed=True)
    env = TransformedEnv(env, transform(in_keys=[whole], out_keys=["seen"]))
    data = env.rollout(100, break_when_any_done=False)
    begun = data["next", "done"][:, :-1, 0]
    assert (begun.any(0) & ~begun.all(0)).any()  # worlds end one by one
    assert torch.equal(data["seen"][:, 1:][begun], begins_with(data[whole][:, 1:][begun]))
    assert not torch.equal(data["seen"][:, 5], begins_with(data[whole][:, 5]))


def test_the_global_generators_stay_as_they_are():
    before = random.getstate(), np.random.get_state()[1].tolist(), torch.get_rng_state()  # noqa: NPY002
    env = environment(**NOISE)
    env.set_seed(11)
    env.restart()
    for action in random_actions(env):
        env.advance(torch.as_tensor(action))
        if env.state.finished.all():
            break
    env.restart()
    after = random.getstate(), np.random.get_state()[1].tolist(), torch.get_rng_state()  # noqa: NPY002
    assert before[:2] == after[:2]
    assert torch.equal(before[2], after[2])


def test_what_was_handed_out_stays_as_it_was():
    env = environment(life=20.0, **NOISE, **VORTICES)
    env.restart()
    held = [(env.state, env.observation)]
    copies = [[each.clone() for each in (*env.state.named("").values(), env.observation)]]
    for action, _ in zip(random_actions(env), range(10), strict=False):
        result = env.advance(torch.as_tensor(action))
        held.append((env.state, *result))
        copies.append([each.clone() for each in (*env.state.named("").values(), *result)])
    env.restart()
    for (state, *others), before in zip(held, copies, strict=True):
        assert all(
            torch.equal(*pair) for pair in zip((*state.named("").values(), *others), before, strict=True)
        )


def test_a_field_may_return_what_cannot_be_written_to():
    class Flat:
        gradient_scale = 1.0

        def concentration(self, position):
            if isinstance(position, np.ndarray):
                return np.broadcast_to(position.dtype.type(2.0), position.shape[:-1])
            return position.new_full((), 2.0).expand(position.shape[:-1])

    env = environment(field=Flat())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env.restart()
        result = env.advance(torch.zeros(2, 3, dtype=torch.int64))
        assert (env.state.start_concentration == 2.0).all()
    assert not result.reward.any()
    assert not env.gain().any()


def test_positions_are_float32_unless_float64_is_asked_for():
    for dtype, expected in ((None, torch.float32), ("float64", torch.float64)):
        env = environment(**({} if dtype is None else {"dtype": dtype}))
        data = env.reset()
        assert env.state.position.dtype == expected
        assert data[GROUP, "observation"].dtype == torch.float32


def test_a_world_may_be_given_whole():
    world = World(n_records=8, life=6.0)
    by_parts = environment(n_records=8, life=6.0)
    given = SwarmEnv(2, n_swimmers=3, seed=0, world=world)
    assert given.world is world
    assert torch.equal(given.reset()[GROUP, "observation"], by_parts.reset()[GROUP, "observation"])
    with pytest.raises(TypeError, match=r"world must be given alone, got .*life"):
        SwarmEnv(2, world=world, life=6.0)


def test_given_poses_are_started_from():
    env = environment(1, 2)
    position = torch.tensor([[[1.0, 2.0], [30.0, -4.0]]])
    env.place(position, torch.zeros(1, 2), torch.zeros(1, 2, 4, dtype=torch.int64))
    assert torch.equal(env.state.position, position)


@pytest.mark.parametrize("cells", [0, 5_000])
def test_what_an_environment_holds_can_be_put_into_another(cells, monkeypatch):
    parameters = NOISE | {"varying_speed": True, "interval_rule": "exact", "dtype": "float64"}
    first = environment(life=60.0, **parameters)
    monkeypatch.setattr(torchrl_env, "NUMPY_CELLS", cells)  # what one library held the other takes
    second = environment(life=60.0, **parameters)
    first.restart()
    actions = [torch.as_tensor(action) for action, _ in zip(random_actions(first), range(90), strict=False)]
    for action in actions[:70]:
        first.advance(action)
    second.load_state_dict_of_env(first.state_dict_of_env())
    torch.testing.assert_close(first.observation, second.observation)
    for action in actions[70:]:
        torch.testing.assert_close(tuple(first.advance(action)), tuple(second.advance(action)))
    torch.testing.assert_close(first.restart(), second.restart())


@pytest.mark.slow
def test_a_compiled_environment_lives_the_same_lives():
    plain, fast = environment(**VORTICES), environment(compile_step=True, **VORTICES)
    plain.restart()
    fast.restart()
    for action in random_actions(plain):
        one, other = plain.advance(torch.as_tensor(action)), fast.advance(torch.as_tensor(action))
        assert torch.allclose(one.observation, other.observation, atol=1e-4)
        assert torch.equal(one.truncated, other.truncated)
        if plain.state.finished.all():
            break


def test_without_a_compiler_the_environment_goes_on_uncompiled_and_says_so(monkeypatch, capfd):
    monkeypatch.setattr(torchrl_env, "NUMPY_CELLS", 0)  # it goes on in torch

    def without_compiler(function, **options):
        def call(*arguments):
            raise RuntimeError("no working C++ compiler found\nand much more")

        return call

    monkeypatch.setattr(torch, "compile", without_compiler)
    plain, fast = environment(**VORTICES), environment(compile_step=True, **VORTICES)
    assert torch.equal(plain.restart(), fast.restart())
    for action, _ in zip(random_actions(plain), range(5), strict=False):
        one, other = plain.advance(torch.as_tensor(action)), fast.advance(torch.as_tensor(action))
        assert torch.equal(one.observation, other.observation)
    said = capfd.readouterr().err
    assert said.count("torch.compile does not work here, going on without") == 1
    assert "RuntimeError: no working C++ compiler found\n" in said
