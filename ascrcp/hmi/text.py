"""Every word on the screen, in English and Chinese (thesis 6.1.2 gives the Chinese button names)."""

from enum import IntEnum

from ascrcp.hmi.text_page import PAGE_TEXT
from ascrcp.hmi.text_semi import SEMI_TEXT
from ascrcp.hmi.text_setup import SETUP_TEXT
from ascrcp.session.state import Mode, Step


class Language(IntEnum):
    """Index into every (English, Chinese) pair of the project."""

    EN = 0
    ZH = 1

    @property
    def other(self) -> "Language":
        """The language the switch leads to."""
        return Language.ZH if self is Language.EN else Language.EN

    @property
    def code(self) -> str:
        """Code as configuration files write it: en, zh."""
        return self.name.lower()


STEP_NAME: dict[Step, tuple[str, str]] = {
    Step.ZERO: ("Zero joints", "关节归零"),
    Step.RECOGNISE: ("Recognise", "识别解算"),
    Step.LOAD: ("Load data", "读取数据"),
    Step.GO_TO_START: ("Go to start", "运动至初始点"),
    Step.RUN: ("Run", "开始运动"),
    Step.RESCAN: ("Scan again", "再次扫描"),
}
MODE_NAME: dict[Mode, tuple[str, str]] = {
    Mode.AUTOMATIC: ("Automatic", "全自动"),
    Mode.SEMI_AUTOMATIC: ("Semi-automatic", "半自动"),
}
TEXT: dict[str, tuple[str, str]] = {
    "window": ("ASCRCP - automatic shotcrete robot control", "ASCRCP 自动喷浆机器人控制平台"),
    "language": ("中文", "English"),
    "simulation": ("SIMULATION\nno real machine", "仿真\n未连接真实设备"),
    # step states
    "todo": ("○ to do", "○ 待执行"),
    "active": ("▶ in progress", "▶ 进行中"),
    "done": ("✔ done", "✔ 已完成"),
    # state of the platform
    "estop": ("EMERGENCY STOP", "急停"),
    "stopped": ("STOPPED", "已停止"),
    "holding": ("HOLDING", "保持中"),
    "moving": ("ARM MOVING", "机械臂运动中"),
    "computing": ("WORKING", "处理中"),
    "finished": ("JOB FINISHED", "作业完成"),
    "ready": ("READY", "就绪"),
    "remaining": ("{time} left", "剩余 {time}"),
    "at_rest": ("no step under way", "无进行中的步骤"),
    # commands
    "stop": ("STOP", "紧急停止"),
    "stop_keys": ("Key: Space or F12", "按键：空格或 F12"),
    "reset": ("RESET", "复位"),
    "quit": ("Quit", "退出平台"),
    "quit_again": ("Press again\nto quit", "再按一次\n退出"),
    "cancel": ("Cancel step", "取消步骤"),
    "estop_released": ("Hard-wired e-stop:\n● released", "硬件急停：\n● 已释放"),
    "estop_pressed": ("Hard-wired e-stop:\n▲ PRESSED", "硬件急停：\n▲ 已按下"),
    "software_stop": (
        "This is a software stop. The safety device is the hard-wired emergency stop.",
        "此按钮为软件停止。安全装置是硬件急停按钮。",
    ),
    "frozen": ("DATA FROZEN", "数据冻结"),
    "theme_night": ("Night theme", "夜间模式"),
    "theme_day": ("Day theme", "日间模式"),
    "holder": ("Control:", "控制权："),
    "holder_nobody": ("■ nobody, drives off", "■ 无，驱动关闭"),
    "holder_platform": ("▶ the platform", "▶ 平台"),
    "holder_stick": ("▶ the stick", "▶ 摇杆"),
    "holder_rest": ("○ platform, at rest", "○ 平台，静止"),
    "holder_unknown": ("? not known", "? 未知"),
    # pages
    "page_automatic": ("Automatic", "全自动"),
    "page_wall": ("Wall", "壁面"),
    "page_joints": ("Joints", "关节"),
    "page_alarms": ("Alarms", "报警"),
    "page_semi": ("Semi-auto", "半自动"),
    "page_setup": ("Set-up", "调试"),
    # alarm
    "no_alarm": ("● No alarm", "● 无报警"),
    "alarm": ("▲ ALARM {fault}", "▲ 报警 {fault}"),
    "notice": ("■ NOTICE", "■ 提示"),
    "first_of": ("first of {n}", "共 {n} 条，首发"),
    "cause": ("Cause", "原因"),
    "consequence": ("Effect", "后果"),
    "action": ("Action", "措施"),
    "messages": ("Messages", "消息"),
    # joints
    "joint": ("Joint", "关节"),
    "actual": ("Actual", "实际"),
    "target": ("Target", "目标"),
    "error": ("Error", "误差"),
    "drive": ("Drive", "驱动"),
    # nozzle
    "nozzle_auto": ("Nozzle, automatic", "喷头（全自动）"),
    "nozzle_semi": ("Nozzle, semi-automatic: joystick along the plan", "喷头（半自动）：摇杆沿轨迹移动"),
    "position": ("Position x y z", "位置 x y z"),
    "wanted": ("Target x y z", "目标 x y z"),
    "direction": ("Spray direction", "喷射方向"),
    "nozzle_error": ("Nozzle error", "喷头误差"),
    "points": ("Points", "规划点"),
    "points_value": (
        "{reached} of {points}, {skipped} skipped",
        "已达 {reached} / {points}，跳过 {skipped}",
    ),
    "spray": ("Spray", "喷射"),
    "spray_on": ("▶ ON", "▶ 开"),
    "spray_off": ("○ off", "○ 关"),
    "spray_operator": ("by the operator", "由操作手控制"),
    "joystick_present": ("joystick connected", "摇杆已连接"),
    "joystick_absent": ("no joystick", "未连接摇杆"),
    # status line
    "cycle": (
        "Cycle late p50 {p50}, p99.9 {p99_9}, max {max}, missed {missed}",
        "周期延迟 中位 {p50}，99.9% {p99_9}，最大 {max}，丢失 {missed}",
    ),
    "oil": ("Oil {value}", "油温 {value}"),
    "job_time": ("Job time {value}", "作业时间 {value}"),
    "speed": ("Speed {value}", "速度 {value}"),
    "round": ("Round {value}", "循环 {value}"),
}


TEXT.update(PAGE_TEXT)
TEXT.update(SETUP_TEXT)
TEXT.update(SEMI_TEXT)


def say(key: str, language: Language) -> str:
    """Return the text of a key in a language."""
    return TEXT[key][language]
