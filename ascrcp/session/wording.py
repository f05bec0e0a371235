"""Say an error in Chinese: its kind always, and whole where the operator is likely to meet it."""

import re

from ascrcp.core.errors import (
    AscrcpError,
    ConfigError,
    DefectError,
    DeviceError,
    InputError,
    NothingToSprayError,
    RecognitionError,
    RefusedError,
    UnreachableError,
)

KINDS: tuple[tuple[type[AscrcpError], str], ...] = (
    (DefectError, "程序内部错误"),
    (ConfigError, "配置有误"),
    (RecognitionError, "无法识别隧道"),
    (NothingToSprayError, "没有可喷涂的部位"),
    (InputError, "输入数据有误"),
    (UnreachableError, "机械臂无法到达"),
    (DeviceError, "设备故障"),
    (RefusedError, "当前不允许该操作"),
    (AscrcpError, "操作未完成"),
)
"""The first that fits names an error whose sentence is not in the table below."""

SENTENCES: tuple[tuple[str, str], ...] = (
    (r"pan head sends no angle for (\d+) ms.*", r"云台已 \1 ms 未发送角度，允许 100 ms。"),
    (r"pan head did not reach ([-\d.]+) deg in ([\d.]+) s", r"云台在 \2 秒内未到达 \1°。"),
    (r"pan head stuck at ([-\d.]+) deg.*", r"扫描时云台卡在 \1°。"),
    (r"the arm moved while scanning.*", "扫描时机械臂发生移动；扫描期间必须静止。"),
    (r"lidar reports status (\d+).*", r"激光雷达报告状态异常（\1）。"),
    (r"lidar missed (\d+) of (\d+) lines.*", r"激光雷达漏发 \1/\2 行数据。"),
    (r".*lidar.*cannot connect.*", "无法连接激光雷达。"),
    (r".*lidar.*no new scan within ([\d.]+) s.*", r"激光雷达在 \1 秒内无新数据。"),
    (r".*lidar.*", "激光雷达故障。"),
    (r"joint sensors ([\d, ]+) (?:have|has) not been heard.*", r"尚未收到关节传感器 \1 的数据。"),
    (r"joint sensor (\d+) .*while scanning.*", r"扫描时关节传感器 \1 无有效数据。"),
    (r"the machine has not been heard yet", "尚未收到设备数据。"),
    (r"no progress for ([\d.]+) s: joint (.+) does not follow", r"\1 秒内无进展：关节“\2”未跟随。"),
    (r"no progress for ([\d.]+) s: the controller is not enabled", r"\1 秒内无进展：运动控制器未使能。"),
    (r"joint (.+) stands ([\d.]+) rad or m from the sequence.*", r"关节“\1”偏离序列起点 \2（弧度或米）。"),
    (r"joint (.+) ends ([\d.]+) .*off its target", r"关节“\1”停止时偏离目标 \2（弧度或米）。"),
    (
        r"planned point (\d+) is missed by (\d+) mm, ([\d.]+) deg;.*",
        r"规划点 \1 偏差 \2 mm、\3°，超出允许范围。",
    ),
    (
        r"the scan shows (\d+) % of the arches of the first one, needed (\d+) %",
        r"复扫仅见首次扫描钢拱的 \1 %，至少需要 \2 %。",
    ),
    (
        r"(\d+) % of the wall lies more than (\d+) mm deeper than before, allowed (\d+) %.*",
        r"壁面有 \1 % 比首次扫描深 \2 mm 以上，允许 \3 %：可能不是同一掌子面。",
    ),
    (r"registration: the two scans did not settle.*", "两次扫描无法配准：可能不是同一掌子面。"),
    (
        r".*joints\.csv: names point (\d+), the path has (\d+);.*",
        r"关节序列含第 \1 点，而轨迹只有 \2 点：请重新解算。",
    ),
    (r"the joint sequence may not be run: (.*)", r"关节序列未通过运行前检查：\1"),
    (r"no joint sequence is loaded", "尚未读取关节序列。"),
    (r"no part of the plan can be steered.*", "规划面上没有可操纵的区域。"),
    (r"the nozzle stands ([\d.]+) m from the plan.*", r"喷头距规划面 \1 m：请先运动至初始点。"),
    (r"the compute process died while running (\w+).*", r"计算进程在执行 \1 时退出；下次使用时将重新启动。"),
    (r"no tunnel found: the cloud is too sparse.*", "未识别到隧道：点云过于稀疏。"),
    (
        r"no tunnel found: the surfaces run (\d+) deg off base X, allowed (\d+) deg",
        r"未识别到隧道：壁面与基座 X 轴夹角 \1°，允许 \2°。",
    ),
    (r"no tunnel found: only (\d+) points lie near the machine.*", r"未识别到隧道：设备附近仅 \1 个点。"),
    (
        r"no tunnel found: the largest connected part has (\d+) points.*",
        r"未识别到隧道：最大连通部分仅 \1 个点。",
    ),
    (
        r"no tunnel found: only (\d+) points lie near the line of profile (\S+).*",
        r"未识别到隧道：仅 \1 个点靠近断面“\2”的设计线。",
    ),
    (r"no tunnel found: too little wall.*", "未识别到隧道：可见壁面过少，无法拟合轴线。"),
    (r"registration: too few points.*", "两次扫描配准失败：点数过少。"),
    (
        r"registration: what both scans show leaves a direction open.*",
        "两次扫描配准失败：共同可见部分不足以定位。",
    ),
    (
        r"registration: only (\d+) % of the second scan lies on the first, needed (\d+) %.*",
        r"两次扫描配准失败：仅 \1 % 的点与首次扫描重合，需 \2 %。",
    ),
    (
        r"registration: the scans agree to (\d+) mm only, allowed (\d+) mm",
        r"两次扫描配准失败：残差 \1 mm，允许 \2 mm。",
    ),
    (
        r"the scan shows (\d+) % of the wall of the first one, needed (\d+) %",
        r"本次扫描仅覆盖首次壁面的 \1 %，需 \2 %。",
    ),
    (r"the heading has no bay to spray.*", "未识别到可喷涂的拱间面。"),
    (r"no point of the wall can be sprayed.*", "壁面上没有可喷涂的点。"),
    (r"nothing left to spray.*", "已无需补喷。"),
    (r"the unrolled wall holds no value.*", "展开壁面无有效数据。"),
    (r"none of the (\d+) planned points has a joint solution.*", r"\1 个规划点均无关节解。"),
    (r"move target .* lies outside the joints' limits", "目标位姿超出关节限位。"),
    (r".*: No space left on device.*", "磁盘空间不足。"),
    (r".*: Read-only file system.*", "磁盘为只读。"),
    (r"CAN bus .* cannot be opened.*", "无法打开 CAN 总线。"),
    (r"reset is not accepted: .*", "复位未被接受。"),
    (r".*: not there; run `ascrcp (\w+)` on this round first", r"缺少数据：请先执行上一步骤（\1）。"),
)
"""English sentence as a pattern -> Chinese sentence."""

_TABLE = tuple((re.compile(pattern, re.DOTALL), chinese) for pattern, chinese in SENTENCES)


def say_chinese(error: BaseException) -> str:
    """Return an error's sentence in Chinese; its English detail stays only behind the kind's name."""
    own = getattr(error, "chinese", "")
    if own:
        return str(own)
    text = str(error)
    for pattern, chinese in _TABLE:
        found = pattern.fullmatch(text)
        if found:
            return found.expand(chinese)
    kind = next((name for cls, name in KINDS if isinstance(error, cls)), "程序内部错误")
    return f"{kind}：{text}"
