"""`bench blind`: make hidden cases, solve them from their logs alone, and score the results."""

import hashlib
import secrets
import shutil
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import joblib
from rich.table import Table

from backends.catalogue import catalogue
from backends.effect import Effect
from backends.engine import Engine, Simulator
from backends.shard import simulate
from backends.spec import Spec
from benchmark.console import Bar
from benchmark.errors import CommandError, UsageError, unknown
from benchmark.parts import registry
from benchmark.parts.extras import install_command
from benchmark.provenance import usable_cores
from diagnosis.blind import binding, draw, faults, files, frozen, motion, rigs, solving
from diagnosis.blind.apart import Grasps
from diagnosis.blind.files import BlindError, BlindSet
from diagnosis.blind.grasp import GRASP, HOLDS, PULL
from diagnosis.blind.make import write_case, write_sound
from diagnosis.blind.sides import ENGINES, PLANTS, STICKLESS, TUNED, carries, engine, mechanics
from files.atomic import write_atomically

KEPT_APART = tuple(name for name in STICKLESS if name not in TUNED)
"""Real sides on which no solver may be tuned; only sets that name them contain them."""
FEWEST_EFFECTS = 3
"""Smallest number of effects: a pair, and another one to remove from the catalogue."""
SECRET_BITS = 128


def settings(
    cases: int,
    real: str,
    rig: str,
    modes: str,
    effects: str,
    protocols: str,
    fewest: int = FEWEST_EFFECTS,
    healthy: int = 0,
    times: tuple[float, float] = draw.TIMES,
) -> draw.Settings:
    """The settings of these options; raises UsageError."""
    places = _rigs(rig)
    holding, drawn = places[0] in rigs.HOLDING, set(rigs.members(places)) <= set(rigs.ARMS)
    free = faults.of_arms() if drawn else faults.in_free_air()
    every = faults.in_hand() if holding else free
    named = (*every, *free) if holding else every
    chosen = every if effects == "all" else _words("effect", effects, named)
    if len(chosen) < fewest:
        raise UsageError(f"--hidden-effects names {len(chosen)}; allowed: {fewest} or more, 'all'")
    moved = _words("protocol", protocols, (*motion.PROTOCOLS, *tuple(HOLDS) * holding))
    if holding and GRASP not in moved:
        raise UsageError(f"--protocol has no '{GRASP}', in which the stick is held; add it")
    return draw.Settings(
        cases=cases,
        reals=_reals(real, places),
        rigs=places,
        modes=_words("mode", modes, tuple(draw.SHARES)),
        effects=chosen,
        protocols=moved,
        channels=(draw.HELD_CHANNELS if holding else draw.ARM_CHANNELS if drawn else draw.CHANNELS),
        healthy=healthy,
        times=times,
    )


def _rigs(text: str) -> tuple[str, ...]:
    """Rigs in free air ('all': all of these), or one that holds the stick."""
    if text == "all":
        return tuple(rigs.FREE)
    places = _words("rig", text, (*rigs.RIGS, *rigs.DRAWN))
    if len(places) > 1 and set(places) & set(rigs.HOLDING):
        raise UsageError(
            f"--rig {text} mixes free air and held stick, which have other effects and protocols; "
            f"make one set of {', '.join(rigs.FREE)}, and another of {', '.join(rigs.HOLDING)}"
        )
    if 0 < len(set(rigs.members(places)) & set(rigs.ARMS)) < len(rigs.members(places)):
        raise UsageError(
            f"--rig {text} mixes arms, which are drawn, and rigs that are always the same; make "
            f"one set of {', '.join(rigs.DRAWN)}, and another of {', '.join(rigs.FREE)}"
        )
    return places


def _reals(text: str, places: Sequence[str]) -> tuple[str, ...]:
    """Real sides; 'all' are those that can carry the rigs, without those that must be named."""
    engines, holding = registry.names("backend"), places[0] in rigs.HOLDING
    if holding and set(STICKLESS) & set(text.split(",")):
        raise UsageError(
            f"--real {text}: {', '.join(STICKLESS)} have joints alone and no contacts, so they "
            f"cannot hold a stick; known: {', '.join(engines)}, or all"
        )
    known = engines if holding else (*engines, *STICKLESS)
    if text == "all":
        named = {*engines} - {*registry.usual("backend")}
        some = (real for real in known if real not in named and real not in KEPT_APART)
        return tuple(real for real in some if _carries(real, places))
    chosen = _words("real side", text, known)
    if weak := [real for real in chosen if not _carries(real, places)]:
        able = [real for real in known if real not in weak and _carries(real, places)]
        raise UsageError(
            f"--real {', '.join(weak)} cannot move --rig {','.join(places)}: its equations are of "
            f"one or two parallel hinges; known: {', '.join(able)}, or all"
        )
    return chosen


