"""Files of others are refused in one line, before they take time, memory or another file."""

import json
import shutil
from pathlib import Path

import numpy as np
import onnx
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from onnx import TensorProto, helper

from backends import trx
from backends.mjcf import MjcfError, mechanism
from baselines.saved import PolicyError, SavedPolicy
from benchmark.cli import app as cli
from benchmark.parts import registry
from diagnosis.logs.log import DriveSettings
from files import bounded, tables
from files.bounded import FileError
from files.tables import csv_text, read_csv, read_parquet

POLICY = Path(__file__).resolve().parents[2] / "benchmark/demo/data/policy"
ARM = (
    '<mujoco model="m"><worldbody><body name="a" pos="0 0 0"><inertial mass="0.1" pos="0 0 -0.1" '
    'diaginertia="1e-4 1e-4 1e-4"/><joint name="j" axis="0 1 0" armature="0.01"/></body>'
    "</worldbody></mujoco>"
)
START = "<worldbody>"
SOLID = 'pos="0 0 -0.1" diaginertia="1e-4 1e-4 1e-4"'
THOUSAND = '<replicate count="1000">'
LONGEST = 500


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('armature="0.01"', 'armature="0.01" frictionloss="-1"', "frictionloss below 0"),
        ('armature="0.01"', 'armature="0.01" damping="-1"', "damping below 0"),
        ('armature="0.01"', 'armature="0.01" range="nan nan"', 'range="nan nan"'),
        ('pos="0 0 0"', 'pos="nan 0 0"', 'pos="nan 0 0"'),
        (SOLID, SOLID.replace("-0.1", "0").replace("e-4", "e-15"), "moves 1e-15"),
        (START, f'{START}<replicate count="1e5"><site/></replicate>', "elements"),
        (START, START + THOUSAND * 3 + "<site/>" + "</replicate>" * 3, "1e+09 elements"),
        (START, f'<include file="/etc/hostname"/>{START}', "no other file is read"),
        (START, f'<asset><model name="b" file="b.xml"/></asset>{START}', "not attached"),
        ("<mujoco ", '<!DOCTYPE m [<!ENTITY a "b">]><mujoco ', "entities"),
        ("<mujoco ", f"<mujoco {'x' * 1_000_000}", "allowed: up to 1000000"),
        ("</mujoco>", "<" + "x" * 10_000, "no XML"),
    ],
)
def test_a_mechanism_is_refused(old, new, said):
    """Say what is wrong with an MJCF text without compiling it for long."""
    assert old in ARM
    with pytest.raises(MjcfError) as refused:
        mechanism(ARM.replace(old, new, 1), {"j": DriveSettings(kp=1, kd=0.1, limit=1)})
    assert said in str(refused.value)
    assert len(str(refused.value)) < LONGEST


@pytest.mark.parametrize(
    "part",
    [
        '<size nkey="100000000"/>',
        '<size nuser_body="100000000" memory="100G"/>',
        '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
        '<asset><texture name="t" type="2d" builtin="flat" width="99999" height="99999"/></asset>',
        '<asset><mesh name="m" file="/dev/zero"/></asset>',
    ],
)
def test_what_does_not_matter_takes_no_memory(part):
    """Leave out what reserves memory and changes nothing of the mechanism."""
    servos = {"j": DriveSettings(kp=1, kd=0.1, limit=1)}
    assert mechanism(ARM.replace(START, part + START), servos) == mechanism(ARM, servos)


def network(nodes, inputs=18, outputs=6, kind=TensorProto.FLOAT, batch="batch"):
    """An ONNX model of these nodes."""
    rows = [helper.make_tensor_value_info("observation", kind, [batch, inputs])]
    actions = [helper.make_tensor_value_info("action", kind, ["batch", outputs])]
    weights = helper.make_tensor("w", kind, [inputs, outputs], np.zeros(inputs * outputs))
    first = helper.make_tensor("first", TensorProto.INT64, [1], [0])
    graph = helper.make_graph(nodes, "policy", rows, actions, [weights, first])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)


def linear(given="observation", gives="action"):
    """A product with the weights."""
    return helper.make_node("MatMul", [given, "w"], [gives])


LOOP = helper.make_node("If", ["c"], ["action"])
NOISE = helper.make_node("RandomUniformLike", ["observation"], ["noise"])
MODELS = {
    "another type": (network([linear()], kind=TensorProto.DOUBLE), "32-bit floats"),
    "other widths": (network([linear()], inputs=17), "takes 17 numbers"),
    "fewer actions": (network([linear()], outputs=5), "gives 5 numbers"),
    "randomness": (network([NOISE, linear("noise")]), "RandomUniformLike"),
    "a branch": (network([LOOP]), "operators If"),
    "another batch": (network([linear()], batch=39), "a row per"),
    "one row for all": (
        network([linear(gives="a"), helper.make_node("Gather", ["a", "first"], ["action"])]),
        "shape",
    ),
}


@pytest.fixture
def policy(tmp_path):
    """A folder with a policy's contract."""
    shutil.copytree(POLICY, tmp_path / "policy")
    return tmp_path / "policy"


