"""What is wrong with a robot, by its log and its model.

    from diagnosis import diagnose, page, read_log

    log = read_log("logs/today")
    found = diagnose(log, healthy=[read_log("logs/may")])
    print(*found.sentences)
    Path("report.html").write_text(page(found, log))

`read_log` reads and checks a folder, `diagnose` gives a `Diagnosis`, which is plain data to JSON
and back (`plain`, `of`), and `page` makes its report. `Cause` is what a diagnosis names; `LogError`
says why a log cannot be read or judged. A `progress` that raises `Stop` gets what is known so far.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from diagnosis.answer import Diagnosis
    from diagnosis.logs.log import Log, LogError
    from diagnosis.progress import Stop
    from diagnosis.reading import read_log
    from diagnosis.report.report import page
    from diagnosis.verdict.result import Cause
    from diagnosis.walk import diagnose

__all__ = ["Cause", "Diagnosis", "Log", "LogError", "Stop", "diagnose", "page", "read_log"]

_HOMES = {
    "Cause": "diagnosis.verdict.result",
    "Diagnosis": "diagnosis.answer",
    "Log": "diagnosis.logs.log",
    "LogError": "diagnosis.logs.log",
    "Stop": "diagnosis.progress",
    "diagnose": "diagnosis.walk",
    "page": "diagnosis.report.report",
    "read_log": "diagnosis.reading",
}
"""Where each is; loaded when it is asked for, since rooms of the diagnosis import this package."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'diagnosis' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOMES[name]), name)
