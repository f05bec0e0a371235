"""Change single numbers of a YAML file and keep all else as it stands, comments included."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import yaml

from ascrcp.core.errors import ConfigError, InputError
from ascrcp.core.file import write_atomic

Key = tuple[str | int, ...]


@dataclass(frozen=True)
class Number:
    """One number of a file: its place in the tree, its text, and where that stands."""

    key: Key
    text: str
    start: int
    end: int

    @property
    def name(self) -> str:
        """The place as words: joints 1 lower."""
        return " ".join(str(part + 1) if isinstance(part, int) else part for part in self.key)


def find_numbers(text: str) -> list[Number]:
    """List every number of a YAML text, in its order.

    Raises:
        ConfigError: It is no YAML.
    """
    try:
        root = yaml.compose(text, Loader=yaml.CSafeLoader)  # a tenth of the other's time
    except yaml.YAMLError as error:
        raise ConfigError(f"not YAML: {error}") from None
    found: list[Number] = []

    def walk(node: yaml.Node | None, key: Key) -> None:
        if isinstance(node, yaml.MappingNode):
            for name, value in node.value:
                walk(value, (*key, str(name.value)))
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                walk(value, (*key, index))
        elif isinstance(node, yaml.ScalarNode) and is_number(node.value) and not node.style:
            found.append(Number(key, node.value, node.start_mark.index, node.end_mark.index))

    walk(root, ())
    return found


def is_number(text: str) -> bool:
    """Return whether a text is a plain finite number."""
    try:
        return abs(float(text)) < float("inf")
    except ValueError:
        return False


def change(text: str, changes: dict[Key, str]) -> str:
    """Return a text with numbers replaced; what stood as a fraction stays one.

    Raises:
        ConfigError: A place that holds no number, or a value that is none.
    """
    numbers = {number.key: number for number in find_numbers(text)}
    for key, value in changes.items():
        if key not in numbers:
            raise ConfigError(f"no number at {' '.join(map(str, key))}")
        if not is_number(value):
            raise ConfigError(f"{value!r} is not a number")
    for number in sorted((numbers[key] for key in changes), key=lambda number: -number.start):
        value = changes[number.key]
        if "." in number.text and "." not in value:
            value += ".0"
        text = text[: number.start] + value + text[number.end :]
    return text


def add_number(text: str, mapping: Key, name: str, value: str) -> str:
    """Return a text with a number added at the end of a mapping written in braces.

    Raises:
        ConfigError: There is no such mapping in braces.
    """
    node: yaml.Node | None = yaml.compose(text, Loader=yaml.SafeLoader)
    for part in mapping:
        children = node.value if isinstance(node, (yaml.MappingNode, yaml.SequenceNode)) else []
        if isinstance(node, yaml.MappingNode):
            node = next((v for k, v in children if k.value == part), None)
        else:
            node = children[part] if isinstance(part, int) and part < len(children) else None
    if not isinstance(node, yaml.MappingNode) or not node.flow_style:
        raise ConfigError(f"{' '.join(map(str, mapping))} is no mapping in braces")
    at = node.end_mark.index - 1
    return f"{text[:at]}, {name}: {value}{text[at:]}"


def save_checked(path: Path, text: str, check: Callable[[Path], object]) -> None:
    """Check a changed file by its own reader, then put it in the old one's place.

    Args:
        path: The file.
        text: Its new text.
        check: Reads a file of the same kind; its refusal is ours.

    Raises:
        InputError: It is refused, or the disk refuses; the file is as it was then.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="ascrcp-check-", dir=path.parent) as folder:
            trial = Path(folder) / path.name
            trial.write_text(text, encoding="utf-8")
            try:
                check(trial)
            except InputError as error:
                raise ConfigError(str(error).replace(str(trial), path.name)) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    write_atomic(path, lambda file: file.write(text.encode("utf-8")))
