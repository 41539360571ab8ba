"""The main job: same seed same row, kill and resume, and folders that are not as they should be."""

import dataclasses
import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import onnxruntime
import pandas as pd
import pytest
import torch
from smoke import SMOKE

from backends import trx
from baselines.ppo import Deployed, export_onnx, read_trained
from baselines.saved import PolicyError, SavedPolicy
from benchmark.cli import app as cli
from benchmark.parts import registry
from benchmark.parts.registry import ROOT
from benchmark.runs.run import run
from benchmark.runs.run_folder import RunFolder
from benchmark.runs.train import converged
from benchmark.settings.run_spec import RunSpec
from leaderboard.identity import EPISODES
from leaderboard.row import Row

SCORES = ("p_err_cm", "q_err_deg", "held", "tracked")
CIRCLE = "mujoco-circle-sb3-ppo-contact-centers-s0-43bbd86c"
BENCH = [sys.executable, "-c", "from benchmark.cli.app import main; main()"]


def scores(row: dict) -> list[float]:
    """What must be equal when two runs are."""
    return [row[name] for name in SCORES]


@pytest.fixture
def run_copy(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished folder, free to be damaged."""
    target = tmp_path / "copy"
    target.mkdir()
    for file in finished.iterdir():
        (target / file.name).write_bytes(file.read_bytes())
    return target


def test_run_folder_is_complete(finished):
    """Write run.json, learning curve, episodes, policy and contract, and nothing half done."""
    names = {file.name for file in finished.iterdir()}
    expected = {"run.json", "progress.csv", "episodes.parquet", "policy.onnx", "contract.json"}
    assert names == expected
    run = json.loads((finished / "run.json").read_text())
    assert run["status"] == "done"
    assert run["spec"]["smoke"]
    assert {"command", "versions", "cpu", "commit"} <= run["provenance"].keys()
    episodes = pd.read_parquet(finished / "episodes.parquet")
    assert len(episodes) == run["scores"]["episodes"]
    for name in SCORES:
        assert run["scores"][name] == pytest.approx(episodes[name].mean())
    curve = pd.read_csv(finished / "progress.csv")
    assert curve["steps"].iloc[-1] == run["steps"]


def test_a_segment_leaves_no_logs_elsewhere(finished):
    """Keep the learner from making a folder of its own among temporary ones."""
    assert not list((finished.parent / "elsewhere").glob("SB3-*"))


def test_a_finished_run_is_not_run_again(finished, capfd):
    """Print the row of a finished run and say so under -q; leave all but what a late kill left."""
    before = {file.name: file.stat().st_mtime_ns for file in finished.iterdir()}
    (finished / "checkpoint-2.pt").touch()
    assert cli.call([*SMOKE, "--backend", "mujoco", "--out", str(finished), "-q"]) == 0
    said = capfd.readouterr()
    assert json.loads(said.out)["status"] == "done"
    assert "is finished already" in said.err
    assert before == {file.name: file.stat().st_mtime_ns for file in finished.iterdir()}


def test_a_folder_left_without_its_file_is_recovered(run_copy, capfd):
    """Take up with --force or --resume what a kill within --force left, and not unasked."""
    words = [*SMOKE, "--backend", "mujoco", "--algo", "hold-still", "--out", str(run_copy)]
    (run_copy / "run.json").unlink()
    (run_copy / ".run.json.tmp").write_text("{")
    assert cli.call(words) == 2
    assert "--force starts it again" in capfd.readouterr().err
    assert cli.call([*words, "--resume"]) == 0
    assert not (run_copy / "policy.onnx").exists()
    assert not (run_copy / ".run.json.tmp").exists()


def test_a_kill_within_force_leaves_a_run_that_resumes(run_copy, monkeypatch, capfd):
    """Say that the run is interrupted before anything of the finished one goes."""
    words = [*SMOKE, "--backend", "mujoco", "--algo", "hold-still", "--out", str(run_copy)]

    def dies(folder):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "_clear", dies)
        assert cli.call([*words, "--force"]) == 130
    (run_copy / ".progress.csv.tmp").touch()
    assert cli.call([*words, "--resume"]) == 0
    capfd.readouterr()
    assert {file.name for file in run_copy.iterdir()} == {"run.json", "episodes.parquet"}


def test_a_curve_converges_when_it_rises_no_more():
    """Go on while it rises, and end on a plateau, noisy or not."""
    step, noise = np.arange(300), np.random.default_rng(0).normal(0.0, 0.02, 300)
    rising, plateau = step / 300, np.minimum(step / 60, 1.0)
    assert not any(converged((rising + noise)[:k]) for k in range(1, 301))
    assert not converged(plateau[:60]) and converged(plateau) and converged(plateau + noise)


def test_training_ends_where_its_curve_has_converged(tmp_path):
    """Train for less than the budget, to the first checkpoint whose curve has, as a valid row."""
    short = {"rollout_steps": 2, "epochs": 1, "minibatches": 1}
    spec = RunSpec(
        **{"backend": "mujoco", "task": "line", "worlds": 8, "steps": 16_000},
        **{"smoke": True, "until": "converged", "overrides": short},
    )
    row = Row.model_validate(run(spec, tmp_path / "run", workers=1))
    rewards = list(pd.read_csv(tmp_path / "run" / "progress.csv")["reward"])
    assert row.steps == 16 * len(rewards) < spec.steps
    assert converged(rewards) and not any(converged(rewards[:k]) for k in range(len(rewards)))
    assert row.spec.learner.endswith("until converged")


def test_a_second_run_in_a_folder_is_refused(tmp_path, capfd):
    """Say that another process runs there, and do not advise --force."""
    folder = RunFolder(tmp_path / "run", RunSpec(backend="mujoco", task="line", smoke=True))
    folder.claim(resume=False, force=False)
    words = [*SMOKE, "--backend", "mujoco", "--out", str(tmp_path / "run"), "--force"]
    assert cli.call(words) == 2
    said = capfd.readouterr().err
    assert "another process runs in" in said
    assert "--force" not in said


def test_interrupt_exits_130_and_keeps_the_folder(tmp_path, capfd):
    """Stop at Ctrl-C with one message, exit code 130, and a folder that says interrupted."""
    folder = tmp_path / "run"
    process = subprocess.Popen(
        [*BENCH, *SMOKE, "--backend", "mujoco", "--out", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A suite that runs in the background is told to ignore Ctrl-C, and its children with it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 100
    while not list(folder.glob("checkpoint-*.pt")) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    assert process.returncode == 130, err
    assert "--resume" in err
    assert "Traceback" not in err
    assert json.loads(out)["status"] == "interrupted"
    assert json.loads((folder / "run.json").read_text())["status"] == "interrupted"
    assert cli.call([*SMOKE, "--backend", "mujoco", "--out", str(folder)]) == 2
    assert "--resume continues it" in capfd.readouterr().err


def test_eval_reproduces_the_row_and_needs_no_torch(finished):
    """Give the run's own scores again, from ONNX alone."""
    code = "import sys; sys.modules['torch'] = None\nfrom benchmark.cli.app import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "eval", str(finished), "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    run = json.loads((finished / "run.json").read_text())
    assert scores(json.loads(done.stdout)) == scores(run["scores"])


def test_eval_changes_world_task_and_stick(finished, tmp_path, capfd):
    """Deploy in another engine, figure, setting, stick and effects, and write it down."""
    out = tmp_path / "eval"
    options = ["--task", "eight", "--radius", "3cm", "--pace", "1.5", "--stick", "fabric"]
    options += ["--effects", "backlash=2deg", "--backend", "bullet", "--workers", "1"]
    assert cli.call(["eval", str(finished), *options, "--json", "--out", str(out)]) == 0
    row = json.loads(capfd.readouterr().out)
    assert (row["backend"], row["task"], row["stick"]) == ("bullet", "eight", "fabric")
    assert row["radius_m"] == pytest.approx(0.03)
    assert json.loads((out / "eval.json").read_text())["tracked"] == row["tracked"]
    assert row["written"] == [str(out / "episodes.parquet"), str(out / "eval.json")]


def test_eval_takes_fewer_episodes_and_says_what_it_keeps(finished, capfd):
    """Evaluate the first of the fixed episodes alone, and say that nothing is written."""
    assert cli.call(["eval", str(finished), "--episodes", "2", "--json"]) == 0
    row = json.loads(capfd.readouterr().out)
    assert row["episodes"] == 2 and row["written"] == []
    assert cli.call(["eval", str(finished), "--episodes", "2"]) == 0
    assert "Wrote nothing; --out FOLDER keeps" in " ".join(capfd.readouterr().out.split())


def test_an_exported_policy_acts_as_the_network_does(tmp_path):
    """Give the actions of the normalised, clipped network for any batch; refuse other layers."""
    torch.manual_seed(0)
    linear = [torch.nn.Linear(*widths) for widths in ((5, 8), (8, 8), (8, 2))]
    bend = torch.nn.ELU()
    network = torch.nn.Sequential(torch.nn.Sequential(linear[0], bend, linear[1], bend), linear[2])
    mean, std = torch.arange(5.0), torch.arange(1.0, 6.0)
    export_onnx(Deployed(mean=mean, std=std, clip=2.0, network=network), tmp_path / "policy.onnx")
    seen = 20 * torch.randn(300, 5)
    with torch.no_grad():
        normal = ((seen - mean) / std).clamp(-2, 2)
        expected = network(normal).clamp(-1, 1).numpy()
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    for rows in (1, 300):
        (acted,) = session.run(["action"], {"observation": seen[:rows].numpy()})
        np.testing.assert_allclose(acted, expected[:rows], atol=1e-6)
    foreign = Deployed(mean=mean, std=std, clip=2.0, network=network.append(torch.nn.Softsign()))
    with pytest.raises(TypeError, match="no Softsign"):
        export_onnx(foreign, tmp_path / "policy.onnx")


@pytest.mark.parametrize("algo", ["sb3-ppo", "rsl-ppo"])
def test_training_starts_from_a_saved_policy(algo, tmp_path, capfd):
    """Begin with the policy's own actions, whichever learner; a tiny learning rate keeps them."""
    start, tuned = ROOT / "leaderboard/policies" / CIRCLE, tmp_path / "tuned"
    words = [*SMOKE, "--backend", "mujoco", "--algo", algo, "--from", str(start)]
    words += ["--set", "lr=1e-12", "--set", "target_kl=1e9", "--steps", "512"]
    assert cli.call([*words, "--out", str(tuned)]) == 0
    rng, trained = np.random.default_rng(0), read_trained(start / "policy.onnx")
    seen = rng.normal(trained.mean, trained.std, (500, trained.mean.shape[1])).astype(np.float32)
    observation = registry.load("observation", "contact-centers")(trx.HAND)
    first, again = (SavedPolicy(folder, observation)(seen) for folder in (start, tuned))
    assert np.std(first) > 0.1
    assert np.abs(again - first).max() < 0.02
    kept = json.loads((tuned / "run.json").read_text())
    assert kept["spec"]["overrides"] == {"lr": 1e-12, "target_kl": 1e9}
    assert kept["hyperparameters"]["lr"] == 1e-12
    assert kept["hyperparameters"]["gamma"] == 0.99
    assert cli.call(["run", "--config", str(tuned / "run.json"), "--dry-run"]) == 2
    assert "give that run as --from RUN" in capfd.readouterr().err


def test_a_run_file_is_a_configuration(finished, tmp_path, capfd):
    """Repeat a run from its own run.json, and change one setting on the command line."""
    words = ["run", "--config", str(finished / "run.json"), "--workers", "2", "--json"]
    assert cli.call([*words, "--out", str(finished)]) == 0
    first = json.loads(capfd.readouterr().out)
    assert cli.call([*words, "--out", str(tmp_path / "other"), "--seed", "5", "--dry-run"]) == 0
    plan = json.loads(capfd.readouterr().out)["would_run"]
    assert plan["seed"] == 5
    assert {**plan, "seed": 0} == json.loads((finished / "run.json").read_text())["spec"]
    assert first["status"] == "done"


def test_settings_stand_in_a_yaml_file(tmp_path, capfd):
    """Read settings as they are typed, hyperparameters among them."""
    file = tmp_path / "run.yaml"
    file.write_text("backend: mujoco\ntask: line\nradius: 3cm\nset: {lr: 0.001}\n")
    words = ["run", "--config", str(file), "--dry-run", "--json", "--workers", "1"]
    assert cli.call(words) == 0
    plan = json.loads(capfd.readouterr().out)["would_run"]
    assert plan["radius_m"] == pytest.approx(0.03)
    assert plan["overrides"] == {"lr": 0.001}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "lr"], "allowed: KEY=VALUE"),
        (["--set", "lrr=1"], "Did you mean 'lr'?"),
        (["--set", "lr=-1"], "--set lr is -1; allowed: greater than 0"),
        (["--set", "lr=quick"], "--set lr is 'quick'"),
        (["--set", "lr=1", "--algo", "random"], "random does not learn"),
        (["--from", "absent"], "no run folder at absent"),
        (["--config", "absent.yaml"], "no file of settings at absent.yaml"),
    ],
)
def test_bad_learner_settings_are_refused(words, said, capfd):
    """Name the hyperparameter, the value and what is allowed."""
    assert cli.call(["run", "--backend", "mujoco", "--task", "line", *words]) == 2
    assert said in capfd.readouterr().err


