"""Every learner keeps the contract: same seed same policy, a checkpoint is all it has, ONNX."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baselines.baseline import Learner, Progress
from baselines.saved import SavedPolicy, write_contract
from benchmark.errors import CommandError
from benchmark.parts import registry
from tasks.batch import BatchEnv

MakeEnv = Callable[..., BatchEnv]
WORLDS, ITERATIONS = 4, 2


@pytest.fixture(params=registry.names("algo"))
def learner(request: pytest.FixtureRequest) -> type[Learner]:
    """Every learner whose library is installed."""
    try:
        found: type[Learner] = registry.load("algo", request.param)
    except CommandError as error:
        pytest.skip(str(error))
    if not found.trains:
        pytest.skip("it does not learn")
    return found


def segment(
    kind: type[Learner], env: BatchEnv, number: int, folder: Path, **settings: Any
) -> list[Progress]:
    """Train as a run does: from the last checkpoint in the folder to the next."""
    env.seed(number)
    made, progress = kind(env, number, kind.hyperparameters(**settings)), list[Progress]()
    if number:
        made.load(folder / f"{number - 1}.pt")
    made.learn([0.9 * number] * ITERATIONS, progress.append)
    made.save(folder / f"{number}.pt")
    made.export(folder / "policy.onnx")
    write_contract(folder, env.observation)
    return progress


def test_a_chain_is_the_same_again(learner: type[Learner], make: MakeEnv, tmp_path: Path) -> None:
    """Train two segments; then, from the first checkpoint, the other again, to the bit.

    So a training that is killed and resumed gives the policy that it would have given.
    """
    env, policies = make(WORLDS), []
    for first in (0, 1):
        for number in range(first, 2):
            progress = segment(learner, env, number, tmp_path)
        policies.append((tmp_path / "policy.onnx").read_bytes())
    assert policies[0] == policies[1]
    per_iteration = learner.steps_per_iteration(WORLDS, learner.hyperparameters())
    assert [one.steps for one in progress] == [per_iteration] * ITERATIONS


def test_updates_settle(learner: type[Learner], make: MakeEnv, tmp_path: Path) -> None:
    """Change the policy otherwise at the end of a training whose updates are annealed."""
    if not hasattr(learner.hyperparameters(), "anneal"):
        pytest.skip("its updates stay as they are")
    env, policies = make(WORLDS), []
    for anneal in (0.0, 0.05, 1.0):  # nine tenths are spent before the second segment
        for number in range(2):
            segment(learner, env, number, tmp_path, anneal=anneal)
        policies.append((tmp_path / "policy.onnx").read_bytes())
    assert policies[0] == policies[1] != policies[2]


def test_the_policy_is_one(learner: type[Learner], make: MakeEnv, tmp_path: Path) -> None:
    """Export a network that takes the observation and gives actions in [-1, 1]."""
    env = make(WORLDS)
    segment(learner, env, 0, tmp_path)
    action = SavedPolicy(tmp_path, env.observation)(env.reset())
    assert action.shape == (WORLDS, env.action_width) and np.abs(action).max() <= 1.0


def test_a_critic_sees_more_than_the_policy(
    learner: type[Learner], make: MakeEnv, tmp_path: Path
) -> None:
    """Learn otherwise from the simulator's state; kill, resume and contract are as ever."""
    if not hasattr(learner.hyperparameters(), "critic"):
        pytest.skip("its critic sees what the policy sees")
    env, policies = make(WORLDS), []
    for critic in ("state", "state", "observation"):
        for number in range(2):
            segment(learner, env, number, tmp_path, critic=critic)
        policies.append((tmp_path / "policy.onnx").read_bytes())
    assert policies[0] == policies[1] != policies[2]
    seen = make(1).reset()
    assert SavedPolicy(tmp_path, env.observation)(seen).shape == (1, env.action_width)