def _carries(real: str, places: Sequence[str]) -> bool:
    """Whether a real side moves all rigs of these names; those that are not drawn, all do."""
    return all(carries(real, rigs.nominal(arm)) for arm in rigs.arms_of(places))


def make(
    wanted: draw.Settings, seed: int | None, out: Path, answers: Path, workers: int | None
) -> dict[str, Any]:
    """Draw the cases, write their logs to `out` and the answers to `answers`.

    The set is drawn in a folder beside `out` and renamed when it is whole. What a killed call left
    there, with the answers that only it knew, is removed: nobody has seen them.
    """
    part = out.resolve().with_name(f".{out.resolve().name}.part")
    _check_places(out, answers, part)
    seed = secrets.randbits(SECRET_BITS) if seed is None else seed
    for real in wanted.reals:
        _load_real(real)
    cases = _sized(draw.draw(wanted, seed), wanted, seed, workers)
    if _left_by(part, answers):
        answers.unlink()
    shutil.rmtree(part, ignore_errors=True)
    promised = _write(BlindSet(path=part), cases, wanted, seed, answers, workers)
    part.rename(out)
    return {"status": "done", "dir": str(out), "answers": str(answers), **_promise(promised)}


def _left_by(part: Path, answers: Path) -> bool:
    """Whether the answers are those of a set that was drawn whole, but never renamed."""
    blind = BlindSet(path=part)
    try:
        sealed = hashlib.sha256(answers.read_bytes()).hexdigest()
        return blind.commitment().answers_sha256 == sealed
    except (BlindError, OSError):
        return False


def _write(
    blind: BlindSet,
    cases: tuple[draw.Case, ...],
    wanted: draw.Settings,
    seed: int,
    answers: Path,
    workers: int | None,
) -> files.Commitment:
    """Write the logs of a set, its commitment, and last the answers."""
    sound = draw.sound(wanted, cases, seed)
    makes = {make: number for number, make in enumerate(sound) if wanted.healthy}
    _each("make", _make_one, [(blind, case, seed, makes.get(case.make)) for case in cases], workers)
    logs = [
        (blind.healthy(makes[make]) / str(case.number), case, seed)
        for make, some in sound.items()
        for case in some
    ]
    _each("sound", _sound_one, logs, workers)
    text = files.seal(wanted, seed, cases)
    promised = frozen.commitment(blind, hashlib.sha256(text.encode()).hexdigest(), len(cases))
    blind.commit(promised)
    answers.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(answers, text)
    return promised


def _promise(promised: files.Commitment) -> dict[str, Any]:
    return {
        "cases": promised.cases,
        "answers_sha256": promised.answers_sha256,
        "solver_sha256": promised.solver_sha256,
    }


def commit(folder: Path) -> dict[str, Any]:
    """Commit a set on which no solver was run to the solver as it is now."""
    blind = BlindSet(path=folder)
    before = _checked(blind.commitment)
    if tried := blind.tried():
        raise UsageError(
            f"{len(tried)} solvers were run on {folder}, the first at {tried[0]['time']}; only a "
            "set that nothing was solved on can be committed to another solver: make a new one"
        )
    for number, digest in before.logs_sha256.items():
        if blind.log_sha256(int(number)) != digest:
            raise UsageError(
                f"the log of case {number} in {folder} was changed; make the set again"
            )
    promised = frozen.commitment(blind, before.answers_sha256, before.cases)
    blind.commit(promised)
    return {"status": "done", "dir": str(folder), **_promise(promised)}


def _sized(
    cases: tuple[draw.Case, ...], wanted: draw.Settings, seed: int, workers: int | None
) -> tuple[draw.Case, ...]:
    """The cases; those of drawn robots get faults of the size that the settings ask for."""
    if rigs.robot(cases[0].rig) is None:
        return cases
    tasks = [(case, wanted, seed) for case in cases]
    return tuple(_checked(lambda: _each("size", _size_one, tasks, workers)))


def _load_real(name: str) -> None:
    """Raise CommandError if a package that a real side needs is missing."""
    load: Callable[[str], object] = mechanics if name in PLANTS else _engine
    try:
        load(name)
    except ImportError as error:
        raise CommandError(
            f"real side '{name}' cannot be loaded: {error}; install what it needs with: "
            f"{install_command('diagnosis.blind')}, or choose another --real"
        ) from error


