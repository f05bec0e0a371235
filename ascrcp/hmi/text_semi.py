"""Words of the semi-automatic page: (English, Chinese) by key."""

SEMI_TEXT: dict[str, tuple[str, str]] = {
    "semi_steps": (
        "Steps 1 to 4, then 5 Run: the stick has the arm.",
        "完成第 1 至 4 步后按 5 开始运动：由摇杆操纵。",
    ),
    "semi_pad_plan": (
        "Press in the middle and hold, then pull. Up: into the tunnel; sideways: along the pass.",
        "按住中心不放再拖动。上：向洞内；左右：沿喷涂道。",
    ),
    "semi_pad_jog": (
        "Free jog: press in the middle and hold, then pull. Slow.",
        "自由点动：按住中心不放再拖动。低速。",
    ),
    "semi_other_stick": (
        "The configured joystick steers; the pad is off.",
        "由已配置的摇杆操纵；屏幕摇杆停用。",
    ),
    "semi_keys": (
        "Keys: hold E, then arrow keys; Page up and down: spray",
        "按键：按住 E，再按方向键；Page Up/Down：喷量",
    ),
    "semi_in": ("in", "洞内"),
    "semi_out": ("out", "洞外"),
    "semi_up": ("up", "上"),
    "semi_down": ("down", "下"),
    "semi_left": ("left", "左"),
    "semi_right": ("right", "右"),
    "semi_idle": ("○ The stick does not have the arm.", "○ 摇杆未接管机械臂。"),
    "semi_finish": ("Finish", "结束操纵"),
    "semi_area": ("Other\narea", "换区域"),
    "semi_jog": ("Free jog", "自由点动"),
    "semi_end_jog": ("End jog", "结束点动"),
    "semi_axis_in": ("Pad up:\nin", "上拖：\n洞内"),
    "semi_axis_up": ("Pad up:\nup", "上拖：\n向上"),
    "semi_spray_more": ("Spray +", "喷量 +"),
    "semi_spray_less": ("Spray −", "喷量 −"),
    "semi_spray_none": ("Spray off", "停喷"),
    "semi_lever": ("Spray lever {share}", "喷量 {share}"),
    "semi_stick_ok": ("● joystick ready", "● 摇杆就绪"),
    "semi_stick_lost": ("▲ no joystick signal", "▲ 无摇杆信号"),
    "semi_key_held": ("▶ enabled", "▶ 已使能"),
    "semi_key_free": ("○ not enabled", "○ 未使能"),
}
