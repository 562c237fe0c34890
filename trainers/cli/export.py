"""`swarm export`: a trained policy for programs without this package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trainers.cli.app import app


@app.command()
def export(
    policy: Annotated[str, typer.Argument(help="A run folder, a policy file or zoo:NAME.")],
    format: Annotated[str, typer.Option(help="onnx, c (a C99 header) or json.")],
    out: Annotated[
        Path | None, typer.Option(help="New file; default: the policy's name, in this folder.")
    ] = None,
) -> None:
    """Write a trained policy for other programs, and say what a decision costs."""
    from swarm.policies.export import default_path, export_policy
    from swarm.policies.network import load_policy

    path = default_path(policy, format) if out is None else out
    network = load_policy(policy)
    found = export_policy(network, path, format)
    print(f"{network!r} is written to {path}")
    print(f"{found.parameters} parameters, {found.bytes} bytes in float32")
    print(f"per decision: {found.multiplications} multiplications, {found.tanhs} tanh")
