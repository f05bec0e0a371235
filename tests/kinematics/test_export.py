"""URDF and SRDF: well formed, the whole arm in them, and pinocchio reads the same arm from them."""

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from ascrcp.core.errors import InputError
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.export import joint_name, write_robot, write_urdf
from ascrcp.kinematics.proof import draw_within_limits

MACHINES = pytest.mark.parametrize("name", ["kc", "muck", "duct"])


def place(element: ET.Element) -> np.ndarray:
    """Read an origin as URDF defines it: Rz(yaw) Ry(pitch) Rx(roll), then the translation in front."""
    origin = element.find("origin")
    assert origin is not None
    (r, p, y), xyz = (np.array(origin.get(key, "").split(), dtype=float) for key in ("rpy", "xyz"))
    Rx = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rz @ Ry @ Rx, xyz
    return T


def carry(urdf: Path, link: str, q: np.ndarray) -> np.ndarray:
    """Walk a URDF from `base` to a link, knowing nothing but the format."""
    root = ET.parse(urdf).getroot()
    joints = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    chain = []
    while link != "base":
        chain.insert(0, joints[link])
        link = joints[link].find("parent").get("link")
    T, moved = np.eye(4), iter(q)
    for joint in chain:
        T = T @ place(joint)
        if joint.get("type") == "fixed":
            continue
        axis = np.array(joint.find("axis").get("xyz").split(), dtype=float)
        value, motion = next(moved), np.eye(4)
        if joint.get("type") == "prismatic":
            motion[:3, 3] = value * axis
        else:
            K = np.cross(np.eye(3), axis)
            motion[:3, :3] = np.eye(3) + np.sin(value) * K + (1 - np.cos(value)) * K @ K
        T = T @ motion
    return T


@MACHINES
def test_the_exported_arm_is_the_arm(name: str, tmp_path: Path):
    arm = load_arm(name)
    urdf, _ = write_robot(arm, tmp_path / "out")
    for q in draw_within_limits(arm, 20, np.random.default_rng(1)):
        np.testing.assert_allclose(carry(urdf, "tool", q), arm.forward(q), atol=1e-12)
        if arm.description.lidar is not None:
            np.testing.assert_allclose(carry(urdf, "lidar_mount", q), arm.lidar(q), atol=1e-12)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [f"{name}.srdf", f"{name}.urdf"]


@MACHINES
def test_limits_speeds_and_names_are_the_machines(name: str, tmp_path: Path):
    arm = load_arm(name)
    urdf, srdf = write_robot(arm, tmp_path)
    joints = [j for j in ET.parse(urdf).getroot().findall("joint") if j.get("type") != "fixed"]
    assert [j.get("name") for j in joints] == [joint_name(arm, i) for i in range(arm.n)]
    for i, joint in enumerate(joints):
        assert joint.get("type") == ("prismatic" if arm.prismatic[i] else "revolute")
        limit = {key: float(value) for key, value in joint.find("limit").attrib.items()}
        assert (limit["lower"], limit["upper"]) == (arm.lower[i], arm.upper[i])
        assert limit["velocity"] == arm.max_speed[i] and limit["effort"] > 0
    root = ET.parse(srdf).getroot()
    state = {j.get("name"): float(j.get("value")) for j in root.iter("joint")}
    assert list(state) == [j.get("name") for j in joints]
    np.testing.assert_array_equal(list(state.values()), arm.zero_pose)
    links = {link.get("name") for link in ET.parse(urdf).getroot().findall("link")}
    assert {"base", "tool", *(f"link_{i + 1}" for i in range(arm.n))} <= links
    assert all({p.get("link1"), p.get("link2")} <= links for p in root.findall("disable_collisions"))


def test_capsules_stand_where_the_machine_file_puts_them(tmp_path: Path):
    arm = load_arm("kc")
    urdf, _ = write_robot(arm, tmp_path)
    q = draw_within_limits(arm, 1, np.random.default_rng(2))[0]
    frames = arm.frames(q)
    links = {link.get("name"): link for link in ET.parse(urdf).getroot().findall("link")}
    for capsule in arm.description.capsules:
        frame = frames[capsule.joint - 1] if capsule.joint else np.eye(4)
        name = f"link_{capsule.joint}" if capsule.joint else "base"
        T = carry(urdf, name, q)
        shapes = {s.get("name"): s for s in links[name].findall("collision")}
        key = capsule.name.replace(" ", "_")
        for end, local in (("start", capsule.start), ("end", capsule.end)):
            found = (T @ place(shapes[f"{key}_{end}"]))[:3, 3]
            np.testing.assert_allclose(found, (frame @ [*local, 1.0])[:3], atol=1e-12)
        axis = (T @ place(shapes[key]))[:3, 2]
        along = frame[:3, :3] @ (np.array(capsule.end) - capsule.start)
        np.testing.assert_allclose(axis * np.linalg.norm(along), along, atol=1e-12)


def test_a_place_that_cannot_be_written_is_one_clear_line(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        write_robot(load_arm("kc"), tmp_path / "file" / "below")
    with pytest.raises(InputError, match="nowhere"):
        write_urdf(load_arm("kc"), tmp_path / "nowhere" / "kc.urdf")


@MACHINES
def test_pinocchio_reads_the_same_arm(name: str, tmp_path: Path):
    pin = pytest.importorskip("pinocchio")
    arm = load_arm(name)
    urdf, srdf = write_robot(arm, tmp_path)
    model = pin.buildModelFromUrdf(str(urdf))
    pin.loadReferenceConfigurations(model, str(srdf))
    data, tool = model.createData(), model.getFrameId("tool")
    assert list(model.names)[1:] == [joint_name(arm, i) for i in range(arm.n)]
    np.testing.assert_allclose(model.referenceConfigurations["zero"], arm.zero_pose, atol=1e-12)
    for q in draw_within_limits(arm, 200, np.random.default_rng(3)):
        pin.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(data.oMf[tool].homogeneous, arm.forward(q), atol=1e-9)
        J = pin.computeFrameJacobian(model, data, q, tool, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(J, arm.jacobian(q), atol=1e-9)
