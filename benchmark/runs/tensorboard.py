"""The curve of a training as events of TensorBoard, beside `progress.csv`."""

import dataclasses
from pathlib import Path

from baselines.baseline import Progress
from benchmark.errors import CommandError
from benchmark.parts.extras import install_command

FOLDER = "tensorboard"
"""In the folder of a run."""


class Events:
    """Writes the progress of a run; its folder is made with the first event."""

    def __init__(self, run: Path) -> None:
        try:
            from tensorboard.summary.writer.event_file_writer import EventFileWriter
        except ImportError as error:
            raise CommandError(
                "--logger tensorboard needs the package 'tensorboard'; install it with: "
                f"{install_command(__name__)}"
            ) from error
        self._make, self.folder = EventFileWriter, run / FOLDER
        self._writer: EventFileWriter | None = None

    def add(self, progress: Progress, steps: int) -> None:
        """Write an iteration that ended after so many steps."""
        from tensorboard.compat.proto.event_pb2 import Event
        from tensorboard.compat.proto.summary_pb2 import Summary

        if self._writer is None:
            self._writer = self._make(str(self.folder))
        values = dataclasses.asdict(progress)
        del values["steps"]
        shown = [
            Summary.Value(tag=f"train/{name}", simple_value=value) for name, value in values.items()
        ]
        self._writer.add_event(Event(step=steps, summary=Summary(value=shown)))

    def close(self) -> None:
        """Write what is left."""
        if self._writer is not None:
            self._writer.close()
