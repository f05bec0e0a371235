"""Words of the commissioning pages: (English, Chinese) by key."""

SETUP_TEXT: dict[str, tuple[str, str]] = {
    # PIN
    "pin_title": ("Commissioning is locked. Enter the PIN.", "调试页面已锁定，请输入密码。"),
    "pin_wrong": ("▲ Wrong PIN", "▲ 密码错误"),
    "pin_wait": ("▲ Too many wrong tries: wait {time}", "▲ 错误次数过多，请等待 {time}"),
    "pin_enter": ("Enter", "确认"),
    "pin_clear": ("Clear", "清除"),
    "setup_lock": ("Lock", "锁定"),
    # parts
    "setup_bus": ("Bus\nmonitor", "总线\n监视"),
    "setup_zero": ("Sensor\nzero", "传感器\n零位"),
    "setup_move": ("Joint\ntest", "关节\n测试"),
    "setup_machine": ("Machine\nfile", "设备\n参数"),
    "setup_profile": ("Profile\nfile", "断面\n参数"),
    "setup_rig": ("Rig\nfaults", "仿真\n故障"),
    # bus monitor
    "bus_identifier": ("Id", "标识符"),
    "bus_name": ("Message", "报文"),
    "bus_data": ("Data", "数据"),
    "bus_rate": ("per s", "每秒"),
    "bus_decoded": ("Value", "数值"),
    "bus_silent": ("No frame has been heard.", "未收到任何帧。"),
    # sensor zero
    "zero_text": (
        "Bring the joint to a known place, choose it, set what it really is, then save. "
        "The new zero holds from the next start on.",
        "将关节置于已知位置，选择该关节，输入实际值并保存。新零位在下次启动后生效。",
    ),
    "zero_reads": ("Joint {n} reads {value}", "关节 {n} 读数 {value}"),
    "zero_really": ("It really is {value}", "实际为 {value}"),
    "zero_save": ("Save the zero", "保存零位"),
    "zero_saved": (
        "✔ Joint {n}: zero moved by {value}, from the next start on",
        "✔ 关节 {n} 零位移动 {value}，下次启动后生效",
    ),
    "zero_moving": ("Not while the arm moves.", "机械臂运动时不可用。"),
    "zero_unknown": ("The sensor has not been heard.", "未收到该传感器数据。"),
    # joint test
    "move_text": (
        "Moves one joint slowly while a button is held. Clearance stays on. Let go: it stops.",
        "按住按钮时单个关节慢速运动，间距监控保持有效，松开即停。",
    ),
    "move_refused": ("Not now: {reason}", "当前不可用：{reason}"),
    "move_begin": ("Begin test", "开始测试"),
    "move_end": ("End test", "结束测试"),
    "move_minus": ("− hold", "− 按住"),
    "move_plus": ("+ hold", "+ 按住"),
    # editor
    "edit_key": ("Parameter", "参数"),
    "edit_value": ("Value", "数值"),
    "edit_save": ("Check and save", "检查并保存"),
    "edit_undo": ("Undo all", "全部撤销"),
    "edit_good": ("● The file is sound", "● 文件有效"),
    "edit_changed": ("■ {n} changed, not saved", "■ 已改 {n} 项，未保存"),
    "edit_saved": ("✔ Saved; it holds from the next start on", "✔ 已保存，下次启动后生效"),
    "edit_refused": ("▲ Refused: {reason}", "▲ 被拒绝：{reason}"),
    # rig faults
    "rig_text": (
        "Only on the simulated rig: what a fault does. Everything here is undone by Heal all.",
        "仅限仿真：演示故障后果。“全部恢复”可撤销所有故障。",
    ),
    "rig_none": ("Only on the simulated rig.", "仅限仿真。"),
    "rig_frame": ("Frame: {name}", "报文：{name}"),
    "rig_drop": ("Drop\nframes", "丢帧"),
    "rig_repeat": ("Repeat\nframe", "重复帧"),
    "rig_corrupt": ("Corrupt\nframes", "损坏帧"),
    "rig_freeze": ("Freeze\nreading", "读数冻结"),
    "rig_shift": ("Shift\nreading", "读数偏移"),
    "rig_range": ("Out of\nrange", "超量程"),
    "rig_estop": ("Press the\ne-stop", "按下\n硬件急停"),
    "rig_release": ("Release the\ne-stop", "释放\n硬件急停"),
    "rig_heal": ("Heal all", "全部恢复"),
    "rig_planted": ("■ {kind} on {frame}", "■ 已植入 {frame}：{kind}"),
    "rig_healed": ("● No fault planted", "● 无故障"),
}
