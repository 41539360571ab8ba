"""Policies of other programs: a contract says all that it takes to evaluate one."""

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

from backends import trx
from benchmark.cli import app as cli
from benchmark.parts import registry

ROOT = Path(__file__).resolve().parents[2]
OWN = ROOT / "leaderboard/policies/mujoco-circle-sb3-ppo-contact-centers-s2-eae357c7"
ORDER = [3, 0, 5, 1, 4, 2]
"""Which joint of the hand each joint of the foreign policy is."""
WORDS = ["--task", "circle", "--backend", "mujoco", "--episodes", "3", "--json", "--workers", "1"]


def written(folder: Path, contract: dict, model: onnx.ModelProto) -> list[str]:
    """A foreign policy in a folder, and the words that evaluate it."""
    folder.mkdir()
    (folder / "contract.json").write_text(json.dumps(contract))
    onnx.save(model, folder / "policy.onnx")
    return ["eval", str(folder), *WORDS]


def contract() -> dict:
    """That of the shipped policy, as it is written today."""
    return registry.load("observation", "contact-centers")(trx.HAND).contract()


def rearranged(model: onnx.ModelProto, inputs: list[int], scales: list[float]) -> onnx.ModelProto:
    """The network with inputs in another order and scale, and actions in that of ORDER."""
    graph = model.graph
    for node in graph.node:
        node.input[:] = ["inner" if name == "observation" else name for name in node.input]
        node.output[:] = ["outer" if name == "action" else name for name in node.output]
    for name, values in (
        ("inputs", np.argsort(inputs)),
        ("scales", np.array(scales, np.float32)),
        ("order", np.array(ORDER)),
    ):
        graph.initializer.append(numpy_helper.from_array(values, name))
    before = [
        helper.make_node("Mul", ["observation", "scales"], ["scaled"]),
        helper.make_node("Gather", ["scaled", "inputs"], ["inner"], axis=1),
    ]
    after = helper.make_node("Gather", ["outer", "order"], ["action"], axis=1)
    nodes = [*before, *graph.node, after]
    del graph.node[:]
    graph.node.extend(nodes)
    return model


def test_a_foreign_policy_acts_by_its_contract(tmp_path, capfd):
    """Score a policy alike whose joints, channels and scales its contract has in another order."""
    own, action = contract(), contract()["action"]
    position, axis, centers = own["observation"]
    foreign = own | {
        "joints": [own["joints"][k] for k in ORDER],
        "observation": [centers | {"scale": 0.01}, position, axis],
        "action": action
        | {
            name: [action[name][k] for k in ORDER]
            for name in ("target_range_rad", "preload_rad", "default_pose_rad")
        },
    }
    shifted = [*range(9, 18), *ORDER, 6, 7, 8]
    scales = [0.5] * 9 + [1.0] * 9
    model = rearranged(onnx.load(OWN / "policy.onnx"), shifted, scales)
    words = written(tmp_path / "theirs", foreign, model)
    assert cli.call(words) == 0
    theirs = json.loads(capfd.readouterr().out)
    assert cli.call(["eval", str(OWN), *WORDS]) == 0
    ours = json.loads(capfd.readouterr().out)
    assert theirs["algo"] == "foreign" and theirs["spec_digest"] == ours["spec_digest"]
    for score in ("p_err_cm", "q_err_deg", "held", "tracked"):
        assert theirs[score] == pytest.approx(ours[score], abs=1e-3)


@pytest.mark.parametrize(
    ("number", "value"),
    [
        ("scale_rad", 0.005),
        ("target_return", 0.5),
        ("target_lead_rad", 0.08),
        ("preload_rad", None),
        ("period_s", 0.04),
    ],
)
def test_every_number_of_the_actions_counts(number, value, tmp_path, capfd):
    """Move otherwise where the contract says otherwise what an action means."""
    scores = []
    for name, given in (("as_is", {}), ("changed", {number: value})):
        other = contract() | {"action": contract()["action"] | given}
        words = written(tmp_path / name, other, onnx.load(OWN / "policy.onnx"))
        assert cli.call([*words, "--episodes", "1"]) == 0
        scores.append(json.loads(capfd.readouterr().out)["p_err_cm"])
    assert scores[0] != pytest.approx(scores[1], rel=1e-3)


def test_names_and_rows_of_a_network_are_its_own(tmp_path, capfd):
    """Take a network whose tensors are called otherwise, and that takes one row at a time."""
    scores = []
    for name in ("as_is", "changed"):
        model = onnx.load(OWN / "policy.onnx")
        if name == "changed":
            graph = model.graph
            for node in graph.node:
                node.input[:] = [{"observation": "obs"}.get(n, n) for n in node.input]
                node.output[:] = [{"action": "actions"}.get(n, n) for n in node.output]
            graph.input[0].name, graph.output[0].name = "obs", "actions"
            for one in (graph.input[0], graph.output[0]):
                one.type.tensor_type.shape.dim[0].dim_value = 1
        assert cli.call(written(tmp_path / name, contract(), model)) == 0
        scores.append(json.loads(capfd.readouterr().out)["p_err_cm"])
    assert scores[0] == pytest.approx(scores[1], abs=1e-3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"joints": ["a"] * 6}, "joints are a, a"),
        ({"schema": 7}, "schema: input should be 2"),
        ({"observation": [{"name": "ears", "unit": "1", "width": 2, "scale": 1}]}, "channel ears"),
        ({"action": {"scale_rad": -1}}, "action.scale_rad"),
        ({"action": {"period_s": 0.0123}}, "whole multiples of 0.001"),
        ({"action": {"preload_rad": [0.1]}}, "action.preload_rad has 1 items; allowed: 6"),
    ],
)
def test_a_contract_that_cannot_be_kept_is_refused(change, said, tmp_path, capfd):
    """Name the field of the contract, the value, and what is allowed."""
    other = contract()
    for key, value in change.items():
        other[key] = other[key] | value if isinstance(value, dict) else value
    words = written(tmp_path / "p", other, onnx.load(OWN / "policy.onnx"))
    assert cli.call(words) == 2
    assert said in " ".join(capfd.readouterr().err.split())


def test_a_task_is_asked_for(tmp_path, capfd):
    """Ask for the task that no run.json says."""
    words = written(tmp_path / "p", contract(), onnx.load(OWN / "policy.onnx"))
    assert cli.call([*words[:2], "--backend", "mujoco"]) == 2
    assert "--task circle" in capfd.readouterr().err


def test_actions_that_are_not_finite_are_the_policys(tmp_path, capfd):
    """Name the policy, the world and the step where it gives no number."""
    model = onnx.load(OWN / "policy.onnx")
    for node in model.graph.node:
        node.output[:] = ["outer" if name == "action" else name for name in node.output]
    model.graph.initializer.append(numpy_helper.from_array(np.float32([np.nan] * 6), "bad"))
    model.graph.node.append(helper.make_node("Add", ["outer", "bad"], ["action"]))
    assert cli.call(written(tmp_path / "p", contract(), model)) == 1
    said = " ".join(capfd.readouterr().err.split())
    assert "action of world 0 is not finite at step 1" in said and str(tmp_path / "p") in said