def run(folder: Path, workers: int | None, anyway: bool) -> dict[str, Any]:
    """Solve the cases that this solver has not solved yet; returns what became of them."""
    blind = BlindSet(path=folder)
    promised = _checked(blind.commitment)
    changed = frozen.changed(promised)
    if changed and not anyway:
        raise UsageError(
            f"the solver does not fit the commitment of {folder}: {', '.join(changed[:5])}"
            f"{' and more' if len(changed) > 5 else ''} changed; go back to the old solver, or "
            "give --anyway: then the score counts as a tuning set"
        )
    solver = frozen.solver_sha256()
    blind.note_try(solver)
    waiting = [n for n in blind.numbers if not _is_done(blind, n, solver)]
    _each("solve", _solve_one, [(blind, number) for number in waiting], workers)
    said = {f"{n:03d}": blind.read_result(n) or {} for n in blind.numbers}
    refused = {number: one["refused"] for number, one in said.items() if one.get("refused")}
    return {
        "status": "done",
        "dir": str(folder),
        "cases": len(blind.numbers),
        "was_done": len(blind.numbers) - len(waiting),
        "solved": len(waiting),
        "refused": refused,
        "frozen": not changed,
        "solver_sha256": solver,
    }


def score(
    sets: Sequence[tuple[Path, Path]], out: Path | None, workers: int | None, replay: int = 0
) -> tuple[dict, Table]:
    """Open the answers of sets and score them together; writes the tables to `out` if given.

    `replay`: so many cases of each set, drawn at random, are solved again and compared first.
    """
    from diagnosis.blind import score as scoring

    pairs = [(BlindSet(path=folder), answers) for folder, answers in sets]
    replayed = sum(_checked(partial(_replayed, blind, replay)) for blind, _ in pairs)

    def consult(blind: BlindSet, opened: files.Answers) -> list:
        tasks = [(blind, case, opened.seed) for case in opened.cases]
        return _each("oracle", _consult_one, tasks, workers)

    found = _checked(lambda: scoring.score(pairs, consult, replayed))
    written = scoring.write(found, out) if out is not None else []
    table = Table("figure", "value", "95 % interval", "count", "meaning", header_style="bold")
    for row in scoring.headline(found).to_dict("records"):
        ends = f"{row['low']:.3g} to {row['high']:.3g}" if row["count"] else ""
        value = f"{row['value']:.3g}" if row["count"] else "-"
        table.add_row(row["figure"], value, ends, str(row["count"]), row["meaning"])
    return {"status": "done", **found.plain(), "written": [str(file) for file in written]}, table


def _replayed(blind: BlindSet, count: int) -> int:
    """How many cases of a set were solved again; raises BlindError where one says otherwise."""
    binding.checked(blind)
    again = partial(solving.solved, blind, solve=solving.solver(_nominal_engine))
    return len(binding.replay(blind, count, again))


def calibrate(sets: Sequence[tuple[Path, Path]], out: Path) -> tuple[dict[str, Any], Table]:
    """Fit the curve of confidence on solved sets and their answers; write it to the file `out`.

    The table holds confidence against shares right, each real side by the curve of the others.
    """
    from diagnosis.blind import calibrate as fitting

    pairs = [(BlindSet(path=folder), answers) for folder, answers in sets]
    rows = _checked(lambda: fitting.rows(pairs))
    try:
        found = fitting.calibrate(rows)
    except ValueError as error:
        raise UsageError(str(error)) from error
    files.write_json(out, found.curve)
    table = Table("of", "cases", "confidence", "right", "excess", header_style="bold")
    bins = found.table.to_dict("records")
    for row in bins:
        shown = (f"{row[name]:.3f}" for name in ("confidence", "right", "excess"))
        table.add_row(row["of"], str(row["cases"]), *shown)
    return {"status": "done", "curve": found.curve, "bins": bins, "written": [str(out)]}, table


def detectable(
    wanted: draw.Settings, draws: int, seed: int, out: Path, workers: int | None
) -> tuple[dict[str, Any], Table]:
    """Search the smallest detectable magnitudes and write them to `out`, as CSV and Markdown."""
    from diagnosis.blind import detectable as searching

    held, kinds = not set(rigs.HOLDING).isdisjoint(wanted.rigs), catalogue()
    if wrong := [e for e in wanted.effects if held and not kinds[e].shows_in_hand()]:
        raise UsageError(
            f"--hidden-effects {','.join(wrong)}: no grasp is asked for these; say --rig "
            f"{' or '.join(rigs.FREE)}, or name of {', '.join(faults.in_hand())}"
        )
    searches = [
        searching.Search(
            effect=effect,
            real=real,
            rig=rig,
            protocol=protocol,
            channels=channels,
            draws=draws,
            seed=seed,
        )
        for rig in wanted.rigs
        for effect in wanted.effects
        for real in wanted.reals
        for protocol in (_held(kinds[effect]) if held else wanted.protocols)
        for channels in _searched(kinds[effect])
    ]
    rows = _each("search", _search_one, [(one,) for one in searches], workers)
    written = searching.write(rows, out)
    shown = searching.table(rows)
    table = Table(*map(str, shown.columns), header_style="bold")
    for row in shown.itertuples(index=False):
        table.add_row(*map(str, row))
    result = {"status": "done", "rows": rows, "written": [str(file) for file in written]}
    return result, table


