"""Project the lidar's lines into the base frame: Scan -> Cloud (thesis 3.2)."""

import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.flow import Cloud, Scan
from ascrcp.core.geometry import Array, check_transform


def project(scan: Scan, T_base_lidarmount: Array, pan_zero: float = 0.0) -> Cloud:
    """Carry every echo into the base frame through the arm as it was measured.

    At pan p and beam b the ray in the mount frame (x forward, y left, z up) has the direction
    Rot(z, p - pan_zero) @ (cos b, 0, sin b): the scan plane stands upright and turns with the head,
    b = 0 forward, b = pi/2 up; its origin is the mount's.

    Args:
        scan: Lines of the lidar; NaN where nothing came back.
        T_base_lidarmount: Mount at the end of joint 6 in the base frame, shape (4, 4).
        pan_zero: Pan angle read when the head points along the mount's x [rad] (calibration).

    Returns:
        The echoes in the base frame [m].

    Raises:
        InputError: If the transform is no single rigid transform, or nothing came back at all.
    """
    T = check_transform(T_base_lidarmount)
    if T.shape != (4, 4):
        raise InputError(f"T_base_lidarmount must have shape (4, 4), not {T.shape}")
    points = echoes(scan, pan_zero) @ T[:3, :3].T + T[:3, 3]
    return Cloud(points.astype(np.float32), source="scan" if scan.complete else "scan (incomplete)")


def echoes(scan: Scan, pan_zero: float = 0.0) -> Array:
    """Return every echo in the mount's own frame [m], shape (n, 3); see `project`.

    Raises:
        InputError: If nothing came back at all, or the pan zero is no angle.
    """
    if not abs(pan_zero) <= 2 * np.pi:
        raise InputError(f"pan_zero is {pan_zero} rad, allowed -2 pi to 2 pi")
    line, beam = np.nonzero(np.isfinite(scan.ranges) & (scan.ranges > 0.0))
    if not len(line):
        raise InputError("the scan holds no echo: check the lidar's window and the scan pose")
    distance = scan.ranges[line, beam].astype(float)
    reach = distance * np.cos(scan.beam)[beam]
    pan = scan.pan - pan_zero
    return np.stack(
        [reach * np.cos(pan)[line], reach * np.sin(pan)[line], distance * np.sin(scan.beam)[beam]], axis=-1
    )
