"""`python -m tests.campaign --inputs --n 1000 --seed 1`: spoil inputs, or kill commands, and count.

With `--out TABLE` every case is counted in a table at once; the same command goes on where it was
ended. A case is given by its kind, seed and number, so `--only KIND --case NUMBER` repeats it.
"""

import argparse
import importlib
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from tests.campaign.table import Table


def main() -> int:
    """Run the cases that are asked for; 1 if something happened that must not."""
    asked = _asked()
    part = importlib.import_module(f"tests.campaign.{asked.part}")
    table, faults = Table(asked.out), 0
    names = _names(asked, part)
    if asked.again:
        for name in names:
            table.forget(asked.part, name, asked.seed)
    with tempfile.TemporaryDirectory(prefix="campaign-") as place:
        shelf = Path(place)
        for name, number in _wanted(asked, part, names, shelf):
            if number < table.cases(asked.part, name, asked.seed) and asked.case is None:
                continue
            began = time.monotonic()
            if asked.every:
                case = part.at_operation(name, number, shelf)
            else:
                case = part.case(name, asked.seed, number, shelf)
            table.add(case)
            faults += bool(case.fault)
            said = f"{case.fault or 'good'}; {case.said}; {time.monotonic() - began:.1f} s"
            print(f"{name} {number}: {said}", flush=True)
    print(table.show())
    return int(faults > 0)


PARTS = ("inputs", "kills")


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    part = parser.add_mutually_exclusive_group(required=True)
    for name in PARTS:
        part.add_argument(f"--{name}", action="store_const", dest="part", const=name)
    parser.add_argument("--n", type=int, default=100, help="number of cases")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", help="this kind alone; repeatable")
    parser.add_argument("--quick", action="store_true", help="the quickest kinds alone")
    parser.add_argument("--case", type=int, help="the number of one case, to repeat it")
    parser.add_argument("--out", type=Path, help="CSV file with the table")
    parser.add_argument("--again", action="store_true", help="forget what it says of these kinds")
    parser.add_argument("--every", action="store_true", help="one kill at each operation in turn")
    asked = parser.parse_args()
    if asked.every and asked.part != "kills":
        parser.error("--every goes with --kills")
    asked.seed = 0 if asked.every else asked.seed
    return asked


def _names(asked: argparse.Namespace, part: ModuleType) -> list[str]:
    """Kinds in turn."""
    names = [name for name in part.TURNS if name in (asked.only or part.TURNS)]
    names = [name for name in names if not asked.quick or name in part.QUICK]
    if not names:
        sys.exit(f"no kind {asked.only}; known: {', '.join(part.KINDS)}")
    return names


def _wanted(
    asked: argparse.Namespace, part: ModuleType, names: list[str], shelf: Path
) -> Iterator[tuple[str, int]]:
    """Kinds, and which case of theirs."""
    if asked.case is not None:
        yield names[0], asked.case
    elif asked.every:
        for name in dict.fromkeys(names):
            yield from ((name, number) for number in range(part.operations(name, shelf)))
    else:
        had = dict.fromkeys(names, 0)
        for k in range(asked.n):
            name = names[k % len(names)]
            yield name, had[name]
            had[name] += 1


if __name__ == "__main__":
    sys.exit(main())
