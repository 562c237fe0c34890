"""Worlds in physical units: the lives of the default world at another scale, labelled in µm and s."""

import numpy as np
import pytest

from swarm.physics.species import SPECIES
from swarm.physics.world import World
from swarm.policies.adaptive import AdaptiveSteering
from swarm.policies.network import load_policy
from swarm.population.contest import population_test
from swarm.population.noise import sweep_noise
from swarm.population.results import load_population, save_population, world_of


@pytest.mark.parametrize("name", SPECIES)
def test_a_species_lives_as_the_default_world_does_at_its_own_scale(name):
    world, plain = World.for_species(name), World()
    length = 4 / SPECIES[name].curvature.value
    time = length / SPECIES[name].speed.value
    policies = {"dqn": load_policy("zoo:linear_n4"), "adaptive": AdaptiveSteering()}
    found, expected = (
        population_test(each, policies, cells=5, life=20.0 * unit)
        for each, unit in ((world, time), (plain, 1.0))
    )
    np.testing.assert_allclose(found["gain"], expected["gain"], rtol=1e-6)
    np.testing.assert_allclose(found["position"], length * expected["position"], rtol=1e-4)
    np.testing.assert_allclose(found.attrs["limit"], expected.attrs["limit"], rtol=1e-6)


def test_results_are_labelled_in_the_units_of_their_world_and_keep_them(tmp_path):
    world = World.for_species("arbacia", n_records=8)
    assert world.n_records == 8
    found = population_test(world, {}, cells=2, life=1.0)
    told = {
        name: found[name].attrs["units"] for name in ("position", "time", "curvature", "lifetime", "gain")
    }
    assert told == {
        "position": "µm",
        "time": "s",
        "curvature": "1/µm",
        "lifetime": "s",
        "gain": "concentration",
    }
    save_population(found, tmp_path / "population.nc")
    assert world_of(load_population(tmp_path / "population.nc")) == world.replace(life=1.0)
    swept = sweep_noise("greedy", world, [0.0, 0.1], kind="rotation", cells=2, life=1.0).results
    assert swept["noise"].attrs["units"] == "rad^2/s"
    assert population_test(World(), {}, cells=2, life=1.0)["position"].attrs["units"] == "length"


def test_units_and_species_have_rules():
    with pytest.raises(ValueError, match="did you mean 'arbacia'"):
        World.for_species("arbacai")
    for bad in ("µm", ("µm",), ("µm", ""), (1, 2)):
        with pytest.raises(ValueError, match="units must be the units of length and time"):
            World(units=bad)
