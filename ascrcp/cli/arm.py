"""fk, ik, machines: the arms' kinematics as JSON in, JSON out (SI: m and rad)."""

import sys
from typing import Any

import msgspec
import numpy as np

from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.table import table
from ascrcp.core.errors import InputError
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.description import list_machines
from ascrcp.kinematics.export import write_robot

MAX_BYTES = 50_000_000  # faults.md, security
LARGEST = 1e6  # rad or m: no machine's joint or pose is far from that


def _read(options: Options, keys: tuple[str, ...]) -> dict[str, Any]:
    text = options.input if options.input is not None else sys.stdin.read(MAX_BYTES)
    try:
        tree = msgspec.json.decode(text)
    except msgspec.DecodeError as error:
        raise InputError(f"the input is not JSON: {error}") from None
    if not isinstance(tree, dict) or not set(tree) <= set(keys) or keys[0] not in tree:
        raise InputError(f'the input must be a JSON object with "{keys[0]}", allowed keys {", ".join(keys)}')
    return tree


def _array(value: Any, name: str) -> np.ndarray:
    if not _all_numbers(value):
        raise InputError(f"{name} must be numbers between -{LARGEST:g} and {LARGEST:g}")
    try:
        return np.array(value, dtype=float)
    except ValueError:
        raise InputError(f"{name} must be numbers in a regular array") from None


def _all_numbers(value: Any) -> bool:
    """Tell whether nested lists hold nothing but numbers of a size that can be meant: true is not 1."""
    if isinstance(value, list):
        return all(map(_all_numbers, value))
    return type(value) in (int, float) and abs(value) <= LARGEST


def forward(options: Options, output: Output) -> int:
    """{"q": [...] or [[...], ...]} -> nozzle poses."""
    arm = load_arm(options.machine)
    T = arm.forward(_array(_read(options, ("q",))["q"], "q"))
    tree = {
        "ok": True,
        "machine": arm.name,
        "T": T.tolist(),
        "position": T[..., :3, 3].tolist(),
        "direction": T[..., :3, 0].tolist(),
    }
    output.result(tree, np.array2string(T, precision=6, suppress_small=True))
    return OK


def inverse(options: Options, output: Output) -> int:
    """{"T": 4x4, "held": {"5": 0.0, "6": 1.0}} -> every real solution."""
    arm = load_arm(options.machine)
    tree = _read(options, ("T", "held"))
    held_tree = tree.get("held") or {}
    try:
        held = {int(joint): float(_array(value, f"held joint {joint}")) for joint, value in held_tree.items()}
    except (AttributeError, TypeError, ValueError):
        raise InputError('held must map joint numbers to values, e.g. {"5": 0.0, "6": 1.0}') from None
    found = arm.inverse(_array(tree["T"], "T"), held=held)
    if len(found.q) != 1:
        raise InputError("ik takes one 4x4 pose")
    solutions = [
        {"q": q.tolist(), "within_limits": bool(inside)}
        for q, valid, inside in zip(found.q[0], found.valid[0], found.within_limits[0], strict=True)
        if valid
    ]
    rows = [[*(f"{x:.5f}" for x in s["q"]), "yes" if s["within_limits"] else "no"] for s in solutions]
    header = [f"q{i}" for i in range(1, arm.n + 1)] + ["within limits"]
    output.result(
        {"ok": True, "machine": arm.name, "solutions": solutions},
        table(header, rows) if rows else "no real solution",
    )
    return OK


def machines(options: Options, output: Output) -> int:
    """List the arms in config/machines, and a machine file given beside them; with --urdf export them."""
    names = list(list_machines())
    if options.machine not in names:
        names.append(options.machine)
    found = [load_arm(name) for name in names]
    tree: list[dict[str, Any]] = [
        {
            "name": arm.name,
            "joints": [
                {"number": j.number, "name": j.name, "name_zh": j.name_zh, "prismatic": j.prismatic}
                for j in arm.joints
            ],
        }
        for arm in found
    ]
    rows = [[arm.name, str(arm.n), ", ".join(j.name for j in arm.joints)] for arm in found]
    text = table(["name", "joints", "from base to tool"], rows)
    if options.urdf is not None:
        for entry, arm in zip(tree, found, strict=True):
            urdf, srdf = write_robot(arm, options.urdf)
            entry |= {"urdf": str(urdf), "srdf": str(srdf)}
            text += f"\n-> {urdf}, {srdf}"
    output.result({"ok": True, "machines": tree}, text)
    return OK
