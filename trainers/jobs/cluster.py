"""Clusters: tasks on the machines of a Ray cluster, through the interface of `concurrent.futures`.

A task is a pure function of its arguments, so that one whose worker or node was lost begins again elsewhere
and gives the same to the last bit; an error of the task itself is its outcome. Workers return what they find:
the driver, the process that asks, owns every folder.
"""

import copy
import functools
import os
import socket
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, NamedTuple

from swarm._support import provenance
from swarm._support.checks import check_count, check_name
from trainers.jobs.executors import InProcess, Processes
from trainers.training.run_folder import RunError

Where = tuple[str | None, int | None, str | None]  # launcher, jobs and address of `launched`
HERE: Where = (None, None, None)
KEYS = LAUNCHER, JOBS, ADDRESS = "launcher", "launcher.jobs", "launcher.address"  # words of Where
LAUNCHERS = ("here", "processes", "ray")
ANSWER = 10.0  # [s] an address has to answer
CLIENT = "ray://"
TOKEN = Path(".ray/auth_token")  # in the home, where Ray keeps it


class ClusterError(RunError):
    """A cluster that cannot do what it is asked for."""


def launched(
    launcher: str | None, jobs: int | None = None, address: str | None = None, *, retries: int = 0
) -> Executor:
    """Where tasks run: "here", in so many "processes" (default: 2), or by "ray".

    A task that loses its process is begun again `retries` times, by Ray as often as it takes.
    Raises ValueError for options that do not go together, ClusterError where no cluster answers.
    """
    launcher = check_name("launcher", "here" if launcher is None else launcher, LAUNCHERS)
    if address is not None and launcher != "ray":
        raise ValueError(f"address must come with launcher=ray, got {address!r} with {launcher}")
    if launcher == "ray":
        return Ray(address, jobs)
    if launcher == "here" and jobs not in (None, 1):
        raise ValueError(f"jobs must come with launcher=processes or ray, got {jobs}")
    return InProcess() if launcher == "here" else Processes(2 if jobs is None else jobs, retries)


def launcher_of(own: Mapping[str, str]) -> tuple[str, int | None, str | None]:
    """Launcher, jobs and address that the words `launcher`, `launcher.jobs` and `launcher.address` name."""
    for key in own:
        check_name("key of a launcher", key, KEYS)
    launcher = check_name(LAUNCHER, own.get(LAUNCHER, "here"), LAUNCHERS)
    number = own.get(JOBS)
    jobs = None if number is None else check_count(JOBS, int(number) if number.isdecimal() else number)
    return launcher, jobs, own.get(ADDRESS)


class Needs(NamedTuple):
    """What a task needs of the node that it runs on."""

    cores: float = 1
    gpus: float = 0
    memory: float = 0  # [bytes]


