"""`python -m tests.campaign --inputs --n 1000 --seed 1`: spoil inputs, or kill commands, and count.

A case is given by its kind, seed and number, so `--only KIND --case NUMBER` repeats it.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.campaign import inputs, kills
from tests.campaign.table import Case, add, show
from tests.campaign.watch import HANG_S


def main() -> int:
    """Run the cases that are asked for; 1 if something happened that must not."""
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    part = parser.add_mutually_exclusive_group(required=True)
    part.add_argument("--inputs", action="store_const", dest="part", const=inputs)
    part.add_argument("--kills", action="store_const", dest="part", const=kills)
    parser.add_argument("--n", type=int, default=100, help="number of cases")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="one kind alone")
    parser.add_argument("--quick", action="store_true", help="the quickest kinds alone")
    parser.add_argument("--hang-s", type=float, default=HANG_S, help="longer is a hang [s]")
    parser.add_argument("--case", type=int, help="the number of one case, to repeat it")
    parser.add_argument("--out", type=Path, help="CSV file to which the table is added")
    asked = parser.parse_args()
    cases = list(_cases(asked))
    if asked.out is not None:
        add(cases, asked.out)
    print(show(cases))
    return int(any(case.fault for case in cases))


def _cases(asked: argparse.Namespace) -> list[Case]:
    numbers = range(asked.n) if asked.case is None else [asked.case]
    names = [name for name in asked.part.KINDS if name == (asked.only or name)]
    names = [name for name in names if not asked.quick or name in asked.part.QUICK]
    if not names:
        sys.exit(f"no kind '{asked.only}'; known: {', '.join(asked.part.KINDS)}")
    found = []
    with tempfile.TemporaryDirectory(prefix="campaign-") as shelf:
        for number in numbers:
            name = names[number % len(names)]
            case = asked.part.case(name, asked.seed, number, Path(shelf), asked.hang_s)
            found.append(case)
            if case.fault or asked.case is not None:
                print(f"{name} {number}: {case.fault or 'good'}; {case.said}", flush=True)
    return found


if __name__ == "__main__":
    sys.exit(main())
