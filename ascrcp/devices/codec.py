"""Frames <-> physical values: packing compiled from the DBC once, because it runs in every cycle.

The DBC (resources/ascrcp.dbc) is the one description of the frames; cantools reads it. Its own
decoder is exact but costs several microseconds a frame, so each message is turned into shifts and
masks on one integer here; a test holds both against each other.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cantools
from cantools.database.can import Database, Message

from ascrcp.core.errors import ConfigError, InputError
from ascrcp.devices.e2e import compute_seed

E2E_SIGNALS = {"Crc": (0, 8), "Counter": (8, 4)}


@dataclass(frozen=True, slots=True)
class Field:
    """One signal of a frame: where its bits lie and what one count is worth."""

    name: str
    start: int
    mask: int
    sign_bit: int
    scale: float
    minimum: float
    maximum: float
    unit: str


@dataclass(frozen=True, slots=True)
class Layout:
    """One frame of the DBC.

    Attributes:
        name: Message name in the DBC.
        can_id: 11-bit identifier.
        length: Data length [bytes].
        seed: Start of its CRC, from the DBC attribute E2EDataId.
        fields: Signals without CRC and counter, in the order of the DBC.
    """

    name: str
    can_id: int
    length: int
    seed: int
    fields: tuple[Field, ...]

    def decode(self, data: bytes) -> tuple[float, ...]:
        """Return the physical values of the fields in order; the length must be right."""
        word = int.from_bytes(data, "little")
        values = []
        for f in self.fields:
            raw = (word >> f.start) & f.mask
            if raw & f.sign_bit:
                raw -= f.mask + 1
            values.append(raw * f.scale)
        return tuple(values)

    def encode(self, values: tuple[float, ...]) -> bytearray:
        """Return the frame that carries the values, CRC and counter still zero.

        Args:
            values: Physical values of the fields, in order.

        Raises:
            InputError: A value that is not finite or outside the range of the DBC.
        """
        word = 0
        for f, value in zip(self.fields, values, strict=True):
            if not (f.minimum <= value <= f.maximum):
                raise InputError(
                    f"{self.name}.{f.name} is {value}, allowed {f.minimum:g}..{f.maximum:g} {f.unit}".rstrip()
                )
            word |= (round(value / f.scale) & f.mask) << f.start
        return bytearray(word.to_bytes(self.length, "little"))

    def field(self, name: str) -> Field:
        """Return one field by name."""
        for f in self.fields:
            if f.name == name:
                return f
        raise ConfigError(f"{self.name}: no signal {name}, only {', '.join(f.name for f in self.fields)}")


class Codec:
    """All frames of one DBC file.

    Attributes:
        by_id: Layout of every identifier.
        by_name: The same by message name.
    """

    def __init__(self, path: Path) -> None:
        database = _read(path)
        layouts = [_compile(message, path) for message in database.messages]
        self.by_id: Mapping[int, Layout] = {layout.can_id: layout for layout in layouts}
        self.by_name: Mapping[str, Layout] = {layout.name: layout for layout in layouts}

    def layout(self, name: str) -> Layout:
        """Return the layout of one message.

        Raises:
            ConfigError: The DBC does not describe it.
        """
        if name not in self.by_name:
            raise ConfigError(f"the DBC has no message {name}, only {', '.join(sorted(self.by_name))}")
        return self.by_name[name]


def _read(path: Path) -> Database:
    try:
        database = cantools.database.load_file(path, strict=True)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except (cantools.Error, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not a DBC file ({str(error).splitlines()[0]})") from None
    if not isinstance(database, Database):
        raise ConfigError(f"{path}: not a DBC file but a diagnostics database")
    return database


def _compile(message: Message, path: Path) -> Layout:
    where = f"{path}: {message.name}"
    if message.is_extended_frame or message.is_fd:
        raise ConfigError(f"{where}: only classic frames with 11-bit identifiers are allowed")
    fields = []
    places = {}
    for signal in message.signals:
        if signal.byte_order != "little_endian" or signal.is_multiplexer or signal.multiplexer_ids:
            raise ConfigError(f"{where}.{signal.name}: only plain little-endian signals are allowed")
        places[signal.name] = (signal.start, signal.length)
        if signal.name in E2E_SIGNALS:
            continue
        if signal.offset != 0 or signal.minimum is None or signal.maximum is None:
            raise ConfigError(f"{where}.{signal.name}: needs a range and no offset")
        fields.append(
            Field(
                name=signal.name,
                start=signal.start,
                mask=(1 << signal.length) - 1,
                sign_bit=1 << (signal.length - 1) if signal.is_signed else 0,
                scale=float(signal.scale),
                minimum=float(signal.minimum),
                maximum=float(signal.maximum),
                unit=signal.unit or "",
            )
        )
    for name, place in E2E_SIGNALS.items():
        if places.get(name) != place:
            raise ConfigError(f"{where}: {name} must lie at bit {place[0]} with {place[1]} bits")
    attributes = message.dbc.attributes if message.dbc else {}
    if "E2EDataId" not in attributes:
        raise ConfigError(f"{where}: attribute E2EDataId is missing")
    seed = compute_seed(int(attributes["E2EDataId"].value))
    return Layout(message.name, message.frame_id, message.length, seed, tuple(fields))
