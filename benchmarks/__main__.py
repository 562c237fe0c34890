"""`python -m benchmarks [NAME ...]`: measure, print tables, write them with where they come from.

All digits of all numbers are in JSON files in runs/benchmarks, wherever the tables go.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import re
from pathlib import Path
from typing import Any

from benchmarks.tables import as_text
from swarm._support import files, provenance

KEPT = Path("runs/benchmarks")
NAMES = (
    "pettingzoo_path",
    "batched_path",
    "training_path",
    "same_goal",
    "same_goal_ppo",
    "crowd_path",
    "exact_solutions",
    "exact_space",
    "population_path",
    "spread_path",
    "adaptive_cell",
    "continuous_steering",
    "three_dimensions",
    "space_limit",
)
# need a library more, or long; measured where they are named
FURTHER = ("jax_path", "launchers", "binding")


def processor() -> str:
    """The processor's name, where the system tells it."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8") if Path("/proc/cpuinfo").exists() else ""
    found = re.search(r"model name\s*: (.*)", lines)
    return found[1] if found else platform.processor() or platform.machine()


def origin(record: dict[str, Any]) -> str:
    """Where numbers come from, in a line under their table."""
    versions = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
    return f"*{record['processor']}, {record['cores']} cores; {versions}; commit {record['commit']}.*"


def main() -> None:
    """Run the named benchmarks, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "names", nargs="*", help=f"default: {', '.join(NAMES)}; beside them {', '.join(FURTHER)}"
    )
    parser.add_argument("--out", type=Path, default=KEPT, help="folder for the tables")
    options = parser.parse_args()
    for folder in (KEPT, options.out):
        folder.mkdir(parents=True, exist_ok=True)
    for name in options.names or NAMES:
        print(f"\n{name}")
        result = importlib.import_module(f"benchmarks.{name}").run()
        record = {
            "benchmark": name,
            "rows": result,
            "versions": provenance.versions() | provenance.versions("jax"),
            "commit": provenance.commit(),
            "processor": processor(),
            "cores": os.cpu_count(),
        }
        text = f"{as_text(result)}\n{origin(record)}\n"
        print(text)
        files.write_text(KEPT / f"{name}.json", json.dumps(record, indent=1) + "\n")
        files.write_text(options.out / f"{name}.txt", text)
    print(f"\nwritten to {options.out}")


if __name__ == "__main__":
    main()
