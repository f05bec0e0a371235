"""Write a machine for other programs: Arm -> URDF and SRDF (ROS, MoveIt, Foxglove, pinocchio).

URDF turns and slides each joint about one axis of its own frame, after a fixed placement. What a step of
the chain places before its joint goes into that placement, what it places after it into the next one.
URDF cannot say three things, which go in as comments: a range that limits a sum of joints, the sag, and
that masses and forces are not known.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.file import write_atomic
from ascrcp.core.geometry import AXES, Array, rotation, transform
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.chain import Op
from ascrcp.kinematics.description import Capsule

UNKNOWN_EFFORT = 1e6
"""Greatest force or torque [N, N m]: URDF demands one, the machine files know none. Placeholder, so large
that no simulator holds a joint back by it."""

LEVEL = 1e-9
"""Cosine of pitch below which roll and yaw turn about one axis."""

AXIS_NAMES = {index: name for name, index in AXES.items()}


@dataclass(frozen=True)
class _Placement:
    """One joint as URDF has it.

    Attributes:
        T_before: Parent link to joint, at joint zero, (4, 4).
        axis: Unit axis in the joint's frame.
        T_end: Child link to the frame that ends the joint's step, (4, 4).
    """

    T_before: Array
    axis: tuple[float, float, float]
    T_end: Array


def write_urdf(arm: Arm, path: Path) -> None:
    """Write the machine as URDF.

    Links are `base`, `link_1` .. `link_n`, `tool` and, where there is one, `lidar_mount`; joints carry
    the machine file's names. The pose of `tool` in `base` is arm.forward(q).

    Args:
        arm: The machine.
        path: File to write; replaced if it is there.

    Raises:
        InputError: The file cannot be written.
    """
    _write(build_urdf(arm), path)


def write_srdf(arm: Arm, path: Path) -> None:
    """Write what MoveIt needs beside the URDF: the group, the zero pose, pairs never to be checked."""
    _write(build_srdf(arm), path)


def write_robot(arm: Arm, folder: Path) -> tuple[Path, Path]:
    """Write NAME.urdf and NAME.srdf into a folder, made if need be, and return both places."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror or error}") from None
    urdf, srdf = folder / f"{arm.name}.urdf", folder / f"{arm.name}.srdf"
    write_urdf(arm, urdf)
    write_srdf(arm, srdf)
    return urdf, srdf


def joint_name(arm: Arm, index: int) -> str:
    """Name a joint as the export does: its number, then the machine file's name."""
    return f"joint_{index + 1}_{arm.joints[index].name.replace(' ', '_')}"


def build_urdf(arm: Arm) -> ET.Element:
    """Build the URDF's tree."""
    description = arm.description
    robot = ET.Element("robot", name=arm.name)
    about = f"{description.title}; {description.source}".replace("--", "-")  # XML ends a comment there
    robot.append(ET.Comment(f" {about} "))
    if description.sag is not None:
        robot.append(ET.Comment(" rigid model: the machine file also states a sag, which URDF cannot "))
    placements, T_tool = _place_joints(arm)
    _add_link(robot, "base", [c for c in description.capsules if c.joint == 0], np.eye(4))
    for i, place in enumerate(placements):
        parent = f"link_{i}" if i else "base"
        _add_joint(robot, arm, i, parent, place)
        shapes = [c for c in description.capsules if c.joint == i + 1]
        _add_link(robot, f"link_{i + 1}", shapes, place.T_end)
    _add_fixed(robot, "tool_mount", f"link_{arm.n}", "tool", T_tool)
    if description.lidar is not None:
        number = description.lidar.joint
        q = np.zeros(arm.n)
        T_frame = arm.frames(q)[number - 1]
        T_mount = placements[number - 1].T_end @ np.linalg.solve(T_frame, arm.lidar(q))
        _add_fixed(robot, "lidar_joint", f"link_{number}", "lidar_mount", T_mount)
    return robot


def build_srdf(arm: Arm) -> ET.Element:
    """Build the SRDF's tree."""
    robot = ET.Element("robot", name=arm.name)
    group = ET.SubElement(robot, "group", name="arm")
    ET.SubElement(group, "chain", base_link="base", tip_link="tool")
    state = ET.SubElement(robot, "group_state", name="zero", group="arm")
    for i, value in enumerate(arm.zero_pose):
        ET.SubElement(state, "joint", name=joint_name(arm, i), value=_number(value))
    for a, b, reason in _unchecked_pairs(arm):
        ET.SubElement(robot, "disable_collisions", link1=a, link2=b, reason=reason)
    return robot


def _place_joints(arm: Arm) -> tuple[list[_Placement], Array]:
    """Cut the chain at its joints; the tool's placement after the last link comes second."""
    found: list[_Placement] = []
    T = np.eye(4)
    for op in arm.chain:
        T = T @ _fixed_part(op)
        if op.joint >= 0:
            axis = np.roll([op.sign, 0.0, 0.0], op.axis)
            found.append(_Placement(T, tuple(axis.tolist()), np.eye(4)))
            T = np.eye(4)
        if op.last:
            found[-1] = _Placement(found[-1].T_before, found[-1].axis, T)
    return found, T


