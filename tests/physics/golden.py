"""Golden lives: what cells did when they were recorded, to hold every later tree against.

`python tests/physics/golden.py compare TREE [CASE …]` compares another tree with this one to the last bit,
`… write` commits the lives of the tree in use. Only public names are used, so that any tree can be computed.
"""

import hashlib
import json
import os
import subprocess
import sys
from collections import namedtuple
from functools import partial
from pathlib import Path

import numpy as np
import torch
import xarray as xr

import swarm
from swarm.torchrl_env import SwarmEnv

ROOT = Path(__file__).parents[2]
FILE = Path(__file__).parent / "golden" / "lives.npz"
CELLS, SEED, LONGEST = 5, 11, 24
LIFE = 4.3  # no whole number of intervals, and so short that rounding has not grown
MEASURED = ("gain", "maximal_gain", "arrived", "lifetime", "decisions", "limit")
SIGNALS = ("observation", "reward", "terminated", "truncated", "gain")
Starts = namedtuple("Starts", ["position", "heading", "past"])


def gridded(kind, edges, **options):
    """A field or flow from waves on a coarse grid over [0, 10]²."""
    points = np.linspace(0.0, 10.0, 12 + (edges == "clamped"), endpoint=edges == "clamped")
    x, y = np.pi / 5 * np.stack(np.meshgrid(points, points, indexing="ij"))
    waves = {"c": 3 * np.sin(x) + 2 * np.cos(y + 0.3), "u_x": 0.2 * np.cos(x) * np.sin(y) + 0.03}
    waves |= {"u_y": -0.2 * np.sin(x) * np.cos(y), "spin": -0.04 * np.pi * np.cos(x) * np.cos(y)}
    data = {name: (("x", "y"), values) for name, values in waves.items()}
    return kind(xr.Dataset(data, {"x": points, "y": points}), edges=edges, **options)


EDGES_AND_KINDS = [(edges, kind) for edges in ("periodic", "clamped") for kind in ("cubic", "linear")]
GRIDS = {"_".join(pair): {"edges": pair[0], "interpolation": pair[1]} for pair in EDGES_AND_KINDS}
FIELDS = {
    "radial": swarm.RadialField(offset=10.0, egg_radius=3.0),
    "plume": swarm.GaussianPlume(egg_position=(5.0, 5.0), width=4.0),
    "source": swarm.DiffusingSource(egg_position=(5.0, 5.0), core=2.0, distance=4.0),
    "function": swarm.FunctionField(lambda r: 0.1 * r[..., 0] ** 2 - r[..., 1], 1.0, None, (4.0, 6.0), 1.5),
    "inside": swarm.FunctionField(lambda r: r[..., 1] - 5.0, 1.0, inside=lambda r: r[..., 0] > 0.0),
    **{name: gridded(swarm.GriddedField, **grid, variable="c") for name, grid in GRIDS.items()},
}
FLOWS = {
    **{name: name for name in ("taylor_green", "uniform", "shear", "vortex")},
    "poiseuille": swarm.PoiseuilleFlow(walls=(0.0, 1.5)),
    "clockwise": swarm.Vortex(centre=(4.0, 6.0), core=1.5, clockwise=True),
    "function": swarm.FunctionFlow(lambda r: 0.003 * r * r[..., [1, 0]], 0.5, 0.05),
    "function_spin": swarm.FunctionFlow(lambda r: 0.02 * r, 0.3, 0.02, lambda r: 0.002 * r[..., 0]),
    **{name: gridded(swarm.GriddedFlow, **grid) for name, grid in GRIDS.items()},
    **{f"{name}_spin": gridded(swarm.GriddedFlow, **grid, spin="spin") for name, grid in GRIDS.items()},
}
NEAR_EGG = {"field": swarm.RadialField(offset=3.0), "start_box": ((-2.5, 2.5), (-2.5, 2.5))}
VORTICES = {"flow": "taylor_green", "sense_flow": True, "start_box": ((2.0, 8.0), (1.0, 9.0))}
NOISES = {"concentration_noise": 0.3, "curvature_noise": 0.4, "rotational_diffusion": 0.05}
WORLDS = {
    **{f"records_{number}": {"n_records": number} for number in (2, 4, 5, 8)},
    "exact": {"interval_rule": "exact"},
    "exact_varying": {"varying_speed": True, "interval_rule": "exact"},
    "varying": {"varying_speed": True},
    "three_curvatures": {"curvatures": (2.5, 4.0, 5.5), "varying_speed": True},
    "fast": {"speed": 1.5, "time_step": 0.01, "start_box": ((2.0, 3.0), (-4.0, 1.0))},
    "near_egg": NEAR_EGG,
    "egg_in_vortices": VORTICES | NEAR_EGG,
    "noises_near_egg": NEAR_EGG | NOISES,
    "noises_in_vortices": VORTICES | NOISES | {"varying_speed": True},
    **{name: {name: strength} for name, strength in NOISES.items()},
    **{f"field_{name}": {"field": field} for name, field in FIELDS.items()},
    **{f"flow_{name}": {"flow": flow, "sense_flow": True} for name, flow in FLOWS.items()},
    "gridded_both": {"field": FIELDS["periodic_cubic"], "flow": FLOWS["clamped_cubic"], "sense_flow": True},
    **{f"paper_{field}": {"field": field} for field in ("linear", "radial")},
    "paper_vortices": VORTICES | {"field": "linear", "life": 400.0},  # for which tables are shipped
}
STRATEGIES = {"greedy": swarm.Greedy(), "random": swarm.Random()}
MORE = {"swinging": swarm.Swinging(), "observing": swarm.FromObservation(lambda o: (o[..., 0] > 0.2) * 1)}
ZOO = {"records_2": ["linear_n2"], "records_4": ["linear_n4"], "records_8": ["linear_n8"]}
ZOO |= {"varying": ["varying_speed"], "near_egg": ["radial"]}
ZOO |= {"paper_vortices": ["taylor_green_aware", "taylor_green_blind"]}
DEFAULT = {"field": swarm.LinearField(offset=-5.0)}  # small: in float32 a difference of large ones is coarse


