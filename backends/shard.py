"""Run engines that hold the interpreter lock in one process per core, with shared memory."""

import ctypes
import multiprocessing
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from types import ModuleType

import numpy as np

from backends.engine import Engine
from backends.spec import Spec
from backends.state import Array, InitialState, State


class WorkerError(RuntimeError):
    """A simulation process failed or died; the message says how."""


def simulate(engine: type[Engine], specs: Sequence[Spec], workers: int) -> "Engine | Sharded":
    """Simulate `specs` on up to `workers` cores: in threads if the engine can, else in processes.

    Worlds are independent, so the number of workers changes no result.
    """
    workers = max(1, min(workers, len(specs)))
    if engine.steps_in_threads:
        return engine(specs, threads=workers)  # type: ignore[call-arg]
    return engine(specs) if workers == 1 else Sharded(engine, specs, workers)


class _Shared:
    """Arrays in memory that parent and workers share."""

    def __init__(self, buffers: list, shapes: list[tuple[int, ...]]) -> None:
        arrays = iter(
            np.frombuffer(b, dtype=np.float64).reshape(s)
            for b, s in zip(buffers, shapes, strict=True)
        )
        self.target, self.load = next(arrays), next(arrays)
        self.applied = next(arrays)
        self.pull, self.mask = next(arrays), next(arrays)
        self.initial = InitialState(
            joint_rad=next(arrays),
            stick_pos_m=next(arrays),
            stick_quat_wxyz=next(arrays),
            noise_seed=next(arrays),
        )
        n, joints = self.target.shape
        tips = shapes[-1][1]
        self.state = State.allocate(n, joints, tips, lambda shape: next(arrays))


def _shapes(n: int, ticks: int, joints: int, tips: int) -> list[tuple[int, ...]]:
    shapes: list[tuple[int, ...]] = [(n, joints)] * 2 + [(n, ticks, joints)] + [(n,)] * 2
    shapes += [(n, joints), (n, 3), (n, 4), (n,)]

    def note(shape: tuple[int, ...]) -> Array:
        shapes.append(shape)
        return np.zeros(0)

    State.allocate(n, joints, tips, note)
    return shapes


@contextmanager
def _alone(engine: type[Engine]) -> Iterator[None]:
    """Keep processes that start in this block from importing the user's script.

    A new process would run the script again unless it is guarded by `if __name__ == "__main__"`. It
    needs the script only for an engine that is defined there.
    """
    script = sys.modules["__main__"]
    if engine.__module__ != "__main__":
        sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


def _work(
    pipe: Connection,
    engine_class: type[Engine],
    specs: Sequence[Spec],
    rows: slice,
    buffers: list,
    shapes: list[tuple[int, ...]],
) -> None:
    """Main loop of a worker: build its worlds, then serve requests until it is stopped."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        shared = _Shared(buffers, shapes)
        engine = engine_class(specs)
        engine.state = shared.state.rows(rows)
        initial = InitialState(
            joint_rad=shared.initial.joint_rad[rows],
            stick_pos_m=shared.initial.stick_pos_m[rows],
            stick_quat_wxyz=shared.initial.stick_quat_wxyz[rows],
            noise_seed=shared.initial.noise_seed[rows],
        )
        pipe.send(None)
        while (request := pipe.recv()) != "close":
            if request == "reset":
                engine.reset(initial, shared.mask[rows] > 0)
            elif request == "rollout":
                engine.rollout(shared.applied[rows])
            else:
                more = (shared.load, shared.pull) if request == "advance under load" else ()
                engine.advance(shared.target[rows], *(array[rows] for array in more))
                shared.applied[rows] = engine.applied_nm
            pipe.send(None)
        engine.close()
    except (EOFError, ConnectionError):
        return  # nobody waits any more
    except Exception as error:  # noqa: BLE001 - whatever it was, the parent must hear of it
        pipe.send(f"{type(error).__name__}: {error}")


class Sharded:
    """A `Simulator` over several processes of one engine."""

    def __init__(self, engine: type[Engine], specs: Sequence[Spec], workers: int) -> None:
        self.specs = tuple(specs)
        hand = specs[0].hand
        ticks = specs[0].timing.substeps
        shapes = _shapes(len(specs), ticks, len(hand.joint_names), len(hand.fingertips))
        context = multiprocessing.get_context("spawn")
        buffers = [context.RawArray(ctypes.c_double, int(np.prod(s))) for s in shapes]
        self._shared = _Shared(buffers, shapes)
        self.applied_nm = self._shared.applied
        """See `Engine.applied_nm`."""
        self._pipes, self._processes = [], []
        cuts = np.linspace(0, len(specs), workers + 1).astype(int)
        for start, stop in zip(cuts[:-1], cuts[1:], strict=True):
            rows = slice(int(start), int(stop))
            ours, theirs = context.Pipe()
            job = (theirs, engine, self.specs[rows], rows, buffers, shapes)
            process = context.Process(target=_work, args=job, daemon=True)
            with _alone(engine):
                process.start()
            theirs.close()
            self._pipes.append(ours)
            self._processes.append(process)
        self._await()

    def reset(self, initial: InitialState, mask: Array) -> State:
        """See `Simulator.reset`."""
        self._shared.mask[:] = mask
        self._shared.initial.joint_rad[:] = initial.joint_rad
        self._shared.initial.stick_pos_m[:] = initial.stick_pos_m
        self._shared.initial.stick_quat_wxyz[:] = initial.stick_quat_wxyz
        self._shared.initial.noise_seed[:] = initial.noise_seed
        return self._request("reset")

    def advance(
        self, target_rad: Array, load_nm: Array | None = None, pull_n: Array | None = None
    ) -> State:
        """See `Simulator.advance`."""
        self._shared.target[:] = target_rad
        if load_nm is None and pull_n is None:
            return self._request("advance")
        self._shared.load[:] = 0.0 if load_nm is None else load_nm
        self._shared.pull[:] = 0.0 if pull_n is None else pull_n
        return self._request("advance under load")

    def rollout(self, torque_nm: Array) -> None:
        """See `Engine.rollout`; T is that of a policy period."""
        self.applied_nm[:] = torque_nm
        self._request("rollout")

    def close(self) -> None:
        """Stop the processes; a second call is harmless."""
        for pipe in self._pipes:
            try:
                pipe.send("close")
            except OSError:
                pass
            pipe.close()
        for process in self._processes:
            process.join(timeout=5)
            if process.is_alive():
                process.terminate()
        self._pipes, self._processes = [], []

    @property
    def state(self) -> State:
        """See `Engine.state`."""
        return self._shared.state

    def _request(self, request: str) -> State:
        """Send a request to all processes and return the state after it."""
        try:
            for pipe in self._pipes:
                pipe.send(request)
        except OSError as error:
            raise WorkerError(f"a simulation process died: {error}") from error
        self._await()
        return self.state

    def _await(self) -> None:
        for pipe in self._pipes:
            try:
                trouble = pipe.recv()
            except (EOFError, OSError) as error:
                raise WorkerError("a simulation process died without a message") from error
            if trouble is not None:
                raise WorkerError(trouble)
