"""Orders as they stand in the run log: what the operator and the jobs asked of the control cycle."""

from typing import Any

import msgspec
import numpy as np

from ascrcp.control.steer_plan import SteerPlan
from ascrcp.core.flow import JointSequence
from ascrcp.session.steering import PLAN_ARRAYS, SteerOrder

_ARRAYS = ("t", "q", "position", "direction", "point", "spraying", "flow")
_STEER = ("kind", "row", "column", "joint", "q", "scan")


def encode_order(kind: str, value: Any) -> bytes:
    """Pack one order; a joint sequence travels as raw arrays so that it replays bit by bit."""
    if kind == "follow":
        sequence, from_s = value
        value = {"from_s": from_s, "arrays": _pack(sequence, _ARRAYS)}
    elif kind == "steer":
        value = {
            **{name: getattr(value, name) for name in _STEER},
            "arrays": {} if value.plan is None else _pack(value.plan, PLAN_ARRAYS),
        }
    return msgspec.msgpack.encode({"kind": kind, "value": value})


def decode_order(blob: bytes) -> tuple[str, Any]:
    """Unpack one order: (kind, value) as the cycle takes it."""
    tree = msgspec.msgpack.decode(blob)
    kind, value = tree["kind"], tree["value"]
    if kind == "follow":
        value = (JointSequence(**_unpack(value["arrays"])), value["from_s"])
    elif kind == "steer":
        arrays = _unpack(value.pop("arrays"))
        value = SteerOrder(**{**value, "q": tuple(value["q"])}, plan=SteerPlan(**arrays) if arrays else None)
    return kind, value


def _pack(owner: object, names: tuple[str, ...]) -> dict[str, tuple[str, tuple[int, ...], bytes]]:
    arrays = {}
    for name in names:
        array = np.ascontiguousarray(getattr(owner, name))
        arrays[name] = (array.dtype.str, array.shape, array.tobytes())
    return arrays


def _unpack(arrays: dict[str, Any]) -> dict[str, Any]:
    return {
        name: np.frombuffer(data, np.dtype(code)).reshape(shape)
        for name, (code, shape, data) in arrays.items()
    }