def _fixed_part(op: Op) -> Array:
    if op.turn:
        if op.quarter:
            return transform(np.round(rotation(AXIS_NAMES[op.axis], op.sign * op.fixed)))
        return transform(rotation(AXIS_NAMES[op.axis], op.sign * op.fixed))
    return transform(None, np.roll([op.sign * op.fixed, 0.0, 0.0], op.axis))


def _add_joint(robot: ET.Element, arm: Arm, i: int, parent: str, place: _Placement) -> None:
    info = arm.joints[i]
    kind = "prismatic" if info.prismatic else "revolute"
    joint = ET.SubElement(robot, "joint", name=joint_name(arm, i), type=kind)
    if len(info.limit_sum) > 1:
        total = " + ".join(f"q{number}" for number in info.limit_sum)
        joint.append(
            ET.Comment(
                f" the machine limits {total} to {info.lower:g}..{info.upper:g}; below is the widest "
                "range the joint can have by itself "
            )
        )
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=f"link_{i + 1}")
    _add_origin(joint, place.T_before)
    ET.SubElement(joint, "axis", xyz=_numbers(place.axis))
    ET.SubElement(
        joint,
        "limit",
        lower=_number(arm.lower[i]),
        upper=_number(arm.upper[i]),
        velocity=_number(arm.max_speed[i]),
        effort=_number(UNKNOWN_EFFORT),
    )


def _add_fixed(robot: ET.Element, name: str, parent: str, child: str, T: Array) -> None:
    joint = ET.SubElement(robot, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    _add_origin(joint, T)
    ET.SubElement(robot, "link", name=child)


def _add_link(robot: ET.Element, name: str, shapes: list[Capsule], T_end: Array) -> None:
    """Add a link with its capsules: a cylinder and a sphere at either end, for URDF knows no capsule."""
    link = ET.SubElement(robot, "link", name=name)
    for shape in shapes:
        start, end = (T_end @ [*point, 1.0] for point in (shape.start, shape.end))
        length = float(np.linalg.norm(end - start))
        for tag in ("visual", "collision"):
            if length > 0.0:
                middle = transform(_turn_z_to((end - start)[:3] / length), (start + end)[:3] / 2)
                cylinder = _add_shape(link, tag, shape.name, middle)
                ET.SubElement(cylinder, "cylinder", radius=_number(shape.radius), length=_number(length))
            for point, place in ((start, "start"), (end, "end")):
                sphere = _add_shape(link, tag, f"{shape.name} {place}", transform(None, point[:3]))
                ET.SubElement(sphere, "sphere", radius=_number(shape.radius))


def _add_shape(link: ET.Element, tag: str, name: str, T: Array) -> ET.Element:
    part = ET.SubElement(link, tag, name=name.replace(" ", "_"))
    _add_origin(part, T)
    return ET.SubElement(part, "geometry")


def _turn_z_to(direction: Array) -> Array:
    """Find a rotation whose z axis is a given unit vector."""
    side = np.eye(3)[np.abs(direction).argmin()]
    x = np.cross(side, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction], axis=1)


def _unchecked_pairs(arm: Arm) -> list[tuple[str, str, str]]:
    """List pairs of links that need no collision check: neighbours, and pairs the machine file leaves out."""
    capsules = arm.description.capsules
    bearer = {capsule.name: capsule.joint for capsule in capsules}
    checked = {frozenset((bearer[a], bearer[b])) for a, b in arm.description.self_pairs}
    bearers = sorted(set(bearer.values()))
    pairs = []
    for k, a in enumerate(bearers):
        for b in bearers[k + 1 :]:
            if frozenset((a, b)) in checked:
                continue
            reason = "Adjacent" if bearers[k + 1] == b else "User"
            pairs.append((_link_name(a), _link_name(b), reason))
    return pairs


def _link_name(joint: int) -> str:
    return f"link_{joint}" if joint else "base"


def _add_origin(parent: ET.Element, T: Array) -> None:
    ET.SubElement(parent, "origin", xyz=_numbers(T[:3, 3]), rpy=_numbers(_roll_pitch_yaw(T[:3, :3])))


def _roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Take a rotation apart as Rz(yaw) Ry(pitch) Rx(roll), the URDF's order [rad]."""
    level = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], level)
    if level < LEVEL:
        return math.atan2(-R[1, 2], R[1, 1]), pitch, 0.0
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])


def _number(value: float) -> str:
    return repr(float(value) + 0.0)  # + 0.0: no minus zero


def _numbers(values: Array | tuple[float, ...]) -> str:
    return " ".join(_number(value) for value in values)


def _write(root: ET.Element, path: Path) -> None:
    ET.indent(root)
    tree = ET.ElementTree(root)
    write_atomic(path, lambda file: tree.write(file, encoding="utf-8", xml_declaration=True))
