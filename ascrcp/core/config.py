"""Read configuration: strict YAML -> msgspec structs, every refusal naming file, key and rule."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import msgspec
import yaml

from ascrcp.core.errors import ConfigError

MAX_BYTES = 1_000_000  # faults.md, security: configuration is capped at 1 MB
MAX_DEPTH = 20

S = TypeVar("S")


if TYPE_CHECKING:
    from typing_extensions import dataclass_transform

    # type checkers do not inherit msgspec's frozen and kw_only from a base class: say it again
    @dataclass_transform(frozen_default=True, kw_only_default=True)
    class Struct:
        """Base of every configuration struct: immutable, unknown keys refused."""

        __struct_fields__: ClassVar[tuple[str, ...]]

        def __init_subclass__(cls, *, tag: str | None = None, tag_field: str | None = None) -> None: ...

else:

    class Struct(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
        """Base of every configuration struct: immutable, unknown keys refused."""


class _StrictLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """safe_load without duplicate keys; numbers and booleans as YAML 1.2 reads them."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if key in seen:
                raise ConfigError(f"line {key_node.start_mark.line + 1}: key {key!r} stands twice")
            seen.add(key)
        return super().construct_mapping(node, deep)


# PyYAML follows YAML 1.1: 012 is ten, 1:30 is ninety, yes is true. Keep what 1.2 keeps.
_StrictLoader.yaml_implicit_resolvers = {
    first: [
        (tag, pattern) for tag, pattern in rules if tag.rpartition(":")[2] not in ("int", "float", "bool")
    ]
    for first, rules in _StrictLoader.yaml_implicit_resolvers.items()
}
_StrictLoader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile("^(?:true|false)$"), list("tf"))
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:int", re.compile(r"^[-+]?(?:0|[1-9][0-9]*)$"), list("-+0123456789")
)
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"^[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?$|^[-+]?\.(?:inf|nan)$"
    ),
    list("-+.0123456789"),
)


def read_yaml(path: Path) -> Any:
    """Read one YAML file into plain values.

    Raises:
        ConfigError: Unreadable, too large, not YAML, or using a refused feature.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ConfigError(f"{path}: larger than {MAX_BYTES} bytes")
        text = path.read_text(encoding="utf-8")
        _check_events(text)
        return yaml.load(text, Loader=_StrictLoader)  # noqa: S506 - a SafeLoader made stricter
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text ({error.reason} at byte {error.start})") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" line {mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}:{where} {getattr(error, 'problem', None) or error}") from None
    except ConfigError as error:
        if str(error).startswith(str(path)):
            raise
        raise ConfigError(f"{path}: {error}") from None


def _check_events(text: str) -> None:
    """Refuse aliases and deep nesting before anything is built (alias bombs, stack overflow)."""
    depth = 0
    for event in yaml.parse(text, Loader=_StrictLoader):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.events.AliasEvent):
            raise ConfigError(f"line {line}: aliases are not allowed")
        if isinstance(event, yaml.events.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise ConfigError(f"line {line}: nested deeper than {MAX_DEPTH} levels")
        elif isinstance(event, yaml.events.CollectionEndEvent):
            depth -= 1


def merge(base: Any, overlay: Any) -> Any:
    """Lay one tree of mappings over another; lists and scalars are replaced whole."""
    if isinstance(base, dict) and isinstance(overlay, dict):
        return {**base, **{k: merge(base[k], v) if k in base else v for k, v in overlay.items()}}
    return overlay


def convert(tree: Any, kind: type[S], where: str) -> S:
    """Check plain values against a struct: types, bounds, unknown keys, finite numbers.

    Raises:
        ConfigError: With the key and the rule it breaks.
    """
    _check_finite(tree, where)
    try:
        return msgspec.convert(tree, kind, strict=True)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {error}") from None


def load(path: Path, kind: type[S], overlay: Any = None) -> S:
    """Read a YAML file into a struct, with an optional tree laid over it."""
    tree = read_yaml(path)
    if overlay is not None:
        tree = merge(tree, overlay)
    return convert(tree, kind, str(path))


def _check_finite(tree: Any, where: str) -> None:
    if isinstance(tree, dict):
        for key, value in tree.items():
            _check_finite(value, f"{where}: {key}")
    elif isinstance(tree, list):
        for index, value in enumerate(tree):
            _check_finite(value, f"{where}[{index}]")
    elif isinstance(tree, float) and not abs(tree) < float("inf"):
        raise ConfigError(f"{where}: {tree} is not a finite number")
