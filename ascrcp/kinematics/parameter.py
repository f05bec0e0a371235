"""What a calibration may change: sensor zeros, lengths and sag as named numbers of a machine file."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np

from ascrcp.core.config import Struct
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.bucket import BucketInverse
from ascrcp.kinematics.description import ArmDescription, Positive, Prismatic
from ascrcp.kinematics.inverse import SprayInverse
from ascrcp.kinematics.sag import compute_sag

Group = Literal["zeros", "lengths", "sag"]
GROUPS: tuple[Group, ...] = ("zeros", "lengths", "sag")

GENERIC_POSES = 200
"""Poses over the whole ranges that tell which parameters do the same to the tip."""

REDUNDANT = 1e-6
"""Share of a parameter's effect not made by others below which it counts as theirs."""


@dataclass(frozen=True)
class Parameter:
    """One number of a machine file.

    Attributes:
        name: For people, and for `--hold`.
        group: Zeros, lengths or sag.
        kind: "zero", "translate", "a", "d", "tool" or "sag".
        joint: Index of the joint from 0, -1 for tool and sag.
        key: Component of a translation, or name of a sag coefficient.
        unit: Of the machine file.
        expected: Size of the error it may have before a calibration, in that unit.
    """

    name: str
    group: Group
    kind: str
    joint: int
    key: int | str
    unit: str
    expected: float


class ExpectedErrors(Struct):
    """Sizes of the errors a machine may have before its first calibration (config/calibration.yaml)."""

    zero_deg: Positive
    length_mm: Positive
    sag_own_mm: Positive
    sag_load_mm_per_kg: Positive
    sag_exponent: Positive


def list_parameters(arm: Arm, expected: ExpectedErrors) -> list[Parameter]:
    """List every number of the machine that moves the tip, the most likely culprits first.

    Order decides which of several that do the same is fitted: zeros, lengths the file gives, sag,
    offsets that are zero in it. The zero of a sliding joint is its length.

    Args:
        arm: The machine.
        expected: Sizes of errors.
    """
    found: list[Parameter] = []
    length = expected.length_mm / 1e3
    for i, joint in enumerate(arm.description.joints):
        who = f"joint {i + 1} {joint.name}"
        if not isinstance(joint, Prismatic):
            found.append(Parameter(f"{who}: zero", "zeros", "zero", i, "", "deg", expected.zero_deg))
        if joint.dh is not None:
            found += [Parameter(f"{who}: {k}", "lengths", k, i, k, "m", length) for k in ("a", "d")]
        else:
            found += [
                Parameter(f"{who}: {axis}", "lengths", "translate", i, k, "m", length)
                for k, axis in enumerate("xyz")
            ]
    found += [Parameter(f"tool: {a}", "lengths", "tool", -1, k, "m", length) for k, a in enumerate("xyz")]
    if arm.description.sag is not None:
        for key, unit, size in (
            ("own_mm", "mm", expected.sag_own_mm),
            ("load_mm_per_kg", "mm/kg", expected.sag_load_mm_per_kg),
            ("exponent", "", expected.sag_exponent),
        ):
            found.append(Parameter(f"sag: {key}", "sag", "sag", -1, key, unit, size))
    nominal = [p.kind == "zero" or p.kind == "sag" or read_value(arm.description, p) != 0.0 for p in found]
    order = sorted(range(len(found)), key=lambda i: (not nominal[i], GROUPS.index(found[i].group), i))
    return [found[i] for i in order if _keeps_closed_form(arm, found[i])]


def read_value(description: ArmDescription, parameter: Parameter) -> float:
    """Return a parameter's value in the machine file, in its unit."""
    p = parameter
    if p.kind == "zero":
        noted = description.calibration.sensor_zero if description.calibration else []
        return float(noted[p.joint]) if noted else 0.0
    if p.kind == "tool":
        return float(description.tool[int(p.key)])
    if p.kind == "sag":
        return float(getattr(description.sag, str(p.key)))
    joint = description.joints[p.joint]
    if p.kind == "translate":
        return float(joint.translate[int(p.key)]) if joint.translate else 0.0
    return float(getattr(joint.dh, p.kind))


def change_description(
    description: ArmDescription, parameters: Sequence[Parameter], change: Array
) -> ArmDescription:
    """Return the machine with lengths and sag changed; zeros are no part of the arm's geometry.

    Args:
        description: The machine.
        parameters: k parameters.
        change: To add to each, in its unit, shape (k,).
    """
    joints: list[Any] = list(description.joints)
    tool = list(description.tool)
    sag: Any = description.sag
    for p, delta in zip(parameters, change.tolist(), strict=True):
        if p.kind == "zero":
            continue
        if p.kind == "tool":
            tool[int(p.key)] += delta
        elif p.kind == "sag":
            sag = msgspec.structs.replace(sag, **{str(p.key): getattr(sag, str(p.key)) + delta})
        elif p.kind == "translate":
            moved = list(joints[p.joint].translate or (0.0, 0.0, 0.0))
            moved[int(p.key)] += delta
            joints[p.joint] = msgspec.structs.replace(joints[p.joint], translate=tuple(moved))
        else:
            row = joints[p.joint].dh
            row = msgspec.structs.replace(row, **{p.kind: getattr(row, p.kind) + delta})
            joints[p.joint] = msgspec.structs.replace(joints[p.joint], dh=row)
    machine: Any = description
    changed: ArmDescription = msgspec.structs.replace(machine, joints=joints, tool=tuple(tool), sag=sag)
    return changed


