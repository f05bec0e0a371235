"""Where configuration and resources lie: beside the package in a checkout, inside it in a wheel."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent
_ROOT = _PACKAGE.parent if (_PACKAGE.parent / "config").is_dir() else _PACKAGE / "data"

CONFIG = _ROOT / "config"
RESOURCES = _ROOT / "resources"
