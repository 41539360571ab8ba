"""Keep finished runs in the repository: their rows, and their policies with a model card."""

import json
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from baselines.saved import CONTRACT_FILE, POLICY_FILE
from benchmark.errors import CommandError
from benchmark.results._card import card
from benchmark.runs import run_folder
from benchmark.runs.run_folder import EPISODES_FILE, PROGRESS_FILE, RUN_FILE
from leaderboard.details import DetailsError, kept_text, read_details
from leaderboard.row import without_place

CARD_FILE = "README.md"


def keep_rows(sources: Iterable[Path], results: Path) -> None:
    """Copy the row of every finished run that is no smoke run into the folder of kept rows."""
    results.mkdir(parents=True, exist_ok=True)
    for folder, row in _finished(sources):
        try:
            details = read_details(folder)
        except DetailsError as error:
            raise CommandError(str(error)) from error
        kept = results / f"{run_folder.run_spec(row).name}.json"
        run_folder.write_atomically(kept, kept_text(row, details))


def keep_policies(sources: Iterable[Path], policies: Path) -> list[str]:
    """Copy every finished policy with contract, episodes and model card; returns the names."""
    names = []
    for folder, row in _finished(sources):
        if row["policy_sha256"] is None:
            continue
        run_folder.check_policy(folder, row)
        kept = policies / run_folder.run_spec(row).name
        kept.mkdir(parents=True, exist_ok=True)
        for name in (POLICY_FILE, CONTRACT_FILE, EPISODES_FILE, PROGRESS_FILE):
            shutil.copyfile(folder / name, kept / name)
        contract = json.loads((folder / CONTRACT_FILE).read_text())
        run_folder.write_atomically(kept / CARD_FILE, card(row, contract, kept.name))
        run_folder.write_atomically(kept / RUN_FILE, json.dumps(row, indent=2) + "\n")
        names.append(kept.name)
    return names


def _finished(sources: Iterable[Path]) -> Iterator[tuple[Path, dict]]:
    """Folders of finished runs, no smoke runs, and their run.json without its location."""
    for source in sources:
        for file in sorted(source.rglob(RUN_FILE)):
            row = run_folder.read_run(file.parent)
            if row["status"] == "done" and not row["spec"]["smoke"]:
                command = without_place(row["provenance"]["command"])
                row["provenance"] |= {"command": command}
                yield file.parent, row
