"""The report on the smallest brain in words, every number of which was just measured."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from swarm._support import provenance
from swarm._support.tables import NOTHING, Table, percent
from trainers.minimal import drawing
from trainers.minimal.brain import Brains
from trainers.minimal.illustrations import FIGURE, FOLDER, LEVELS, best_by_size
from trainers.minimal.measurements import MACHINE, METHODS, CaseFindings, Measured
from trainers.minimal.plan import DQN, EVOLUTION, MinimalPlan
from trainers.paper.claims import Estimate


class Drawn(NamedTuple):
    """The brain that is drawn, and what it gains when its numbers are rounded as in the drawing."""

    source: Measured
    seed: int
    digits: int
    brain: Brains
    gain: float  # mean of the test cells [concentration]


def rows(case: str, found: CaseFindings) -> Iterator[dict[str, Any]]:
    """A row for every rung."""
    for each in found.measured:
        of_limit = found.fraction(each)
        low, high = of_limit.interval or (None, None)
        yield {
            "experiment": case,
            "method": each.rung.method,
            "nodes": each.rung.nodes,
            "parameters": each.rung.parameters,
            "validation, of the limit": float(each.validation.mean()) / found.validation_limit,
            "gain": float(each.gain.mean()),
            "of the limit": of_limit.value,
            "low": low,
            "high": high,
            "worst seed": of_limit.lowest,
        }


def text(plan: MinimalPlan, found: Mapping[str, CaseFindings], drawn: Mapping[str, Drawn]) -> str:
    """Markdown, to be read on its own."""
    parts = [_opening(plan), _smallest(found), _figure(found)]
    parts += [_case(plan, case, each, drawn[case]) for case, each in found.items()]
    return "\n".join(parts)


def _opening(plan: MinimalPlan) -> str:
    chosen = [f"experiment={','.join(plan.cases)}", *plan.words]
    seeds = "" if plan.n_seeds == MinimalPlan().n_seeds else f" --seeds {plan.n_seeds}"
    versions = ", ".join(f"{name} {version}" for name, version in provenance.versions().items())
    return f"""# The smallest brain

Printed by `swarm minimal {" ".join(chosen)}{seeds}`; to be changed by running it again, not by hand.

How many parameters buy how much of the possible? A brain is a network that looks at the memory and takes one
of two curvatures, κ₂ where its one output is above 0. Its parameters are its weights and biases that are not 0;
the scale of the output is among them, though it changes nothing, and of a trained Q-network the difference of
its two outputs is counted. Every brain was found with {plan.n_seeds} independent seeds:

- **DQN**: ladder of {", ".join(map(str, plan.nodes))} nodes in one tanh layer (0: none), recipe `swarm`.
- **DQN, pruned**: its smallest numbers set to 0, without learning on the way.
- **CMA-ES**: the same ladder, its weights searched by the evolution strategy `algorithm=evolution`; fitness is the mean
  gain of training cells.
- **CMA-ES, pruned and searched on**: its networks of {" and ".join(map(str, plan.thinned))} nodes lose the smallest number, and
  the search goes on with the others, until one is left.
- **NEAT**: topology and weights evolve together; for each size the brain that validation prefers among those not larger.
- **Two-state machine**: the state is the curvature, and each ends at a threshold of its own of the newest concentration;
  both thresholds are searched. As a network it has three parameters.

Sizes are chosen by {plan.cells} validation cells, numbers are those of {plan.cells} test cells (population seed {plan.seed}) in
lives of the experiments' tests. Intervals are 95%, over training seeds and test cells.

{versions}; commit {provenance.commit() or "unknown"}.
"""


def smallest(found: Mapping[str, CaseFindings]) -> Table:
    """For each experiment and method the fewest parameters that reach each level."""
    table = []
    for case, each in found.items():
        for method, label in METHODS.items():
            row: dict[str, Any] = {"experiment": case, "method": label}
            for level in LEVELS:
                row |= _of_level(each, each.smallest(method, level), f"{100 * level:g}%")
            table.append(row)
    return Table.of(table)


def _smallest(found: Mapping[str, CaseFindings]) -> str:
    limited = [case for case, each in found.items() if each.attainable]
    exception = "".join(
        f" In {case} two records leave the heading ambiguous, and levels are of {found[case].attainable:g}, about the "
        "most that they allow; percentages are of the limit everywhere."
        for case in limited
    )
    return f"""## The smallest network that reaches 95% and 99% of the limit

