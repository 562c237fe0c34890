"""What several commands print."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swarm.population.evaluation import Evaluation


def print_test(tested: Evaluation | None) -> None:
    """The table of a population test, and the limit."""
    from swarm._support.terminal import print_table

    if tested is None:
        return
    limit = tested.summary["limit"]
    print_table(tested.table.headings, tested.table.texts)
    print("limit:", "none is known" if limit is None else f"{limit:.2f}, which no policy can exceed")
