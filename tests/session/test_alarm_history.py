"""The alarm history: what came first, what came with it, when each went."""

from hypothesis import given
from hypothesis import strategies as st

from ascrcp.session.alarm_history import KEPT, AlarmHistory


def test_first_out_keeps_its_rank_until_all_is_calm() -> None:
    history = AlarmHistory()
    history.update(1.0, ("joint_stale",))
    history.update(2.0, ("joint_stale", "bus_error"))
    history.update(3.0, ("bus_error",))
    history.update(4.0, ())
    history.update(5.0, ("bus_error",))
    told = [(a.code, a.began_s, a.ended_s, a.first) for a in history.alarms]
    assert told == [
        ("joint_stale", 1.0, 3.0, True),
        ("bus_error", 2.0, 4.0, False),
        ("bus_error", 5.0, None, True),
    ]


@given(st.lists(st.frozensets(st.sampled_from(["a", "b", "c"])), max_size=120))
def test_open_alarms_are_the_causes_in_force(moments: list[frozenset[str]]) -> None:
    history = AlarmHistory()
    for t, causes in enumerate(moments):
        history.update(float(t), tuple(sorted(causes)))
        assert {a.code for a in history.alarms if a.ended_s is None} == causes
        assert len(history.alarms) <= KEPT
    numbers = [a.number for a in history.alarms]
    assert numbers == sorted(set(numbers))
