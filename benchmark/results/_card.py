"""The model card of a policy: what it is, how it was made, what it reached, how to use it."""

from typing import Any

_CARD = """\
# {name}

A policy that moves the joints of a three-finger tactile hand so that the lower end of a slender
stick draws {figure}.
Trained and evaluated in simulation alone; it has moved no real hand.

| | |
|---|---|
| Trained in | {backend}, effects `{effects}`, {stick} stick, {drawn} |
| Learner | {algo}, {steps:,} environment steps, seed {seed}, {minutes:.0f} min on {cpu} |
| Observation | `{observation}`: {inputs} |
| Action | {action}, at 50 Hz, of {joints} |
| Reached | tracked {tracked:.3f}, held {held:.3f}, {p_err_cm:.2f} cm, {q_err_deg:.2f} deg over \
{episodes} fixed episodes in its own world |
| Made by | `{command}` at commit {commit} |
| With | {versions} |

`tracked` is the fraction of all steps with the stick held, its lower end within 1.0 cm and its axis
within 5 degrees. In other worlds the policy does worse, often much: see the transfer tables.

    bench eval leaderboard/policies/{name}
    bench view leaderboard/policies/{name} --out paths.png

`policy.onnx` takes the observation of `contract.json` (order, units, scale), shape (N, {width}),
and gives actions in [-1, 1], shape (N, {outputs}); a full action moves a target by 0.015 rad.
`episodes.parquet` has the scores of every episode, `progress.csv` the learning curve.
"""


def card(row: dict[str, Any], contract: dict[str, Any], name: str) -> str:
    """The card of the policy of a finished run, as Markdown."""
    spec, made = row["spec"], row["provenance"]
    parts = contract["observation"]
    return _CARD.format(
        name=name,
        figure=_figure(spec),
        drawn=f"worlds drawn around it ({spec['spread']})" if spec["randomize"] else "that alone",
        inputs=", ".join(f"{p['name']} ({p['width']})" for p in parts),
        width=sum(p["width"] for p in parts),
        outputs=contract["action"]["width"],
        action=contract["action"]["name"].replace("_", " "),
        joints=", ".join(contract["joints"]),
        minutes=row["wall_s"] / 60,
        versions=", ".join(f"{k} {v}" for k, v in sorted(made["versions"].items())),
        **{k: spec[k] for k in ("backend", "effects", "stick", "algo", "steps", "seed")},
        **{k: made[k] for k in ("cpu", "command", "commit")},
        **row["scores"],
        observation=spec["observation"],
    )


def _figure(spec: dict[str, Any]) -> str:
    article = "an" if spec["task"] == "eight" else "a"
    size = f"{spec['radius_m'] * 100:g} cm at {spec['speed']:g} times the usual pace"
    return f"{article} {spec['task']} of {size}"
