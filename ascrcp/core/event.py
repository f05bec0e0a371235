"""One table of events: what each does and what the operator reads. Gate, screen, log and tests use it.

Reaction classes and numbers F1..F46 are those of the fault catalogue (docs/faults.md).
"""

from dataclasses import dataclass
from enum import IntEnum


class Reaction(IntEnum):
    """How hard the platform reacts; a larger one wins."""

    LOG = 0  # R0: log and count
    WARN = 1  # R1: warn, degrade
    STOP = 2  # R2: controlled stop, ramp to zero within 10 cycles, then hold
    PROTECT = 3  # R3: protective stop, all drives zero and enable off in the next frame, latched
    ESTOP = 4  # R4: mirror of the hard-wired emergency stop, latched


@dataclass(frozen=True, slots=True)
class Event:
    """One row of the table. Texts are (English, Chinese)."""

    code: str
    fault: str
    reaction: Reaction
    cause: tuple[str, str]
    consequence: tuple[str, str]
    action: tuple[str, str]


_NEUTRAL = ("All joints stopped, spray off.", "全部关节停止，喷射关闭。")
_KEPT = ("Motion stopped, spray off, place in the path kept.", "运动停止，喷射关闭，保留路径位置。")
_RESET = ("Remove the cause, press reset, then start again.", "排除原因，按复位，再重新开始。")


def _protect(code: str, fault: str, en: str, zh: str, action: tuple[str, str] = _RESET) -> Event:
    return Event(code, fault, Reaction.PROTECT, (en, zh), _NEUTRAL, action)


_ROWS = (
    Event(
        "power_up",
        "",
        Reaction.PROTECT,
        ("The platform has just started.", "平台刚刚启动。"),
        _NEUTRAL,
        ("Press reset when the machine is clear.", "确认设备安全后按复位。"),
    ),
    Event(
        "operator_stop",
        "",
        Reaction.PROTECT,
        ("Stop was pressed on the screen.", "已按下屏幕紧急停止。"),
        _NEUTRAL,
        _RESET,
    ),
    Event(
        "estop",
        "F20",
        Reaction.ESTOP,
        ("The hard-wired emergency stop is pressed.", "硬件急停已按下。"),
        _NEUTRAL,
        ("Release the emergency stop, press reset, then start again.", "释放急停，按复位，再重新开始。"),
    ),
    _protect("joint_stale", "F1", "A joint sensor sends no new valid value.", "关节传感器无新的有效数据。"),
    _protect("bad_frames", "F3/F4", "Too many corrupt frames on the CAN bus.", "CAN 总线损坏帧过多。"),
    _protect("joint_range", "F6", "A joint sensor's value is outside its range.", "关节传感器数值超出量程。"),
    _protect("joint_jump", "F7", "A joint sensor's value jumped.", "关节传感器数值跳变。"),
    Event(
        "following_error",
        "F11",
        Reaction.STOP,
        ("A joint does not follow its target.", "关节未跟随目标。"),
        _KEPT,
        ("Check the joint and its valve, then continue.", "检查该关节及其阀，然后继续。"),
    ),
    _protect(
        "joint_limit",
        "F13",
        "A joint is beyond its limit.",
        "关节超出限位。",
        ("Move the joint back by hand, press reset.", "手动将关节移回，按复位。"),
    ),
    _protect(
        "not_finite", "F15", "A command or measurement is not a finite number.", "指令或测量值不是有限数。"
    ),
    _protect("controller_stale", "F25", "The motion controller's heartbeat is lost.", "运动控制器心跳丢失。"),
    _protect(
        "controller_mismatch",
        "F26",
        "The motion controller does not echo our state.",
        "运动控制器回传状态不一致。",
    ),
    Event(
        "cycle_late",
        "F28",
        Reaction.STOP,
        ("The control cycle was late.", "控制周期超时。"),
        _KEPT,
        ("Close other programs on this computer, then continue.", "关闭本机其他程序，然后继续。"),
    ),
    Event(
        "cycle_slow",
        "F28",
        Reaction.LOG,
        ("One control cycle was late.", "一个控制周期超时。"),
        ("None.", "无。"),
        ("None; it is counted.", "无；已计数。"),
    ),
    _protect("suspended", "F42", "The computer was asleep or stood still.", "计算机曾休眠或停顿。"),
    Event(
        "estop_stale",
        "F20",
        Reaction.ESTOP,
        ("The state of the emergency stop is not received.", "未收到急停状态。"),
        _NEUTRAL,
        (
            "Check the machine's CAN connection, press reset, then start again.",
            "检查设备 CAN 连接，按复位，再重新开始。",
        ),
    ),
    _protect(
        "following_far",
        "F11",
        "A joint is far from its target.",
        "关节严重偏离目标。",
        ("Check the joint and its valve, press reset.", "检查该关节及其阀，按复位。"),
    ),
    Event(
        "soft_limit",
        "F12",
        Reaction.WARN,
        ("A joint is close to its limit.", "关节接近限位。"),
        ("It is held back outward; it may move back in.", "向外运动受限；可向内运动。"),
        ("Move the joint back in.", "将关节向内移动。"),
    ),
    _protect(
        "joystick_lost",
        "F22/F24",
        "The joystick was lost while it moved the arm.",
        "摇杆在操纵机械臂时失去信号。",
        (
            "Check the joystick's plug, press reset, go to the start again.",
            "检查摇杆连接，按复位，再重新运动至初始点。",
        ),
    ),
    _protect(
        "foreign_sender",
        "F32",
        "Somebody else on the bus sends our commands.",
        "总线上有其他设备在发送本平台的指令。",
        ("Find and unplug the other sender, press reset.", "找到并断开该设备，按复位。"),
    ),
    _protect("bus_error", "F30/F33", "The CAN bus failed or was unplugged.", "CAN 总线故障或断开。"),
)

EVENTS: dict[str, Event] = {event.code: event for event in _ROWS}
