import pytest

from mbpam_ros.study.announcement import announce


@pytest.mark.parametrize(
    ("expected_s", "said"),
    [(5.2, "5 s"), (14.4, "14 s"), (250.0, "4 min"), (3000.0, "50 min"), (9000.0, "2 h"), (4e5, "110 h")],
)
def test_what_takes_longer_than_a_person_waits_is_said_in_round_figures(expected_s, said, capsys):
    assert announce("12 fits", expected_s)
    assert capsys.readouterr().err == f"12 fits: takes about {said}\n"


def test_what_is_quick_is_not_announced(capsys):
    assert not announce("12 fits", 4.9)
    assert capsys.readouterr().err == ""