def _held(kind: type[Effect]) -> tuple[str, ...]:
    """The protocols to search an effect of touch, stick or contact in."""
    return (GRASP, PULL) if kind.slips else (GRASP,)


def _searched(kind: type[Effect]) -> tuple[tuple[str, ...], ...]:
    """The channels to search an effect in: of what skin reads each kind, else one of them."""
    if not kind.shows_in_hand():
        return draw.CHANNELS[:1]
    return draw.HELD_CHANNELS[1:] if kind.is_of("taxels") else draw.HELD_CHANNELS[1:2]


def _search_one(search: Any) -> dict:
    from diagnosis.blind.detectable import smallest

    return smallest(search, _start, registry.usual("backend"))


def _size_one(case: draw.Case, wanted: draw.Settings, seed: int) -> draw.Case:
    from diagnosis.blind.sizing import sized

    try:
        return sized(case, wanted.times, wanted.effects, _start, seed)
    except ValueError as error:
        raise BlindError(str(error)) from error


def _make_one(blind: BlindSet, case: draw.Case, seed: int, make: int | None) -> None:
    write_case(blind, case, _start, seed, make)


def _sound_one(folder: Path, case: draw.Case, seed: int) -> None:
    write_sound(folder, case, _start, seed)


def _solve_one(blind: BlindSet, number: int) -> None:
    solving.solve_case(blind, number, solving.solver(_nominal_engine))


def _nominal_engine(specs: Sequence[Spec]) -> Simulator:
    return _start(frozen.ENGINE, specs)


def _consult_one(blind: BlindSet, case: draw.Case, seed: int) -> Any:
    from diagnosis.blind.oracle import consult

    def apart(fault: faults.Fault) -> float:
        grasps = Grasps(case=case, simulate=_start, seed=seed)
        return grasps.apart_nats(fault, registry.usual("backend"))

    return consult(case, blind.log(case.number), apart)


def _start(name: str, specs: Sequence[Spec]) -> Simulator:
    return simulate(_engine(name), specs, 1)


def _engine(name: str) -> type[Engine]:
    """A backend, or an engine that is only a real side."""
    return engine(name) if name in ENGINES else registry.load("backend", name)


def _each(what: str, work: Callable, tasks: Sequence[tuple], workers: int | None) -> list:
    """The results of the tasks in order, one core per task."""
    if not tasks:
        return []
    parallel = joblib.Parallel(n_jobs=workers or usable_cores(), return_as="generator")
    found = []
    with Bar(what, len(tasks)) as bar:
        results: Iterable = parallel(joblib.delayed(work)(*task) for task in tasks)
        for done, result in enumerate(results):
            found.append(result)
            bar.update(done + 1)
    return found


def _is_done(blind: BlindSet, number: int, solver: str) -> bool:
    """Whether this version of the solver has solved a case."""
    said = _checked(lambda: blind.read_result(number))
    return said is not None and said.get("solver_sha256") == solver


def _checked(ask: Callable) -> Any:
    """The result of `ask`; a BlindError becomes a UsageError."""
    try:
        return ask()
    except BlindError as error:
        raise UsageError(str(error)) from error


def _check_places(out: Path, answers: Path, part: Path) -> None:
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError(f"{out} exists and is not empty; choose another folder or remove it first")
    if out.resolve() in answers.resolve().parents or out.resolve() == answers.resolve():
        raise UsageError(f"--answers {answers} is in --out {out}; put it where no solver sees it")
    if answers.exists() and not _left_by(part, answers):
        raise UsageError(
            f"{answers} exists; choose another file, because sealed answers are never replaced"
        )


def _words(kind: str, text: str, known: tuple[str, ...]) -> tuple[str, ...]:
    """The names between commas ('all': all of them); raises UsageError."""
    if text == "all":
        return known
    names = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
    for name in names:
        if name not in known:
            raise unknown(kind, name, known)
    if not names:
        raise UsageError(f"no {kind} is given; known: {', '.join(known)}, or all")
    return names