def test_policy_and_observation_that_do_not_fit_are_refused(finished):
    """Name both layouts when a policy is asked to act on another observation."""
    pose = registry.load("observation", "pose")(trx.HAND)
    with pytest.raises(PolicyError) as refused:
        SavedPolicy(finished, pose)
    assert "contact_center (9)" in str(refused.value)
    assert "stick_axis (3)" in str(refused.value)


@pytest.mark.parametrize(
    ("file", "damage", "words"),
    [
        ("run.json", lambda b: b[: len(b) // 2], "is damaged"),
        ("run.json", lambda b: b.replace(b'"circle"', b'"cube"'), "no task named 'cube'"),
        ("run.json", lambda b: b.replace(b'"done"', b'"fine"'), "has status 'fine'"),
        ("run.json", lambda b: b.replace(b'"seed": 0', b'"seed": 1'), "digest does not fit"),
        ("policy.onnx", lambda b: b[:-100], "SHA-256 differs"),
        ("contract.json", lambda b: b[:-100], "cannot be read"),
        ("policy.onnx", None, "is missing"),
    ],
)
def test_damaged_folders_are_refused_and_left_alone(run_copy, file, damage, words, capfd):
    """Say what is wrong with a half-written or tampered folder, and change nothing in it."""
    path = run_copy / file
    if damage is None:
        path.unlink()
    else:
        path.write_bytes(damage(path.read_bytes()))
    before = {f.name: f.read_bytes() for f in run_copy.iterdir()}
    assert cli.call(["eval", str(run_copy)]) in (1, 2)
    err = capfd.readouterr().err
    assert words in err
    assert "Traceback" not in err
    assert before == {f.name: f.read_bytes() for f in run_copy.iterdir()}


def test_another_run_in_the_folder_is_not_overwritten(run_copy, capfd):
    """Refuse a folder that holds another run."""
    arguments = [*SMOKE, "--backend", "mujoco", "--seed", "7", "--out", str(run_copy)]
    assert cli.call(arguments) == 2
    assert "holds another run" in capfd.readouterr().err
    assert json.loads((run_copy / "run.json").read_text())["spec"]["seed"] == 0


def test_a_foreign_folder_is_not_overwritten(tmp_path, capfd):
    """Refuse a folder with other files in it, even with --force."""
    (tmp_path / "thesis.tex").write_text("years of work")
    arguments = [*SMOKE, "--backend", "mujoco", "--force", "--out", str(tmp_path)]
    assert cli.call(arguments) == 2
    assert "not a run folder" in capfd.readouterr().err
    assert (tmp_path / "thesis.tex").exists()


def test_a_damaged_checkpoint_is_refused(run_copy, capfd):
    """Name the checkpoint that cannot be read instead of starting anew in silence."""
    run = json.loads((run_copy / "run.json").read_text())
    (run_copy / "run.json").write_text(json.dumps(run | {"status": "interrupted"}))
    (run_copy / "checkpoint-2.pt").write_bytes(b"half a file")
    (run_copy / "policy.onnx").unlink()
    arguments = [*SMOKE, "--backend", "mujoco", "--resume", "--out", str(run_copy)]
    assert cli.call(arguments) == 1
    assert "checkpoint-2.pt cannot be read" in capfd.readouterr().err
    assert (run_copy / "checkpoint-2.pt").read_bytes() == b"half a file"


def test_leaderboard_lists_finished_runs(tmp_path, capfd):
    """Put a baseline's row on the board, from its run folder alone; keep no smoke run's."""
    run = tmp_path / "runs/still"
    arguments = [*SMOKE, "--backend", "mujoco", "--algo", "hold-still", "--out", str(run)]
    assert cli.call(arguments) == 0
    row = json.loads(capfd.readouterr().out)
    assert row["held"] > 0.98
    assert row["tracked"] < 0.2
    board = tmp_path / "board"
    words = ["leaderboard", str(tmp_path / "runs"), "--out", str(board), "--include-smoke"]
    assert cli.call([*words, "--add"]) == 0
    frame = pd.read_csv(board / "leaderboard.csv")
    assert frame["tracked"].iloc[0] == pytest.approx(row["tracked"])
    assert "hold-still" in (board / "leaderboard.md").read_text()
    assert not list((board / "results").glob("*.json"))


def test_leaderboard_counts_runs_that_are_not_done(tmp_path, capfd):
    """List an interrupted run as such instead of calling its file broken."""
    spec = RunSpec(backend="mujoco", task="line")
    assert RunFolder(tmp_path / "runs/late", spec).claim(resume=False, force=False) is None
    board = tmp_path / "board"
    assert cli.call(["leaderboard", str(tmp_path / "runs"), "--out", str(board), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["problems"] == []
    assert "1 interrupted" in (board / "leaderboard.md").read_text()


def test_a_policy_names_no_folder(finished: Path) -> None:
    """Export nothing of the machine that trained it."""
    assert str(ROOT).encode() not in (finished / "policy.onnx").read_bytes()


def test_a_kept_policy_acts_as_it_did_and_says_what_it_is(finished, tmp_path, capfd):
    """Ship a policy with contract, row and model card, from which it can be evaluated again."""
    real, run = tmp_path / "real", json.loads((finished / "run.json").read_text())
    shutil.copytree(finished, real)
    spec = RunSpec(**{**run["spec"], "smoke": False})
    row = {**run, "spec": dataclasses.asdict(spec), "digest": spec.digest}
    few = pd.read_parquet(real / "episodes.parquet")
    many = few.iloc[np.arange(EPISODES) % len(few)]
    many.to_parquet(real / "episodes.parquet", index=False)
    row["scores"] = {name: many[name].mean() for name in SCORES} | {"episodes": EPISODES}
    (real / "run.json").write_text(json.dumps(row))
    out = tmp_path / "board"
    words = ["leaderboard", str(real), "--out", str(out), "--policies", "--no-html", "--json"]
    assert cli.call(words) == 0
    found = json.loads(capfd.readouterr().out)
    (kept,) = (out / "policies").iterdir()
    assert found["policies"] == 1 and kept.name == spec.name
    card = (kept / "README.md").read_text()
    assert f"bench eval leaderboard/policies/{spec.name}" in card and "shape (N, 18)" in card
    assert str(tmp_path) not in card + (kept / "run.json").read_text()
    assert cli.call(["eval", str(kept), "--json", "--episodes", str(len(few))]) == 0
    again = json.loads(capfd.readouterr().out)
    assert scores(again) == pytest.approx([few[name].mean() for name in SCORES])


def test_training_is_logged_for_tensorboard(tmp_path, capfd):
    """Write the curve of progress.csv as events, and say how to open them."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    words = ["run", "--backend", "mujoco", "--task", "line", "--smoke", "--logger", "tensorboard"]
    assert cli.call([*words, "--steps", "600", "--out", str(tmp_path / "a")]) == 0
    assert f"tensorboard --logdir {tmp_path / 'a'}" in capfd.readouterr().out.replace("\n", "")
    events = EventAccumulator(str(tmp_path / "a" / "tensorboard")).Reload()
    curve = pd.read_csv(tmp_path / "a" / "progress.csv")
    logged = events.Scalars("train/reward")
    assert [one.step for one in logged] == curve["steps"].tolist()
    assert [one.value for one in logged] == pytest.approx(curve["reward"].tolist(), rel=1e-5)
    assert cli.call([*words[:-1], "wandb"]) == 2
