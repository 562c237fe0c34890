"""`python -m benchmarks [NAME ...]`: measure, print tables, write JSON files with where they come from."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import re
from pathlib import Path

from benchmarks.tables import as_text
from swarm._support import files, provenance

NAMES = ("pettingzoo_path", "batched_path", "training_path", "same_goal", "exact_solutions")


def processor() -> str:
    """The processor's name, where the system tells it."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8") if Path("/proc/cpuinfo").exists() else ""
    found = re.search(r"model name\s*: (.*)", lines)
    return found[1] if found else platform.processor() or platform.machine()


def main() -> None:
    """Run the named benchmarks, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="default: all")
    parser.add_argument("--out", type=Path, default=Path("runs/benchmarks"), help="folder for the JSON files")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names or NAMES:
        print(f"\n{name}")
        result = importlib.import_module(f"benchmarks.{name}").run()
        text = as_text(result)
        print(text)
        record = {
            "benchmark": name,
            "rows": result,
            "versions": provenance.versions(),
            "commit": provenance.commit(),
            "processor": processor(),
            "cores": os.cpu_count(),
        }
        files.write_text(options.out / f"{name}.json", json.dumps(record, indent=1) + "\n")
        files.write_text(options.out / f"{name}.txt", text)
    print(f"\nwritten to {options.out}")


if __name__ == "__main__":
    main()
