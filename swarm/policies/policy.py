"""A policy: what chooses the next action of every cell, with or without a state of its own."""

from __future__ import annotations

import re
from typing import Any, Protocol, runtime_checkable

from swarm.physics.motion.swimmer import Way
from swarm.physics.world import Outcome, State, World

Array = Any


@runtime_checkable
class Policy(Protocol):
    """Maps a state to actions and keeps nothing: the same state and random numbers give the same actions, on
    any array library and with any leading axes.

    Used when there: `sensor`, whose records it is shown in a contest, as a world takes it; else the world's;
    and `deterministic`, with which nothing is drawn for it.
    """

    def act(self, world: World, state: State, uniform: Any) -> Array:
        """Whole numbers 0 … m − 1 (..., cells).

        `uniform` (..., cells) in [0, 1) is each cell's own random number for this decision; policies that
        leave nothing to chance ignore it, and then it may be None.
        """
        ...


@runtime_checkable
class CarryingPolicy(Protocol):
    """A policy with a state of its own, the carry, which goes from decision to decision beside the world's.

    The policy itself stays as it is: one policy may steer several populations at once.
    """

    def begin(self, world: World, state: State) -> Any:
        """The carry at the start of the cells' lives, of any kind."""
        ...

    def act_carrying(self, world: World, state: State, uniform: Array, carry: Any) -> tuple[Array, Any]:
        """Actions as of `Policy.act`, and the carry for the next decision."""
        ...


@runtime_checkable
class ContinuousPolicy(Protocol):
    """A policy that takes no actions: it says what is swum to the next decision. In population tests, sweeps
    and films, in NumPy, where its `continuous` is True.
    """

    continuous: bool

    def begin(self, world: World, state: State) -> Any:
        """As of `CarryingPolicy`; raises ValueError for a world that it cannot steer in."""
        ...

    def swim(self, world: World, state: State, noise: Array, carry: Any) -> tuple[Way, Any]:
        """What `World.step` takes as its way, with the same noise, and the carry for the next decision."""
        ...


AnyPolicy = Policy | CarryingPolicy | ContinuousPolicy


def check_policy(name: str, policy: Any) -> None:
    """Raises TypeError unless `policy` can choose actions."""
    methods = ("begin", "act_carrying") if hasattr(policy, "act_carrying") else ("act",)
    if not all(callable(getattr(policy, method, None)) for method in methods):
        raise TypeError(
            f"policy {name!r} must have act(world, state, uniform), or begin(world, state) and "
            f"act_carrying(world, state, uniform, carry), got {policy!r}"
        )


def is_deterministic(policy: AnyPolicy) -> bool:
    """Whether a policy says that it leaves nothing to chance."""
    return bool(getattr(policy, "deterministic", False))


def fingerprint(policy: AnyPolicy) -> str:
    """What tells a policy from others: its own `fingerprint`, as networks have one, else what it prints."""
    own = getattr(policy, "fingerprint", None)
    return own if isinstance(own, str) else re.sub(r" at 0x\w+", "", repr(policy))


def begin(policy: AnyPolicy, world: World, state: State) -> Any:
    """What the policy carries into its first decision; None where it keeps nothing."""
    return policy.begin(world, state) if hasattr(policy, "begin") else None


def is_continuous(policy: Any) -> bool:
    """Whether a policy takes no actions."""
    return bool(getattr(policy, "continuous", False))


def lived(
    policy: AnyPolicy, world: World, state: State, uniform: Array, noise: Array, carry: Any = None
) -> tuple[State, Outcome, Any]:
    """The state after a decision of a policy of any kind, what it led to, and what the policy carries on."""
    if is_continuous(policy):
        assert isinstance(policy, ContinuousPolicy)
        way, carry = policy.swim(world, state, noise, carry)
        return *world.step(state, None, noise, way), carry
    action, carry = decide(policy, world, state, uniform, carry)
    return *world.step(state, action, noise), carry


def decide(
    policy: AnyPolicy, world: World, state: State, uniform: Array | None, carry: Any = None
) -> tuple[Array, Any]:
    """Actions (..., cells) of a policy that takes any, and what it carries on."""
    if isinstance(policy, CarryingPolicy):
        return policy.act_carrying(world, state, uniform, carry)
    assert isinstance(policy, Policy)
    return policy.act(world, state, uniform), carry