class Ray(Executor):
    """Tasks on a Ray cluster: the one at an address, or one on this machine with so many cores.

    Raises ClusterError where there is no Ray, nobody answers, or a node has other versions of the packages.
    """

    def __init__(self, address: str | None = None, jobs: int | None = None) -> None:
        self._ray, self._needs = _ray(address), Needs()
        self._own = not self._ray.is_initialized()
        if self._own:
            _check_answers(address)
            local = {} if address else {"num_cpus": jobs, "include_dashboard": False}
            try:
                self._ray.init(address or "local", log_to_driver=False, logging_level="ERROR", **local)
            except (OSError, RuntimeError, ValueError, self._ray.exceptions.RayError) as error:
                raise ClusterError(f"address must be a Ray cluster that answers: {_line(error)}") from None
        # Worker and node losses begin a task again, however many; its own errors are returned, never raised.
        self._remote = self._ray.remote(max_retries=-1, retry_exceptions=False)(_outcome)
        try:
            self._check_versions()
        except BaseException:
            self.shutdown()
            raise

    @property
    def workers(self) -> int:
        """How many tasks run at once."""
        cores = self._ray.cluster_resources().get("CPU", 1.0)
        return max(1, int(cores / max(self._needs.cores, 1)))

    def needing(self, needs: Needs) -> "Ray":
        """The same cluster for tasks that need so much; raises ClusterError where no node has it."""
        named = {"CPU": needs.cores, "GPU": needs.gpus, "memory": needs.memory}
        nodes = [node["Resources"] for node in self._nodes()]
        if not any(all(node.get(name, 0) >= much for name, much in named.items()) for node in nodes):
            told = ", ".join(f"{_told(name, much)}" for name, much in named.items() if much)
            most = ", ".join(_told(name, max(node.get(name, 0) for node in nodes)) for name in named)
            raise ClusterError(f"a node must have what a task needs, {told}, got at most {most}")
        other = copy.copy(self)
        other._needs, other._own = needs, False
        return other

    def submit(self, do: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future:
        """The future outcome of `do(*arguments, **options)`."""
        return self._submitted(_options(self._needs), do, *arguments, **options)

    def _submitted(
        self, options: dict[str, Any], do: Callable[..., Any], *arguments: Any, **named: Any
    ) -> Future:
        remote = self._remote.options(**options)
        try:
            asked: Future = remote.remote(provenance.versions(), do, arguments, named).future()
        except self._ray.exceptions.RayError as error:
            raise _lost(error) from None
        future: Future = Future()
        future.set_running_or_notify_cancel()
        asked.add_done_callback(functools.partial(_pass_on, future))
        return future

    def _nodes(self) -> list[dict[str, Any]]:
        return [node for node in self._ray.nodes() if node["Alive"]]

    def _check_versions(self) -> None:
        """Raises ClusterError where a node has other versions of the packages."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        there = [NodeAffinitySchedulingStrategy(node["NodeID"], soft=False) for node in self._nodes()]
        options = [{"num_cpus": 0, "scheduling_strategy": each} for each in there]
        for future in [self._submitted(each, bool) for each in options]:
            future.result()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let go of the cluster; one that began here ends."""
        if self._own:
            self._ray.shutdown()


class _Failed(NamedTuple):
    """The error that a task ended with."""

    error: Exception


def _outcome(
    versions: dict[str, str], do: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]
) -> Any:
    """In a worker: what a task gives, or the error it ends with."""
    if other := [f"{name} {own}" for name, own in provenance.versions().items() if versions.get(name) != own]:
        wanted = ", ".join(f"{name} {versions.get(name)}" for name in (each.split()[0] for each in other))
        where = socket.gethostname()
        return _Failed(ClusterError(f"worker on {where} must have {wanted}, got {', '.join(other)}"))
    try:
        return do(*arguments, **options)
    except Exception as error:
        return _Failed(error)


def _pass_on(future: Future, asked: Future) -> None:
    error = asked.exception()
    if error is not None:
        future.set_exception(_lost(error))
    elif isinstance(found := asked.result(), _Failed):
        future.set_exception(found.error)
    else:
        future.set_result(found)


def _lost(error: BaseException) -> ClusterError:
    """What is said where Ray cannot do a task."""
    from ray.exceptions import ObjectStoreFullError, OutOfDiskError

    if isinstance(error, ObjectStoreFullError | OutOfDiskError):
        rule = "must have room for what tasks take and return, but they and the disk behind them are full"
        return ClusterError(f"the nodes' object stores {rule}: ray start --object-store-memory=BYTES")
    return ClusterError(f"the cluster lost a task: {_line(error)}")


def _options(needs: Needs) -> dict[str, Any]:
    memory = {"memory": int(needs.memory)} if needs.memory else {}
    return {"num_cpus": needs.cores, "num_gpus": needs.gpus, **memory}


def _told(name: str, much: float) -> str:
    return f"{much / 2**30:.3g} GiB of memory" if name == "memory" else f"{name} {much:g}"


def _line(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[-1].strip()[:200]


def _ray(address: str | None) -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is told to anybody
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # what Ray warns of
    known = [name for name in ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH") if name in os.environ]
    if (address or "").startswith(CLIENT) and (known or (Path.home() / TOKEN).exists()):
        os.environ.setdefault("RAY_AUTH_MODE", "token")  # which Ray's client leaves to its user
    try:
        import ray
    except ImportError:
        raise ClusterError("launcher=ray needs Ray: pip install 'chemoswarm[cluster]'") from None
    return ray


def _check_answers(address: str | None) -> None:
    """Raises ClusterError unless somebody listens at an address that names a host and a port."""
    host, _, port = (address or "").removeprefix(CLIENT).rpartition(":")
    if not host:
        if address not in (None, "auto"):
            raise ClusterError(f"address must be HOST:PORT, ray://HOST:PORT or auto, got {address!r}")
        return
    try:
        socket.create_connection((host, int(port)), timeout=ANSWER).close()
    except (OSError, ValueError, OverflowError) as error:
        raise ClusterError(f"address must be a Ray cluster that answers, got {address}: {error}") from None
