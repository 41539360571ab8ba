"""YAML that people write is read as plain data, or refused in one line."""

import pytest

from files.bounded import FileError
from files.plain_yaml import read_plain_yaml

BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)


def test_plain_data_is_read(tmp_path):
    """Read numbers and names; leave dates as text, and merge what an alias names."""
    file = tmp_path / "a.yaml"
    file.write_text("a: &base {x: 1}\nb: {<<: *base, y: 2.5}\nday: 2026-05-03\n")
    data = read_plain_yaml(file)
    assert data == {"a": {"x": 1}, "b": {"x": 1, "y": 2.5}, "day": "2026-05-03"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: 2\na: 3\n", "line 3: 'a' is given twice"),
        (BOMB, "more than 100000 values"),
        ("[" * 200 + "]" * 200, "levels"),
        ("[" * 5000 + "]" * 5000, "nested too deeply"),
        ("a: !!python/object/apply:os.system [ls]\n", "could not determine a constructor"),
        ("a: " + "9" * 5000, "cannot be read as YAML"),
        ("a: [", "cannot be read as YAML: line 1"),
        ("{[1]: 2}", "a key is no name"),
        ("x" * 1_000_001, "allowed: up to 1000000"),
        (b"\xff\xfe\x00", "cannot be read as UTF-8"),
    ],
)
def test_what_is_not_plain_is_refused_in_one_line(tmp_path, text, said):
    """Name the file, the place and the fault, and repeat no more than a line."""
    file = tmp_path / "a.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(FileError) as refused:
        read_plain_yaml(file)
    message = str(refused.value)
    assert said in message
    assert "\n" not in message
    assert len(message) < 400


def test_a_device_is_no_file(tmp_path):
    """Refuse what has no end."""
    (tmp_path / "a.yaml").symlink_to("/dev/zero")
    with pytest.raises(FileError, match="no file with data"):
        read_plain_yaml(tmp_path / "a.yaml")
