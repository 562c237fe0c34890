"""The list of the paper's claims, in its order; those whose measurements are missing are left out."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from swarm.population.results import RIVAL
from trainers.paper import claims
from trainers.paper.claims import Claim
from trainers.paper.measurements import DEVISED, Circle, Lives, Measured

RECORDS = {"linear_n2": 2, "linear_n4": 4, "linear_n8": 8}  # N_T of the cases with one speed
STEADY, VARYING = "linear_n4", "varying_speed"
EGG, VORTICES = "radial", "taylor_green"


class TrainingGains(NamedTuple):
    """Gains of the training cells, which explore."""

    seeds: tuple[int, ...]
    gain: np.ndarray  # (seeds, epochs)


class Evidence(NamedTuple):
    """Everything that was measured."""

    cases: Mapping[str, Measured]
    circles: Mapping[str, Circle]
    training: Mapping[tuple[str, str], TrainingGains]  # by recipe and experiment
    seed: int  # of the bootstrap

    def lives(self, case: str, kind: str, recipe: str = DEVISED) -> Lives | None:
        """Lives under one stack or strategy, if they were lived."""
        return self.cases[case].lives.get((recipe, kind)) if case in self.cases else None


def all_claims(evidence: Evidence, recipes: tuple[str, ...]) -> list[Claim]:
    """Every claim, first those about what nobody trains; then each under one recipe after the other."""
    parts = (_training, _records, _speed, _egg, _flow)
    trained = [claim for recipe in recipes for part in parts for claim in part(evidence, recipe)]
    order = list(dict.fromkeys(claim.id for claim in trained))
    return [*_devised(evidence), *sorted(trained, key=lambda claim: order.index(claim.id))]


def _devised(evidence: Evidence) -> Iterator[Claim]:
    for name, circle in evidence.circles.items():
        yield claims.swinging_returns(name, f"N_T = {RECORDS[name]}", circle)
        yield claims.swinging_circle(name, f"N_T = {RECORDS[name]}", circle)
    greedy = {name: evidence.lives(name, RIVAL) for name in (*RECORDS, VARYING)}
    yield from _steps("greedy", "Greedy", DEVISED, greedy, evidence.seed)
    yield from _slower("greedy", "greedy", DEVISED, greedy, evidence.seed)
    yield from _angles("greedy", "greedy", DEVISED, greedy, evidence.seed)


def _training(evidence: Evidence, recipe: str) -> Iterator[Claim]:
    for name, records in RECORDS.items():
        gains = evidence.training.get((recipe, name))
        if gains is not None:
            yield claims.gain_rises(
                f"gain_rises_{name}",
                f"With N_T = {records} the gain rises in training, from the first tenth to the last.",
                recipe,
                gains.gain,
                gains.seeds,
                seed=evidence.seed,
            )


def _records(evidence: Evidence, recipe: str) -> Iterator[Claim]:
    learnt = {name: evidence.lives(name, "dqn", recipe) for name in (*RECORDS, VARYING)}
    greedy = {name: evidence.lives(name, RIVAL) for name in (*RECORDS, VARYING)}
    seed = evidence.seed
    for name, records in RECORDS.items():
        if (first := learnt[name]) and (second := greedy[name]):
            text = f"With N_T = {records} the network gains more than greedy."
            yield claims.higher(f"dqn_beats_greedy_{name}", text, recipe, first, second, seed=seed)
    yield from _steps("dqn", "The network", recipe, learnt, seed)
    for before, after in itertools.pairwise(RECORDS):
        (a, b), (c, d) = [(learnt[name], greedy[name]) for name in (before, after)]
        if a and b and c and d:
            span = f"{RECORDS[before]}_to_{RECORDS[after]}"
            text = f"The network's lead over greedy grows from N_T = {span.replace('_to_', ' to ')}."
            yield claims.lead_grows(f"lead_grows_{span}", text, recipe, (a, b), (c, d), seed=seed)
    yield from _angles("dqn", "the network", recipe, learnt, seed)
    if (first := learnt["linear_n2"]) and (second := greedy["linear_n2"]):
        text = "With N_T = 2 the network follows the gradient more closely than greedy."
        yield claims.straighter("dqn_straighter_linear_n2", text, recipe, first, second, seed=seed)
    if (first := learnt["linear_n4"]) and (second := greedy["linear_n4"]):
        text = "With N_T = 4 greedy follows the gradient more closely than the network."
        yield claims.straighter("greedy_straighter_linear_n4", text, recipe, second, first, seed=seed)


def _steps(
    kind: str, subject: str, recipe: str, lives: Mapping[str, Lives | None], seed: int
) -> Iterator[Claim]:
    """More records help from 2 to 4 and harm from 4 to 8."""
    two, four, eight = (lives[name] for name in RECORDS)
    if two and four:
        text = f"{subject} gains more with N_T = 4 than with 2."
        yield claims.higher(f"{kind}_improves_2_to_4", text, recipe, four, two, seed=seed)
    if four and eight:
        text = f"{subject} gains less with N_T = 8 than with 4."
        yield claims.higher(f"{kind}_deteriorates_4_to_8", text, recipe, four, eight, seed=seed)


def _slower(
    kind: str, subject: str, recipe: str, lives: Mapping[str, Lives | None], seed: int
) -> Iterator[Claim]:
    """A varying speed costs a little, and turns the migration away from the gradient."""
    steady, varying = lives[STEADY], lives[VARYING]
    if steady and varying:
        text = f"A varying speed costs {subject} a little of its gain."
        part = float(1 - varying.gain.mean() / steady.gain.mean())
        yield claims.higher(
            f"varying_speed_costs_{kind}", text, recipe, steady, varying, seed=seed, part_of_gain=part
        )
        text = f"With a varying speed the migration under {subject} deviates more from the gradient."
        yield claims.straighter(f"varying_speed_turns_{kind}", text, recipe, steady, varying, seed=seed)


def _angles(
    kind: str, subject: str, recipe: str, lives: Mapping[str, Lives | None], seed: int
) -> Iterator[Claim]:
    for name, each in lives.items():
        if each:
            setting = f"N_T = {RECORDS[name]}" if name in RECORDS else "a varying speed"
            text = f"With {setting} the migration under {subject} makes an angle with the gradient."
            yield claims.off_the_gradient(f"angle_{kind}_{name}", text, recipe, each, seed=seed)


def _speed(evidence: Evidence, recipe: str) -> Iterator[Claim]:
    learnt = {name: evidence.lives(name, "dqn", recipe) for name in (STEADY, VARYING)}
    greedy = evidence.lives(VARYING, RIVAL)
    yield from _slower("dqn", "the network", recipe, learnt, evidence.seed)
    if (first := learnt[VARYING]) and greedy:
        text = "With a varying speed the network still gains more than greedy."
        yield claims.higher(f"dqn_beats_greedy_{VARYING}", text, recipe, first, greedy, seed=evidence.seed)


def _egg(evidence: Evidence, recipe: str) -> Iterator[Claim]:
    if lives := evidence.lives(EGG, "dqn", recipe):
        text = "In the radial field every cell steered by the network reaches the egg."
        yield claims.everyone_arrives("radial_arrives", text, recipe, lives, seed=evidence.seed)
        text = "In the radial field the centrelines are spirals: they keep an angle to the way to the egg."
        yield claims.centrelines_spiral("radial_spirals", text, recipe, lives, seed=evidence.seed)


def _flow(evidence: Evidence, recipe: str) -> Iterator[Claim]:
    aware, blind = (evidence.lives(VORTICES, kind, recipe) for kind in ("aware", "blind"))
    greedy = evidence.lives(VORTICES, RIVAL)
    seed = evidence.seed
    if aware and blind:
        text = "In the flow the network that senses it gains more than the one that does not."
        yield claims.higher("flow_aware_beats_blind", text, recipe, aware, blind, seed=seed)
        text = "In the flow the gains of cells that sense it vary less."
        yield claims.narrower("flow_awareness_narrows", text, recipe, aware, blind, seed=seed)
    if blind and greedy:
        text = "In the flow the network that does not sense it still gains more than greedy."
        yield claims.higher("flow_blind_beats_greedy", text, recipe, blind, greedy, seed=seed)
