"""Neuroevolution of augmenting topologies (NEAT, Stanley and Miikkulainen 2002), by neat-python."""

import math
import random
import tempfile
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support import streams
from swarm.physics.world import World
from trainers.studies.minimal.brain import Brains, stacked
from trainers.studies.minimal.plan import MinimalPlan
from trainers.studies.minimal.search import fitness_of

STAGE = 800  # of the streams of fitness


def champions(world: World, plan: MinimalPlan, seed: int) -> Brains:
    """The fittest networks of every size that a whole evolution had, each once."""
    import neat

    config = _config(world.observation_size, plan.genomes)
    best: dict[int, tuple[float, Brains]] = {}
    generation = 0

    def evaluate(genomes: list[tuple[int, Any]], config: Any) -> None:
        nonlocal generation
        brains = stacked([brain_of(genome, config) for _, genome in genomes])
        found = fitness_of(world, brains, 1, plan, STAGE + seed, generation)
        for place, (_, genome) in enumerate(genomes):
            genome.fitness = float(found[place])
            size = int(brains.parameters[place])
            if size and found[place] > best.get(size, (-np.inf,))[0]:
                best[size] = float(found[place]), brains[place : place + 1]
        generation += 1

    before = random.getstate()  # neat-python draws from the global generator
    try:
        random.seed(streams.integer_seed("training", "network", seed, STAGE))
        neat.Population(config).run(evaluate, plan.neat_generations)
    finally:
        random.setstate(before)
    return stacked([brain for _, brain in best.values()])


def brain_of(genome: Any, config: Any) -> Brains:
    """The network of a genome, without what does not reach the output.

    Its output, a tanh like its nodes, has the sign of what it adds up, which is what counts.
    """
    from neat.graphs import feed_forward_layers

    inputs, (output,) = config.genome_config.input_keys, config.genome_config.output_keys
    links = {gene.key: gene.weight for gene in genome.connections.values() if gene.enabled}
    layers, _ = feed_forward_layers(inputs, [output], list(links))
    hidden = [node for layer in layers for node in sorted(layer) if node != output]
    rows = {node: row for row, node in enumerate([*hidden, output])}
    columns = {key: column for column, key in enumerate([*inputs, *hidden])}
    weights, biases = np.zeros((1, len(rows), len(columns))), np.zeros((1, len(rows)))
    for (begin, end), weight in links.items():
        if end in rows and begin in columns:
            weights[0, rows[end], columns[begin]] = weight
    for node, row in rows.items():
        biases[0, row] = genome.nodes[node].bias
    return Brains(weights, biases)


def _config(inputs: int, genomes: int) -> Any:
    import neat

    text = (resources.files("trainers.studies.minimal") / "neat.cfg").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:  # it reads nothing but files
        path = Path(folder) / "neat.cfg"
        path.write_text(text.format(inputs=inputs, genomes=genomes), encoding="utf-8")
        config = neat.Config(
            neat.DefaultGenome,
            neat.DefaultReproduction,
            neat.DefaultSpeciesSet,
            neat.DefaultStagnation,
            str(path),
        )
    # The package's own is tanh(2.5 x), and it asks for a function of Python.
    config.genome_config.add_activation("tanh", lambda total: math.tanh(total))
    return config
