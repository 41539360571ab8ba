"""All physics checks: of one engine alone, and against the reference engine."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from backends.engine import Engine
from benchmark.errors import CommandError
from benchmark.parts import registry
from benchmark.physics import contact, drive, free, grasp, parity, pinch, rigid, skin, slide
from benchmark.physics.check import Check, Compare, Measure
from benchmark.settings.run_spec import REFERENCE

ALONE: tuple[Measure, ...] = (
    rigid.tips,
    rigid.masses,
    rigid.gravity,
    rigid.swing,
    free.fall,
    free.pendulum,
    free.hand_energy,
    drive.step,
    drive.sag,
    drive.push_test,
    drive.self_lock,
    contact.rest,
    contact.landing,
    pinch.slip,
    pinch.spin,
    pinch.swing,
    slide.touch,
    slide.spin,
    skin.taxels,
    grasp.balance,
    grasp.slip,
    grasp.carry,
    grasp.steady,
    parity.floor,
)
BESIDE: tuple[Compare, ...] = (parity.response, parity.hold, parity.motion)


@dataclass(frozen=True, kw_only=True)
class Findings:
    """The results of the checks of one engine."""

    engine: str
    checks: tuple[Check, ...]
    trouble: str | None = None
    """The reason why the engine could not be checked."""

    @property
    def passed(self) -> bool:
        """Whether the engine works and every check passed."""
        return self.trouble is None and all(check.passed for check in self.checks)


def examine(names: Sequence[str], progress: Callable[[int, str], None]) -> list[Findings]:
    """Run all checks on these engines; `progress` gets the number of finished `steps`."""
    reference: type[Engine] = registry.load("backend", REFERENCE)
    found, done = [], 0
    for name in names:
        try:
            engine: type[Engine] = registry.load("backend", name)
        except CommandError as error:
            found.append(Findings(engine=name, checks=(), trouble=str(error)))
            done += steps([name])
            continue
        checks: list[Check] = []
        for run in _tasks(engine, reference):
            progress(done, name)
            checks += run()
            done += 1
        found.append(Findings(engine=name, checks=tuple(checks)))
    progress(done, "")
    return found


def steps(names: Sequence[str]) -> int:
    """Number of steps that `examine` takes."""
    return sum(len(ALONE) + (name != REFERENCE) * len(BESIDE) for name in names)


def _tasks(
    engine: type[Engine], reference: type[Engine]
) -> Iterator[Callable[[], Iterable[Check]]]:
    for measure in ALONE:
        yield partial(measure, engine)
    if engine is not reference:
        for compare in BESIDE:
            yield partial(compare, engine, reference)