def lives(name):
    """A population test, and lives from the same starts in every library and precision."""
    world, still = swarm.World(**{"life": LIFE} | DEFAULT | WORLDS[name]), "flow" not in WORLDS[name]
    networks = {policy: swarm.load_policy(f"zoo:{policy}") for policy in ZOO.get(name, ())}
    players = STRATEGIES | networks | (MORE if still else {})
    results = swarm.population_test(world, players, cells=CELLS, life=LIFE, seed=SEED, limit=False)
    own = {policy: results.sel(policy=policy).data_vars.items() for policy in players}
    arrays = {f"{policy}/population/{key}": part.values for policy in own for key, part in own[policy]}
    starts = Starts(*(results[key].values for key in ("start_position", "start_heading", "past")))
    bound = swarm.limit(world, starts) if still or world.life == 400.0 else None  # others take a minute
    if bound is not None:
        arrays["optimal/population/limit"] = np.array(bound)
        players = players | {"optimal": swarm.Optimal(world)}
    for policy, player in players.items():
        for variant in ("numpy64", "numpy32", "torch64", "torch32"):
            series = lived(world, player, starts, variant)
            arrays |= {f"{policy}/{variant}/{key}": values for key, values in series.items()}
    return arrays


def lived(world, policy, starts, variant):
    """Series (decisions, cells, ...) of one life, in one library and precision."""

    def array(values):
        values = values.astype(f"float{variant[-2:]}") if values.dtype.kind == "f" else values
        return torch.from_numpy(values) if variant.startswith("torch") else values

    luck, rows, state = np.random.default_rng(SEED), [], world.start(*map(array, starts))
    while len(rows) < LONGEST and not bool(state.finished.all()):
        action = policy.act(world, state, array(luck.random(CELLS)))
        state, outcome = world.step(state, action, array(luck.standard_normal((CELLS, 3))))
        signals = {key: getattr(outcome, key) for key in SIGNALS}
        rows.append(signals | {"action": action, "position": state.position, "heading": state.heading})
    return {key: np.stack([np.asarray(row[key]) for row in rows]) for key in rows[0]}


def pettingzoo(luck, **options):
    """Two episodes, and the environment's state."""
    env = swarm.parallel_env(CELLS, **options)
    for seed in (SEED, None):
        env.reset(seed=seed)
        while env.agents:
            *signals, infos = env.step({agent: int(luck.integers(2)) for agent in env.agents})
            gains = [info["gain"] for info in infos.values()]
            yield [*(list(signal.values()) for signal in signals), gains, env.state()]


