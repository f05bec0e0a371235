"""Strict configuration: every refusal is one line that names the file and the rule."""

from pathlib import Path
from typing import Annotated

import msgspec
import pytest

from ascrcp.core.config import Struct, load, merge, read_yaml
from ascrcp.core.errors import ConfigError


class Sample(Struct):
    speed: Annotated[float, msgspec.Meta(gt=0, le=2)]
    name: str = "x"


def write(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "sample.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_reads_numbers_as_yaml_1_2(tmp_path: Path) -> None:
    tree = read_yaml(write(tmp_path, "a: 1e5\nb: 012\nc: 1:30\nd: yes\ne: 1_000\nf: -3\ng: .5\nh: true"))
    assert tree == {"a": 1e5, "b": "012", "c": "1:30", "d": "yes", "e": "1_000", "f": -3, "g": 0.5, "h": True}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("speed: 1\nspeed: 2", "twice"),
        ("speed: 3.0", "<= 2"),
        ("speed: 0", "> 0"),
        ("speed: .nan", "finite"),
        ("speed: .inf", "finite"),
        ("sped: 1.0\nspeed: 1", "sped"),
        ("name: y", "speed"),
        ("speed: fast", "float"),
        ("speed: &a 1\nname: *a", "aliases"),
        ("speed: [" * 30, "nested"),
        ("speed: !!python/object:os.system 1", "constructor"),
        (b"\xff\xfe\x00", "UTF-8"),
        ("speed: [1", "line"),
        ("", "object"),
        ("x" * 1_000_001, "larger"),
    ],
)
def test_refuses_with_one_line(tmp_path: Path, text: str | bytes, says: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as error:
        load(path, Sample)
    message = str(error.value)
    assert says in message
    assert str(path) in message
    assert "\n" not in message


def test_missing_file_names_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent\.yaml"):
        load(tmp_path / "absent.yaml", Sample)


def test_overlay_replaces_leaves_only() -> None:
    base = {"arm": {"a": 1, "b": [1, 2]}, "seed": 3}
    assert merge(base, {"arm": {"b": [9]}}) == {"arm": {"a": 1, "b": [9]}, "seed": 3}
