"""`python -m benchmarks [NAME ...]`: measure, print tables, write JSON files with where they come from."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
from pathlib import Path

from swarm import files, provenance

NAMES = ("pettingzoo_path", "training_path")


def main() -> None:
    """Run the named benchmarks, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="default: all")
    parser.add_argument("--out", type=Path, default=Path("runs/benchmarks"), help="folder for the JSON files")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names or NAMES:
        print(f"\n{name}")
        rows = importlib.import_module(f"benchmarks.{name}").run()
        record = {
            "benchmark": name,
            "rows": rows,
            "versions": provenance.versions(),
            "commit": provenance.commit(),
            "processor": platform.processor() or platform.machine(),
            "cores": os.cpu_count(),
        }
        files.write_text(options.out / f"{name}.json", json.dumps(record, indent=1) + "\n")
    print(f"\nwritten to {options.out}")


if __name__ == "__main__":
    main()
