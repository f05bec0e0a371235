"""Write a calibrated machine: machine file and what was fitted -> text of a new machine file."""

import hashlib
from pathlib import Path
from typing import Any

import yaml

from ascrcp.core.config import convert, read_yaml
from ascrcp.core.errors import InputError
from ascrcp.kinematics.calibration import Calibrated
from ascrcp.kinematics.description import ArmDescription, find_machine

DIGITS = 6
"""Decimals kept [deg, m, mm]: a micrometre, or 0.2 um at 14 m for an angle."""


def encode_machine(machine: str | Path, survey: Path, found: Calibrated) -> bytes:
    """Build the text of the calibrated machine's file.

    Everything that was not fitted stays as the old file has it; its comments do not. What the
    numbers come from stands in the head and under `calibration`.

    Args:
        machine: Name or file of the machine that was calibrated.
        survey: File of the measured tip positions.
        found: Outcome.

    Raises:
        ConfigError: The result breaks the schema.
    """
    old = find_machine(machine)
    tree = read_yaml(old)
    for joint, fitted in zip(tree["joints"], found.description.joints, strict=True):
        if fitted.translate is not None:
            joint["translate"] = _round(fitted.translate)
        elif fitted.dh is not None:
            row = {k: round(getattr(fitted.dh, k), DIGITS) for k in ("a", "alpha_deg", "d", "theta_deg")}
            joint["dh"] = {k: v for k, v in row.items() if v != 0.0 or k in joint["dh"]}
    tree["tool"] = _round(found.description.tool)
    if found.description.sag is not None:
        tree["sag"] |= {k: round(getattr(found.description.sag, k), DIGITS) for k in tree["sag"]}
    tree["calibration"] = _provenance(old, survey, found)
    convert(tree, ArmDescription, "calibrated machine")
    body = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)
    return (_head(old, survey, found) + body).encode()


def _provenance(old: Path, survey: Path, found: Calibrated) -> dict[str, Any]:
    return {
        "machine": old.name,
        "machine_sha256": _checksum(old),
        "survey": survey.name,
        "survey_sha256": _checksum(survey),
        "rows": len(found.after.vector),
        "set_aside": [line for line, _ in found.set_aside],
        "before_mm": round(found.before.mean_mm, 2),
        "after_mm": round(found.held_out.mean_mm, 2),
        "sensor_zero": _round(found.sensor_zero.tolist()),
    }


def _head(old: Path, survey: Path, found: Calibrated) -> str:
    lines = [
        f"# Made by `ascrcp calibrate` from {old.name} and {survey.name}; its comments stand in {old.name}.",
        "# Fitted, with one standard deviation:",
        *(
            f"#   {c.name}: {c.before:.5g} -> {c.after:.5g} +- {c.sigma:.2g} {c.unit}".rstrip()
            for c in found.changes
        ),
    ]
    return "\n".join(lines) + "\n"


def _round(values: Any) -> list[float]:
    return [round(float(v), DIGITS) + 0.0 for v in values]


def _checksum(file: Path) -> str:
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{file}: {error.strerror or error}") from None
