"""What is not installed names the command that installs it."""

import ast
import builtins
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path

import pytest

from benchmark.errors import CommandError
from benchmark.parts import extras, registry
from benchmark.parts.registry import ROOT

ROOMS = ("files", "backends", "tasks", "baselines", "leaderboard", "diagnosis", "benchmark")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def packages(requirements: Iterable[str]) -> set[str]:
    """Names of required packages, as in `metadata`."""
    return {re.split(r"[^\w.-]", one)[0].replace("_", "-").lower() for one in requirements}


def with_theirs(names: set[str]) -> set[str]:
    """Packages and what each of them requires."""
    theirs = (metadata.requires(name) or () for name in names)
    return names | packages(one for required in theirs for one in required if "extra" not in one)


def imports() -> Iterator[tuple[str, str]]:
    """Pairs of a module and a top-level package that is neither Python's nor ours."""
    for path in (file for room in ROOMS for file in (ROOT / room).rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            tops = {name.split(".")[0] for name in names} - {"", *ROOMS, *sys.stdlib_module_names}
            yield from ((module, top) for top in tops)


def test_every_import_is_required_or_in_the_extra_named_after_its_file() -> None:
    """Find the package of each import in the core, or in the extra that the message names."""
    core = with_theirs(packages(PROJECT["dependencies"]))
    owners = metadata.packages_distributions()
    wrong = []
    for module, top in imports():
        from_extra = [
            required
            for part in re.split(r"[._]", module)
            for required in packages(PROJECT["optional-dependencies"].get(part, []))
        ]
        if not packages(owners.get(top, [top])) & {*core, *from_extra}:
            wrong.append(f"{module} imports {top}")
    assert not wrong


@pytest.mark.parametrize(
    ("module", "command"),
    [
        ("backends.bullet", "pip install -c constraints.txt -e '.[bullet]'"),
        ("diagnosis.blind.engines.drake", "pip install -c constraints.txt -e '.[blind]'"),
        ("backends.mujoco_warp", "pip install -c constraints.txt -e '.[warp]'"),
        ("baselines.sb3_ppo", "pip install -c constraints.txt -e '.'"),
    ],
)
def test_command_names_the_extra_of_the_part(module: str, command: str) -> None:
    """Name the extra that is called like the file or a folder above it."""
    assert extras.install_command(module) == command


def test_without_a_checkout_the_wheels_name_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Read the extras from the installed package, and leave out what only a checkout has."""
    monkeypatch.setattr(extras, "_PROJECT", tmp_path / "pyproject.toml")
    extras._extras.cache_clear()
    monkeypatch.setattr(extras.metadata, "metadata", lambda name: Extras())
    try:
        assert extras.install_command("backends.bullet") == "pip install 'stickbench[bullet]'"
        assert extras.install_command("backends.mujoco") == "pip install 'stickbench'"
    finally:
        extras._extras.cache_clear()


class Extras:
    """The metadata of a package with one extra."""

    def get_all(self, field: str) -> list[str]:
        """Its fields."""
        return {"Provides-Extra": ["bullet"]}[field]


def test_missing_engine_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Name the package that is missing and the command, at the first use of the engine."""
    real = builtins.__import__

    def without(name: str, *rest, **more):
        if name.split(".")[0] == "sapien":
            raise ModuleNotFoundError("No module named 'sapien'", name="sapien")
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    for module in [name for name in sys.modules if name == "backends.sapien"]:
        monkeypatch.delitem(sys.modules, module)
    said = r"'sapien' needs the package 'sapien'.*pip install -c constraints.txt -e '.\[sapien\]'"
    with pytest.raises(CommandError, match=said):
        registry.load("backend", "sapien")