def play(folder):
    """One step of the policy in a folder."""
    observation = registry.load("observation", "contact-centers")(trx.HAND)
    return SavedPolicy(folder, observation)(np.zeros((3, observation.width), np.float32))


@pytest.mark.parametrize("name", MODELS)
def test_a_strange_network_is_refused(policy, name):
    """Take a feed-forward network with the contract's numbers, and nothing else."""
    model, said = MODELS[name]
    onnx.save(model, policy / "policy.onnx")
    assert play(POLICY).shape == (3, 6)
    with pytest.raises(PolicyError, match=said) as refused:
        play(policy)
    assert len(str(refused.value)) < LONGEST


@pytest.mark.parametrize(
    "text", ["[]", "3", "null", '"a"', '{"observation": 3}', '{"observation": [1]}', "[" * 9999]
)
def test_a_contract_of_another_type_is_refused(policy, text):
    """Say that the file is no contract."""
    (policy / "contract.json").write_text(text)
    with pytest.raises(PolicyError, match="contract"):
        play(policy)


def test_a_table_is_bounded(tmp_path, monkeypatch):
    """Refuse a small file of more numbers than fit, by what it says of itself."""
    monkeypatch.setattr(tables, "MOST_CELLS", 1_000_000)
    pq.write_table(pa.table({"a": np.zeros(2_000_000)}), tmp_path / "a.parquet", compression="zstd")
    assert (tmp_path / "a.parquet").stat().st_size < 10_000
    with pytest.raises(FileError, match="a.parquet has 1 columns and 2000000 values; allowed"):
        read_parquet(tmp_path / "a.parquet")
    (tmp_path / "a.csv").write_text("\n" * 1_100_000)
    with pytest.raises(FileError, match="values; allowed"):
        read_csv(tmp_path / "a.csv")


def test_tables_of_others_are_read_or_refused(tmp_path):
    """Read a cell of any length; ignore what pandas wrote beside; refuse what is damaged."""
    (tmp_path / "a.csv").write_text(f'a,b\n1,"{"x" * 200_000}"\n')
    assert len(read_csv(tmp_path / "a.csv")["b"][0]) == 200_000
    table = pa.table({"a": [1.0]}).replace_schema_metadata({"pandas": "{not json"})
    pq.write_table(table, tmp_path / "a.parquet")
    assert read_parquet(tmp_path / "a.parquet")["a"].tolist() == [1.0]
    whole = (tmp_path / "a.parquet").read_bytes()
    (tmp_path / "a.parquet").write_bytes(whole[:60] + b"\xff" * 60 + whole[120:])
    with pytest.raises(FileError, match="damaged"):
        read_parquet(tmp_path / "a.parquet")


@pytest.mark.parametrize("read", [bounded.read_bytes, bounded.read_json, read_csv, read_parquet])
def test_a_device_is_no_file(read):
    """Refuse what has no end."""
    with pytest.raises(FileError, match="device"):
        read(Path("/dev/zero"))


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, "{", "\xff"])
def test_json_is_refused_in_one_line(tmp_path, text):
    """Name the file and its fault."""
    (tmp_path / "a.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(FileError, match=r"a\.json cannot be read") as refused:
        bounded.read_json(tmp_path / "a.json")
    assert len(str(refused.value)) < LONGEST


def test_a_spreadsheet_finds_no_formula():
    """Mark texts that begin as formulas do; leave numbers as they are."""
    frame = pd.DataFrame({"name": ["=1+1", "plain", "@a"], "value": [-1.0, 2.0, 3.0]})
    assert csv_text(frame) == "name,value\n'=1+1,-1.0\nplain,2.0\n'@a,3.0\n"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["record", "--backend", "mujoco", "--variants", "1000000000"], "--variants is 1e+09"),
        (["record", "--backend", "mujoco", "--variants", "900", "--repeats", "900"], "episodes"),
        (["record", "--backend", "mujoco", "--seed", "9" * 400], "--seed is '999"),
        (["import", "bam", "/dev/zero"], "no recording at"),
        (["run", "--backend", "mujoco", "--task", "line", "--seed", "\udcff"], "no UTF-8"),
    ],
)
def test_a_command_of_nonsense_is_refused_at_once(tmp_path, capfd, words, said):
    """Exit with 2 and one line, before anything is done."""
    assert cli.call([*words, "--out", str(tmp_path / "out")]) == 2
    assert said in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_message_does_not_steer_the_terminal(tmp_path, capfd):
    """Print what a file says without its control signs, and no more than a page of it."""
    (tmp_path / "run.json").write_text(json.dumps({"spec": {"\x1b[31m" + "x" * 9999: 1}}))
    assert cli.call(["eval", str(tmp_path)]) == 1
    said = capfd.readouterr().err
    assert "\x1b" not in said
    assert len(said) < 1500


def test_a_sweep_of_too_many_cells_is_refused(tmp_path, capfd):
    """Count the cells before they are made."""
    (tmp_path / "a.yaml").write_text(
        f"grid: {{backend: [mujoco], task: [line], seed: {list(range(9000))}}}\n"
    )
    assert cli.call(["sweep", str(tmp_path / "a.yaml"), "--dry-run"]) == 2
    assert "9000 cells; allowed: up to 5000" in capfd.readouterr().err
