"""Orders as they stand in the run log: what the operator and the jobs asked of the control cycle."""

from typing import Any

import msgspec
import numpy as np

from ascrcp.core.flow import JointSequence

_ARRAYS = ("t", "q", "position", "direction", "point", "spraying", "flow")


def encode_order(kind: str, value: Any) -> bytes:
    """Pack one order; a joint sequence travels as raw arrays so that it replays bit by bit."""
    if kind == "follow":
        sequence, from_s = value
        arrays = {}
        for name in _ARRAYS:
            array = np.ascontiguousarray(getattr(sequence, name))
            arrays[name] = (array.dtype.str, array.shape, array.tobytes())
        value = {"from_s": from_s, "arrays": arrays}
    return msgspec.msgpack.encode({"kind": kind, "value": value})


def decode_order(blob: bytes) -> tuple[str, Any]:
    """Unpack one order: (kind, value) as the cycle takes it."""
    tree = msgspec.msgpack.decode(blob)
    kind, value = tree["kind"], tree["value"]
    if kind == "follow":
        arrays = {
            name: np.frombuffer(data, np.dtype(code)).reshape(shape)
            for name, (code, shape, data) in value["arrays"].items()
        }
        value = (JointSequence(**arrays), value["from_s"])
    return kind, value