def zero_change(arm: Arm, parameters: Sequence[Parameter], change: Array) -> Array:
    """Carry changes of sensor zeros into the joint vector [rad, m], shape (joints,).

    A sensor sits on the quantity its joint's range limits: kc's joint 4 has an inclinometer on
    q2 + q4, so that an error of joint 2's turns joint 4 back.
    """
    sensed = np.zeros(arm.n)
    for p, delta in zip(parameters, change.tolist(), strict=True):
        if p.kind == "zero":
            sensed[p.joint] += math.radians(delta)
    return np.asarray(np.linalg.solve(arm.limit_matrix, sensed))


def derive_position(arm: Arm, q: Array, payload_kg: Array, parameters: Sequence[Parameter]) -> Array:
    """Differentiate the sagged tip position by parameters.

    Args:
        arm: The arm.
        q: Joint vectors [rad, m], shape (n, joints).
        payload_kg: Concrete in the hose [kg], shape (n,).
        parameters: k parameters.

    Returns:
        Metres per unit of each parameter, shape (n, 3, k).
    """
    frames = arm.frames(q)
    by_sensor = arm.jacobian(q)[:, :3] @ np.linalg.inv(arm.limit_matrix)
    p = frames[:, -1, :3, 3]
    D = np.zeros((len(q), 3, len(parameters)))
    base = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    for column, parameter in enumerate(parameters):
        i = parameter.joint
        before = frames[:, i - 1, :3, :3] if i > 0 else base
        if parameter.kind == "zero":
            D[..., column] = np.radians(1.0) * by_sensor[:, :, i]
        elif parameter.kind == "translate":
            D[..., column] = before[:, :, int(parameter.key)]
        elif parameter.kind == "d":
            D[..., column] = before[:, :, 2]
        elif parameter.kind == "a":
            D[..., column] = frames[:, i, :3, 0]
        elif parameter.kind == "tool":
            D[..., column] = frames[:, -1, :3, int(parameter.key)]
    _derive_sag(arm, p, payload_kg, parameters, D)
    return D


def _derive_sag(arm: Arm, p: Array, payload_kg: Array, parameters: Sequence[Parameter], D: Array) -> None:
    """Add what sag makes of a moved tip, and the sag coefficients' own columns, to D (n, 3, k)."""
    model = arm.description.sag
    if model is None:
        return
    reach = np.maximum(np.hypot(p[:, 0], p[:, 1]), 1e-9)
    drop, _ = compute_sag(model, reach, payload_kg)
    outward = p[:, :2] / reach[:, None]
    steepness = model.exponent * drop / reach
    D[:, 2] -= steepness[:, None] * np.einsum("ni,nik->nk", outward, D[:, :2])
    share = reach / model.reference_reach
    own = share**model.exponent / 1e3
    columns = {
        "own_mm": own,
        "load_mm_per_kg": own * payload_kg,
        "exponent": drop * np.log(np.maximum(share, 1e-9)),
    }
    for column, parameter in enumerate(parameters):
        if parameter.kind == "sag":
            D[:, 2, column] = -columns[str(parameter.key)]


def find_independent(
    arm: Arm, parameters: Sequence[Parameter], payload_kg: float
) -> tuple[list[Parameter], dict[str, list[str]]]:
    """Drop parameters that do to the tip, whatever the pose, only what earlier ones do already.

    Args:
        arm: The arm.
        parameters: By falling priority.
        payload_kg: A payload to vary up to [kg], so that the hose's share of the sag shows.

    Returns:
        Those to fit, and for each dropped one's name the names it cannot be told from (empty: the
        tip does not feel it).
    """
    rng = np.random.default_rng(0)
    g = rng.uniform(arm.limit_lower, arm.limit_upper, (GENERIC_POSES, arm.n))
    q = g @ np.linalg.inv(arm.limit_matrix).T
    payload = rng.uniform(0.0, payload_kg, GENERIC_POSES)
    D = derive_position(arm, q, payload, parameters).reshape(-1, len(parameters))
    scaled = D * [p.expected for p in parameters]
    kept: list[int] = []
    dropped: dict[str, list[str]] = {}
    for column, parameter in enumerate(parameters):
        share = np.linalg.lstsq(scaled[:, kept], scaled[:, column])[0] if kept else np.zeros(0)
        left = scaled[:, column] - scaled[:, kept] @ share
        if np.linalg.norm(left) > REDUNDANT * np.linalg.norm(scaled[:, column]):
            kept.append(column)
            continue
        same = np.flatnonzero(np.abs(share) > 1e-3)
        dropped[parameter.name] = [parameters[kept[i]].name for i in same]
    return [parameters[i] for i in kept], dropped


def _keeps_closed_form(arm: Arm, parameter: Parameter) -> bool:
    """Tell whether the arm with this parameter changed can still be inverted as before."""
    if parameter.kind in ("zero", "sag"):
        return True
    moved = change_description(arm.description, [parameter], np.array([parameter.expected]))
    return _has_closed_form(moved) or not _has_closed_form(arm.description)


def _has_closed_form(description: ArmDescription) -> bool:
    return SprayInverse.fit(description) is not None or BucketInverse.fit(description) is not None


def find_sensor_zero(arm: Arm) -> Array:
    """Return what a calibration says must be added to what the sensors read, in SI.

    Returns:
        On the quantities the sensors measure (limit_matrix @ q) [rad, m], shape (joints,); zeros for a
        machine without a calibration.
    """
    noted = arm.description.calibration.sensor_zero if arm.description.calibration else []
    sensed = np.array(noted) if noted else np.zeros(arm.n)
    return np.where(arm.prismatic, sensed, np.radians(sensed))