def torchrl(luck, cells=CELLS, steps=9, **options):
    """Two worlds that begin again as they end, and the observation to go on from."""
    env = SwarmEnv(2, n_swimmers=cells, seed=SEED, **options)
    data = env.reset()
    for _ in range(steps):
        data["swimmers", "action"] = torch.from_numpy(luck.integers(2, size=(2, cells)))
        done, data = env.step_and_maybe_reset(data)
        yield [*(done["next", "swimmers", key] for key in SIGNALS), data["swimmers", "observation"]]


def faces(name):
    """What faces show of random actions, flat; TorchRL's has few cells in NumPy, many in torch."""
    many, arrays = partial(torchrl, cells=2600, steps=5), {}
    for face, show in (("pettingzoo", pettingzoo), ("torchrl", torchrl), ("torchrl_many", many)):
        for dtype in ("float64", "float32"):
            rows = show(np.random.default_rng(SEED), dtype=dtype, life=1.3, **DEFAULT | WORLDS[name])
            for key, column in zip((*SIGNALS, "further"), zip(*rows, strict=True), strict=True):
                arrays[f"{face}/{dtype}/{key}"] = np.concatenate([np.ravel(part) for part in column])
    return arrays


CASES = {name: partial(lives, name) for name in WORLDS}
for name in ("records_2", "flow_taylor_green", "near_egg", "flow_poiseuille", "noises_in_vortices"):
    CASES[f"faces_{name}"] = partial(faces, name)


def computed(cases):
    """All arrays of some cases by name: case/policy or face/variant/quantity."""
    torch.set_num_threads(1)  # arrays this small only wait for further threads
    return {f"{case}/{name}": array for case in cases for name, array in CASES[case]().items()}


def reference(name):
    """The committed array that one is held against: NumPy's, in float64; None for recorded float32 series."""
    case, policy, variant, key = name.split("/")
    against = variant.replace("torch", "numpy").replace("32", "64")
    return None if variant == "population" and key not in MEASURED else f"{case}/{policy}/{against}/{key}"


def reduced(array):
    """The part of an array that is committed: some numbers of it, or some hundred actions and flags."""
    count = min(array.size, 16 if array.dtype.kind == "f" else 400)
    return array.ravel()[np.arange(count) * (array.size - 1) // max(count - 1, 1)].astype(np.float64)


def write():
    """Commits the lives of the tree in use."""
    parts = {name: reduced(array) for name, array in computed(CASES).items() if reference(name) == name}
    sizes = [len(part) for part in parts.values()]
    np.savez_compressed(FILE, names=list(parts), sizes=sizes, values=np.concatenate(list(parts.values())))


def committed():
    """The committed arrays by name."""
    with np.load(FILE) as file:
        parts = np.split(file["values"], np.cumsum(file["sizes"])[:-1])
        return dict(zip(file["names"].tolist(), parts, strict=True))


def compare(tree, *cases):
    """Prints the names of arrays that another tree computes otherwise than this one; how many they are."""
    found = []
    for root in (ROOT, Path(tree).resolve()):
        settings = os.environ | {"PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-P", __file__, "hash", *cases]
        run = subprocess.run(command, env=settings, stdout=subprocess.PIPE, text=True, check=True)
        source, digests = json.loads(run.stdout.splitlines()[-1])
        assert Path(source).is_relative_to(root), f"swarm must come from {root}, got {source}"
        found.append(digests)
    names = found[0] | found[1]
    differ = [name for name in names if found[0].get(name) != found[1].get(name)]
    print(*differ, f"{len(differ)} of {len(names)} arrays differ", sep="\n")
    return len(differ)


if __name__ == "__main__":
    word, *rest = sys.argv[1:] or ["help"]
    if word == "write":
        write()
    elif word == "hash":
        arrays = computed(rest or CASES)
        whole = {name: f"{a.dtype}{a.shape}".encode() + a.tobytes() for name, a in arrays.items()}
        print(json.dumps([swarm.__file__, {name: hashlib.sha256(whole[name]).hexdigest() for name in whole}]))
    else:
        sys.exit(compare(*rest) > 0 if word == "compare" else __doc__)