Fewest parameters with which the validation cells reach the level in the mean over seeds, and of the limit what the
test cells then gain, the worst seed in brackets.{exception}

{smallest(found).as_markdown(texts=2)}"""


def _of_level(found: CaseFindings, each: Measured | None, level: str) -> dict[str, Any]:
    if each is None:
        return {f"parameters for {level}": None, f"test, {level}": None}
    numbers = found.fraction(each)
    told = f"{_fraction(numbers)} ({percent(numbers.lowest)})"
    return {f"parameters for {level}": each.rung.parameters, f"test, {level}": told}


def _fraction(numbers: Estimate) -> str:
    half = NOTHING if numbers.interval is None else f"{100 * (numbers.interval[1] - numbers.value):.1f}"
    return f"{percent(numbers.value)} ± {half}"


def _figure(found: Mapping[str, CaseFindings]) -> str:
    return f"""## How many parameters buy how much of the possible

![What is missing of the limit, by the number of parameters]({FOLDER}/{FIGURE})

*What of the limit is missing in the test, by the number of parameters, for {", ".join(found)}; of rungs of the same
size the one that validation prefers. Grey lines: 95% and 99% of the limit. Dashed: greedy, which has no parameter.*
"""


def _case(plan: MinimalPlan, case: str, found: CaseFindings, drawn: Drawn) -> str:
    ladder = []
    for nodes in plan.nodes:
        row: dict[str, Any] = {"nodes": nodes}
        for method in (DQN, EVOLUTION):
            (each,) = [one for one in found.measured if one.rung[:2] == (method, nodes)]
            row |= {"parameters": each.rung.parameters, METHODS[method]: _fraction(found.fraction(each))}
        ladder.append(row)
    (state_machine,) = [each for each in found.measured if each.rung.method == MACHINE]
    fewest = best_by_size(found, "thinned")
    sizes = [
        {
            "parameters": each.rung.parameters,
            "CMA-ES, pruned and searched on": _fraction(found.fraction(each)),
        }
        for each in fewest[:8]
    ]
    a, b = _thresholds(state_machine)
    return f"""## {case}

Limit {found.limit:.2f}; greedy gains {percent(float(found.greedy.mean()) / found.limit)} of it. The two-state machine gains
{_fraction(found.fraction(state_machine))}: κ₁ turns into κ₂ where c* > {a}, κ₂ into κ₁ where c* < {b} (means over seeds ±
standard deviations; c* swings by about ±1).

{Table.of(ladder).as_markdown()}
With one tanh layer, of the limit in the test. And with ever fewer parameters:

{Table.of(sizes).as_markdown()}
{_drawing(case, found, drawn, plan)}"""


def _thresholds(each: Measured) -> tuple[str, str]:
    """a and b of the two-state machine."""
    push, bias = each.rung.brains.weights[:, 0, 1], each.rung.brains.biases[:, 0]
    return tuple(f"{np.mean(found):+.2f} ± {np.std(found):.2f}" for found in (push - bias, -push - bias))  # type: ignore[return-value]


def _drawing(case: str, found: CaseFindings, drawn: Drawn, plan: MinimalPlan) -> str:
    lines = "\n".join(drawing.formulas(drawn.brain, drawn.digits))
    unrounded = float(drawn.source.gain[drawn.seed].mean())
    return f"""### The smallest brain, drawn

![The smallest brain of {case}]({FOLDER}/brain_{case}.svg)

The smallest that reaches a level of the table, of all methods ({METHODS[drawn.source.rung.method]}, seed {drawn.seed}). c₀, κ₀ are the newest
record, κ −1 for κ₁ and +1 for κ₂. Typed in from the drawing it gains {drawn.gain:.2f} ({percent(drawn.gain / found.limit)} of the limit)
with the test cells, {unrounded:.2f} before its numbers were rounded.

```text
{lines}
```

What it computes: {drawing.words(drawn.brain, plan.test_world(case))}
"""
