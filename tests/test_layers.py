"""The rules of the house that a machine can check: imports only go down, the gate stays small and pure."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "ascrcp"
MODULES = sorted(PACKAGE.rglob("*.py"))
LAYERS = (
    *("cli", "hmi", "app", "session", "simulation", "devices", "safety"),
    *("control", "planning", "perception", "kinematics", "core"),
)
MAX_LINES = 400
GATE_MAY_IMPORT = {"collections", "dataclasses", "enum", "math", "msgspec", "typing", "ascrcp"}
GATE_MUST_NOT_CALL = {"open", "print", "input", "exec", "eval", "__import__"}


def imported_roots(path: Path) -> set[str]:
    """Top-level packages that a module imports, also inside its functions."""
    roots = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            roots.update(alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            roots.add(node.module.partition(".")[0])
    return roots


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the contract of this repository on the package in a folder."""
    program = "import sys, importlinter.cli as cli; sys.exit(cli.lint_imports(sys.argv[1], no_cache=True))"
    return subprocess.run(
        [sys.executable, "-c", program, str(ROOT / "pyproject.toml")],
        cwd=folder, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


def test_imports_only_go_down() -> None:
    result = lint_imports(ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("core/low", "import ascrcp.kinematics.arm"),
        ("core/low", "def f():\n    from ascrcp.session import job"),  # hidden in a function
        ("kinematics/arm", "import ascrcp.perception"),  # side by side
        ("control/loop", "import ascrcp.safety"),
        ("devices/bus", "import ascrcp.simulation"),
        ("session/job", "import PySide6.QtCore"),
        ("app/root", "import pyqtgraph"),
        ("cli/main", "import ascrcp.hmi"),
        ("safety/gate", "import numpy"),
        ("helper/thing", ""),  # a package that no layer names
    ],
)
def test_the_contract_refuses(tmp_path: Path, module: str, line: str) -> None:
    """A contract that passes everything would pass here too: each breach must be found."""
    for name in [*LAYERS, module.partition("/")[0]]:
        folder = tmp_path / "ascrcp" / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "__init__.py").touch()
    (tmp_path / "ascrcp" / "__init__.py").touch()
    for name in ("kinematics/arm", "session/job", module):
        (tmp_path / "ascrcp" / f"{name}.py").touch()
    assert lint_imports(tmp_path).returncode == 0 or module.startswith("helper")
    (tmp_path / "ascrcp" / f"{module}.py").write_text(line + "\n")
    result = lint_imports(tmp_path)
    assert result.returncode == 1, result.stdout + result.stderr


def test_only_hmi_imports_qt() -> None:
    guilty = [
        str(path.relative_to(ROOT))
        for path in MODULES
        if path.relative_to(PACKAGE).parts[0] != "hmi"
        and imported_roots(path) & {"PySide6", "shiboken6", "pyqtgraph", "OpenGL"}
    ]
    assert not guilty


@pytest.mark.parametrize("path", sorted((PACKAGE / "safety").rglob("*.py")), ids=lambda path: path.stem)
def test_the_gate_is_pure(path: Path) -> None:
    assert imported_roots(path) <= GATE_MAY_IMPORT
    calls = {
        node.func.id
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    assert not calls & GATE_MUST_NOT_CALL


def test_no_module_grows_past_reading() -> None:
    long = {
        str(path.relative_to(ROOT)): lines
        for path in MODULES
        if (lines := len(path.read_text(encoding="utf-8").splitlines())) > MAX_LINES
    }
    assert not long
