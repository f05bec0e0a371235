"""Commissioning: a sensor's zero from what the joint really is."""

import math

from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout

from ascrcp.core.errors import InputError
from ascrcp.devices.machine_link import CONFIG_FILE, load_can_config
from ascrcp.devices.sensor import DEG, MM, SensorConfig
from ascrcp.hmi import quantity
from ascrcp.hmi.config_text import add_number, change, find_numbers, is_number, save_checked
from ascrcp.hmi.number_pad import NumberPad
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import set_look
from ascrcp.kinematics import JointInfo
from ascrcp.session.snapshot import Snapshot


def shifted_zero(sensor: SensorConfig, shown: float, really: float) -> float:
    """Return the reading at q = 0 with which a joint that shows a value [rad, m] shows the real one."""
    return sensor.zero + (shown - really) / sensor.si_per_unit


class ZeroPart(Panel):
    """Choose a joint, enter what it really is, save."""

    def __init__(self, joints: tuple[JointInfo, ...]) -> None:
        super().__init__(framed=False)
        self.path = CONFIG_FILE
        self._joints, self._joint = joints, joints[0]
        self._q: tuple[float, ...] = ()
        self._may, self._told = False, ("", "")
        self.hint = make_label("value", wrap=True)
        self.reads, self.really = make_label("number"), make_label("number")
        self.status = make_label("message", wrap=True)
        self.buttons: dict[int, QPushButton] = {}
        self.pad = NumberPad(is_secret=False)
        self.save_button = make_button("plain", name="zero_save")
        row = QHBoxLayout()
        for joint in joints:
            button = make_button("view", name=f"zero_{joint.number}", checkable=True)
            button.setText(str(joint.number))
            button.setMinimumWidth(64)
            button.clicked.connect(lambda _=False, joint=joint: self._choose(joint))
            row.addWidget(button)
            self.buttons[joint.number] = button
        left = QVBoxLayout()
        left.addWidget(self.hint)
        left.addLayout(row)
        for widget in (self.reads, self.really, self.save_button, self.status):
            left.addWidget(widget)
        left.addStretch()
        whole = QHBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addLayout(left, 1)
        whole.addWidget(self.pad)
        self.save_button.clicked.connect(self.save)
        self.pad.entered.connect(lambda text: self._write())
        self._choose(joints[0])

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.pad.set_language(language)
        self.hint.setText(say("zero_text", language))
        self.save_button.setText(say("zero_save", language))
        self._write()

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Show what the joint reads; allow saving at rest only."""
        job = snapshot.job
        self._q, self._may = snapshot.q, job.active is None and not job.jogging
        self._write()

    def save(self) -> None:
        """Write the new zero into the CAN configuration, checked by its reader."""
        index, shown, really = self._joint.number - 1, self._value(), self._entered()
        try:
            sensor = load_can_config(self.path).sensors[index]
            zero = shifted_zero(sensor, shown, really)
            text = self.path.read_text(encoding="utf-8")
            key = ("sensors", index, "zero")
            if any(number.key == key for number in find_numbers(text)):
                text = change(text, {key: f"{zero:.3f}"})
            else:
                text = add_number(text, key[:2], "zero", f"{zero:.3f}")
            save_checked(self.path, text, load_can_config)
        except (InputError, OSError) as error:
            self._told = ("failure", say("edit_refused", self.language).format(reason=error))
        else:
            moved = self._unit().show(shown - really)
            self._told = ("", say("zero_saved", self.language).format(n=index + 1, value=moved))
        self._write()

    def _choose(self, joint: JointInfo) -> None:
        self._joint, self._told = joint, ("", "")
        for number, button in self.buttons.items():
            button.setChecked(number == joint.number)
        self.pad.show_text("")
        self._write()

    def _unit(self) -> quantity.Quantity:
        return quantity.LENGTH if self._joint.prismatic else quantity.ANGLE

    def _value(self) -> float:
        index = self._joint.number - 1
        return self._q[index] if index < len(self._q) else math.nan

    def _entered(self) -> float:
        if not is_number(self.pad.text):
            return math.nan
        return float(self.pad.text) * (MM if self._joint.prismatic else DEG)

    def _write(self) -> None:
        shown, really, unit, language = self._value(), self._entered(), self._unit(), self.language
        number = self._joint.number
        set_text(self.reads, say("zero_reads", language).format(n=number, value=unit.show(shown)))
        set_text(self.really, say("zero_really", language).format(value=unit.show(really)))
        is_known = math.isfinite(shown)
        self.save_button.setEnabled(self._may and is_known and math.isfinite(really))
        look, told = self._told
        if not told and not self._may:
            told = say("zero_moving", language)
        elif not told and not is_known:
            told = say("zero_unknown", language)
        set_text(self.status, told)
        set_look(self.status, look)
