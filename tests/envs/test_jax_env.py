"""The JAX face: lives in compiled code are those of the world, and begin again; other libraries take it."""

import functools

import numpy as np
import pytest

import swarm
from swarm.physics.crowd.interactions import Contact, Dipole
from swarm.physics.crowd.spread import Spread

jax = pytest.importorskip("jax", reason="JAX is not installed")
jnp = jax.numpy
from swarm.envs.jax import EnvState, JaxSwarmEnv  # noqa: E402


@pytest.fixture(autouse=True)
def quickly_compiled():
    """Compiling takes longer than what is compiled."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


NEAR_EGG = {"field": "radial", "start_box": ((-2.5, 2.5), (-2.5, 2.5))}
WORLDS = {
    "still water": {},
    "vortices, felt": {"flow": "taylor_green", "sense_flow": True},
    "varying speed": {"varying_speed": True, "interval_rule": "exact"},
    "few decisions": {"max_cycles": 3},
    "noise": {"concentration_noise": 0.1, "curvature_noise": 0.1, "rotational_diffusion": 0.01},
    "bindings": {"binding_rate": 10.0},
    "an egg": NEAR_EGG,
    "spread": {"spread": Spread(speed=0.1, curvature=0.1)},
    "a medium": {"medium": {"shape": (64, 64), "uptake": 0.4}},
    "dipoles": {"interactions": [Dipole()]},
    "contact": {"interactions": [Contact()], "start_box": ((0, 2), (0, 2))},
    "a race": NEAR_EGG | {"first_arrivals": 1},
    "unsteady": {"flow": "double_gyre"},
    "three dimensions": {"torsions": (7.7, 5.7), "curvatures": (5.5, 7.5), "speed": 2.0, "life": 1.0},
}
CHEAP = ("few decisions", "an egg", "varying speed")
ALL = [
    pytest.param(WORLDS[name], id=name, marks=[] if name in CHEAP else pytest.mark.slow) for name in WORLDS
]


@functools.partial(jax.jit, static_argnums=(0, 2))
def lives(env, key, decisions, worlds=None):
    """All that is seen in so many decisions at random of worlds, from their beginning."""
    count = 3
    observation, state = jax.vmap(env.reset)(jax.random.split(key, count))

    def decide(carry, key):
        observation, state = carry
        action = jax.random.randint(key, (count, env.n_swimmers), 0, env.world.n_actions)
        step = jax.vmap(env.step)(jax.random.split(key, count), state, action)
        return (step.observation, step.state), (observation, state, action, step)

    return jax.lax.scan(decide, (observation, state), jax.random.split(key, decisions))[1]


@pytest.mark.parametrize("parameters", ALL)
def test_lives_go_on_as_the_world_has_them_and_begin_again(parameters):
    env = JaxSwarmEnv(3, **({"life": 4.0} | parameters))
    observation, state, action, step = lives(env, jax.random.key(1), 2 * env.max_steps + 2)
    over = step.info["finished"].all(-1)
    assert over.any(0).all()
    assert env.max_cycles in (None, env.max_steps)
    assert np.isfinite(step.reward).all()
    assert env.single_observation_space.contains(np.asarray(observation[-1, 0, 0]))
    # what ends is what was alive; whoever waits is given nothing
    ended = step.terminated | step.truncated
    assert not (step.terminated & step.truncated).any()
    np.testing.assert_array_equal(ended, step.info["valid"] & step.info["finished"])
    assert not step.reward[~step.info["valid"]].any()
    # a world that is over begins again, others go on
    np.testing.assert_array_equal(step.state.decision == 0, over)
    first, last = step.observation, step.info["final_observation"]
    np.testing.assert_array_equal(first[~over], last[~over])
    assert (first[over] != last[over]).any(-1).all()
    assert not step.state.cells.finished[over].any()
    assert len(np.unique(np.asarray(step.state.cells.position[over])[..., 0])) == 3 * over.sum()
    if not env.world.has_noise:  # the same decisions one by one, in NumPy
        at = (0, slice(None)) if env.world.is_shared else (0, slice(0, 1))
        pick = lambda arrays: jax.tree.map(lambda each: np.asarray(each[at[0]][:1]), arrays)  # noqa: E731
        after, outcome = env.world.step(pick(state).cells, pick(action))
        np.testing.assert_allclose(outcome.observation, pick(last), atol=2e-4)
        np.testing.assert_allclose(outcome.gain, pick(step.info["gain"]), atol=2e-4)
        np.testing.assert_allclose(after.position, pick(step.state).cells.position, atol=1e-4)


@pytest.mark.parametrize("parameters", [NEAR_EGG, {}, WORLDS["three dimensions"]], ids=["egg", "", "space"])
def test_starts_have_the_distribution_of_the_other_faces(parameters):
    env = JaxSwarmEnv(2000, **({"life": 4.0} | parameters))
    _, state = env.reset(jax.random.key(3))
    drawn = swarm.physics.starts.draw_starts(env.world, 2000, 0)
    cells = state.cells
    assert np.all(np.isfinite(cells.memory))
    for ours, theirs in zip(np.asarray(cells.position).T, drawn.position.T, strict=True):
        for quantile in (0.0, 0.25, 0.5, 0.75, 1.0):
            assert abs(np.quantile(ours, quantile) - np.quantile(theirs, quantile)) < 0.05 * np.ptp(theirs)
    assert abs(np.asarray(cells.heading).mean(0)).max() < 0.1
    if env.world.egg is not None:
        assert np.hypot(*np.asarray(cells.position).T).min() > env.world.egg[1]
    action = env.world.curvature(cells)
    assert abs(float((action == env.world.curvatures[0]).mean()) - 0.5) < 0.05


def test_the_same_key_gives_the_same_life_with_and_without_vmap_and_of_either_kind():
    env = JaxSwarmEnv(3, life=2.0)
    keys = jax.random.split(jax.random.PRNGKey(0), 2)  # of the old kind
    many, _ = jax.vmap(jax.vmap(env.reset))(keys[None])
    one, state = env.reset(jax.random.wrap_key_data(keys[1]))
    np.testing.assert_allclose(many[0, 1], one, atol=1e-6)
    step = jax.vmap(env.step, (0, None, None))(keys, state, jnp.zeros(3, int))
    alone = env.step(keys[0], state, jnp.zeros(3, int))
    assert jax.tree.structure(step) == jax.tree.structure(alone)
    np.testing.assert_allclose(step.observation[0], alone.observation, atol=1e-6)


def test_new_lives_are_drawn_only_where_one_begins():
    env = JaxSwarmEnv(2, life=2.0)
    keys = jax.random.split(jax.random.key(0), 4)
    _, state = jax.vmap(env.reset)(keys)
    text = str(jax.make_jaxpr(jax.vmap(env.step))(keys, state, jnp.zeros((4, 2), int)))
    assert "cond[" in text
    outside = text.split("cond[")[0]
    assert "random_bits" not in outside
    assert "threefry" not in outside


def test_a_cell_swims_once_for_each_number_of_its_pose_whatever_is_read_off_it():
    env, keys = JaxSwarmEnv(2, flow="taylor_green", sense_flow=True), jax.random.split(jax.random.key(0), 3)
    given = jax.eval_shape(jax.vmap(env.reset), keys)[1], jnp.zeros((3, 2), int)

    def sines(function, *given):
        return jax.jit(jax.vmap(function)).lower(*given).compile().as_text().count(" sine(")

    numbers, swum = (
        4,
        sines(lambda state, action: env.world.way(state.cells, action, None).pose[0][:, 0], *given),
    )
    sensed = 2 * 3  # by u_x, u_y and ω₀ of a record
    assert 0 < sines(env.step_env, keys, *given) <= numbers * swum + sensed


def test_a_reward_can_be_differentiated_by_where_a_cell_began():
    env = JaxSwarmEnv(1)
    _, state = env.reset(jax.random.key(0))

    def gain(position):
        moved = EnvState(state.cells._replace(position=position), state.decision, state.gain)
        return env.step_env(jax.random.key(0), moved, jnp.zeros(1, int)).info["gain"][0]

    gradient = jax.grad(gain)(state.cells.position)
    assert np.linalg.norm(gradient) == pytest.approx(env.world.field.gradient_scale, rel=1e-4)


class Foreign:
    gradient_scale = 1.0

    def concentration(self, position):
        return np.sin(np.asarray(position)[..., 0])


@pytest.mark.parametrize(
    ("settings", "error", "said"),
    [
        ({"field": Foreign()}, TypeError, r"world must compute with JAX's arrays alone, got field=.*Tracer"),
        ({"n_swimmers": 0}, ValueError, "n_swimmers must be"),
        ({"max_cycles": 0}, ValueError, "max_cycles must be"),
        ({"n_record": 3}, TypeError, "did you mean 'n_records'"),
        (
            {"field": "radial", "start_box": ((-0.1, 0.1), (-0.1, 0.1))},
            ValueError,
            "start_box must leave room",
        ),
        ({"dtype": "float64"}, ValueError, "dtype must be 'float32' unless jax_enable_x64 is on"),
    ],
)
def test_what_jax_cannot_serve_is_refused_in_one_line(settings, error, said):
    with jax.enable_x64(False), pytest.raises(error, match=said) as refused:
        JaxSwarmEnv(**settings)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("action", "said"),
    [
        (jnp.zeros(2), r"actions must be whole numbers from 0 to 1 of shape \(2,\), got float32"),
        (jnp.zeros((2, 1), int), r"of shape \(2,\), got shape \(2, 1\)"),
        ([0, 1], r"actions must be whole numbers .*, got list"),
    ],
)
def test_an_action_or_a_key_that_is_none_is_refused_when_traced(action, said):
    env = JaxSwarmEnv(2, life=4.0)
    _, state = env.reset(jax.random.PRNGKey(0))
    for step in (env.step, env.step_env):
        with pytest.raises((TypeError, ValueError), match=said):
            step(jax.random.key(0), state, action)
    for key, got in ((None, "None"), (0, r"\(\) of int32")):
        with pytest.raises(TypeError, match=rf"key must be one of jax\.random, .* got {got}"):
            env.reset(key)


def test_a_picture_shows_one_world():
    env = JaxSwarmEnv(2, life=2.0)
    picture = env.render(env.reset(jax.random.key(0))[1])
    assert picture.shape == (720, 960, 3)
    assert np.ptp(picture) > 100


class TestJaxMARL:
    @pytest.fixture
    def env(self):
        pytest.importorskip("jaxmarl", reason="JaxMARL is not installed", exc_type=ImportError)
        from swarm.envs.jax.jaxmarl import JaxMARLSwarm

        return JaxMARLSwarm(3, life=2.0)

    def test_its_log_wrapper_and_rollout_manager_live_lives(self, env):
        pytest.importorskip("jaxmarl.wrappers.baselines", exc_type=ImportError)  # gymnax wants six, unasked
        from jaxmarl.wrappers.baselines import CTRolloutManager, LogWrapper

        wrapped = LogWrapper(env)

        def decide(carry, key):
            keys = jax.random.split(key, 2)
            chosen = {agent: jax.random.randint(key, (2,), 0, 2) for agent in env.agents}
            observation, state, *rest = jax.vmap(wrapped.step)(keys, carry, chosen)
            return state, (observation, *rest)

        _, state = jax.vmap(wrapped.reset)(jax.random.split(jax.random.key(0), 2))
        decisions = 2 * env.env.max_steps
        *_, (observation, reward, done, info) = jax.lax.scan(
            decide, state, jax.random.split(jax.random.key(1), decisions)
        )
        assert list(observation) == list(reward) == env.agents
        assert done["__all__"].sum() == 4
        assert env.observation_space("swimmer_1").contains(observation["swimmer_1"][0, 0])
        assert info["returned_episode_returns"][-1].shape == (2, 3)
        manager = CTRolloutManager(env, batch_size=2, preprocess_obs=False)
        seen, state = manager.batch_reset(jax.random.key(0))
        actions = {agent: jnp.zeros(2, int) for agent in env.agents}
        seen, *_ = manager.batch_step(jax.random.key(0), state, actions)
        assert seen["swimmer_0"].shape == (2, env.env.world.observation_size)

    def test_a_given_state_is_begun_with(self, env):
        key = jax.random.key(0)
        _, given = env.reset(key)
        state = given
        for _ in range(env.env.max_steps):
            seen, state, _, done, _ = env.step(key, state, dict.fromkeys(env.agents, jnp.array(0)), given)
        assert done["__all__"]
        np.testing.assert_array_equal(state.cells.position, given.cells.position)
        np.testing.assert_array_equal(seen["swimmer_1"], env.get_obs(given)["swimmer_1"])
        assert env.agent_classes == {"swimmers": env.agents}
        assert env.get_avail_actions(state)["swimmer_0"].tolist() == [True, True]


class TestJumanji:
    @pytest.fixture
    def env(self):
        pytest.importorskip("jumanji", reason="Jumanji is not installed", exc_type=ImportError)
        from swarm.envs.jax.jumanji import JumanjiSwarm

        return JumanjiSwarm(3, life=2.0)

    def test_its_own_checks_pass(self, env):
        from jumanji.testing.env_not_smoke import check_env_does_not_smoke, check_env_specs_does_not_smoke

        check_env_does_not_smoke(env)
        check_env_specs_does_not_smoke(env)

    def test_its_wrappers_begin_the_next_life(self, env):
        from jumanji.wrappers import VmapAutoResetWrapper

        wrapped = VmapAutoResetWrapper(env)
        state, first = wrapped.reset(jax.random.split(jax.random.key(0), 2))
        assert first.first().all()

        def decide(state, _):
            return wrapped.step(state, jnp.zeros((2, 3), jnp.int32))

        _, steps = jax.lax.scan(decide, state, length=2 * env.time_limit)
        assert steps.last().sum(0).tolist() == [2, 2]
        assert steps.discount.all()  # time is up, nobody arrives
        assert (steps.observation.step_count.max(0) < env.time_limit).all()

    def test_who_arrives_has_no_discount_left(self):
        pytest.importorskip("jumanji", reason="Jumanji is not installed", exc_type=ImportError)
        from swarm.envs.jax.jumanji import JumanjiSwarm

        env = JumanjiSwarm(40, field="radial", start_box=((-1.6, 1.6), (-1.6, 1.6)))
        state, _ = env.reset(jax.random.key(0))
        state, step = jax.lax.scan(lambda s, a: env.step(s, a), state, jnp.zeros((6, 40), jnp.int32))
        arrived = step.extras["finished"]
        assert arrived.any()
        np.testing.assert_array_equal(step.discount == 0, arrived)


def test_curvatures_are_actions_and_have_gradients():
    settings = {"action": "continuous", "curvature_range": (-1.0, 5.0), "life": 2.0}
    env, world = JaxSwarmEnv(3, **settings), swarm.World(**settings)
    _, state = env.reset(jax.random.key(0))
    action = jnp.array([[-1.0], [0.0], [4.5]])
    after = env.step(jax.random.key(1), state, action)
    mirror, _ = world.step(state.cells.each(np.asarray), np.asarray(action)[:, 0])
    np.testing.assert_allclose(after.state.cells.position, mirror.position, atol=1e-5)
    np.testing.assert_allclose(world.curvature(mirror), action[:, 0], atol=1e-5)
    slope = jax.grad(lambda each: env.step_env(jax.random.key(1), state, each).info["gain"].sum())(
        action[:, 0]
    )
    assert np.isfinite(slope).all()
    assert (slope != 0).all()
