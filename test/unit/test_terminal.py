"""What a person sees while a command runs."""

import io
import types

import pytest

from mbpam_ros import terminal
from mbpam_ros.terminal import Progress, announce, table


class Screen(io.StringIO):
    def __init__(self, terminal):
        super().__init__()
        self._terminal = terminal

    def isatty(self):
        return self._terminal


@pytest.fixture
def clock(monkeypatch):
    now = types.SimpleNamespace(s=1000.0)
    monkeypatch.setattr(terminal, "time", types.SimpleNamespace(monotonic=lambda: now.s))
    return now


@pytest.fixture
def screen(monkeypatch, request):
    shown = Screen(request.param)
    monkeypatch.setattr(terminal, "sys", types.SimpleNamespace(stdout=shown))
    monkeypatch.setenv("COLUMNS", "20")
    return shown


@pytest.mark.parametrize("screen", [True], indirect=True)
def test_on_a_terminal_the_line_is_redrawn_in_place_at_most_ten_times_a_second(screen, clock):
    line = Progress()
    for step in range(100):
        clock.s = 1000.0 + 0.01 * step
        line.show(f"step {step}")
    shown = screen.getvalue()
    assert "\n" not in shown
    assert 9 <= shown.count("\r") <= 11
    assert shown.startswith("\r\x1b[Kstep 0")


@pytest.mark.parametrize("screen", [True], indirect=True)
def test_on_a_terminal_a_long_line_is_cut_to_the_width(screen, clock):
    Progress().show("x" * 100)
    assert screen.getvalue().count("x") == 19


@pytest.mark.parametrize("screen", [False], indirect=True)
def test_in_a_file_the_line_is_printed_every_three_seconds(screen, clock):
    line = Progress()
    for step in range(20):
        clock.s = 1000.0 + 0.5 * step
        line.show(f"at {step}")
    assert screen.getvalue() == "at 0\nat 6\nat 12\nat 18\n"


@pytest.mark.parametrize("screen", [False, True], indirect=True)
def test_what_is_said_stays_as_a_line_of_its_own(screen, clock):
    line = Progress()
    line.show("working")
    line.say("done")
    line.say("really")
    assert screen.getvalue().endswith("done\n\r\x1b[Kreally\n" if screen.isatty() else "done\nreally\n")


def test_a_table_is_as_wide_as_its_widest_cells():
    assert table(("object", "mm"), [("bulb", "60"), ("aluminium tube", "250")]).splitlines() == [
        "object          mm",
        "--------------  ---",
        "bulb            60",
        "aluminium tube  250",
    ]


def test_a_table_without_rows_is_its_head():
    assert table(("object", "mm"), []).splitlines() == ["object  mm", "------  --"]


def test_a_row_with_a_cell_too_few_is_an_error():
    with pytest.raises(ValueError):
        table(("object", "mm"), [("bulb",)])


def run_the_last_two_of_four(bar, clock):
    bar.start(total=4, done=2)
    clock.s += 30.0
    bar.job_ended("third")
    bar.refresh()
    clock.s += 30.0
    bar.job_ended("fourth")


def test_in_a_file_each_job_is_a_plain_line(clock):
    stream = Screen(terminal=False)
    run_the_last_two_of_four(Progress(stream), clock)
    assert stream.getvalue() == "[3/4] third\n[4/4] fourth\n"


def test_on_a_terminal_a_bar_stands_below_the_lines_and_is_gone_at_the_end(clock):
    stream = Screen(terminal=True)
    run_the_last_two_of_four(Progress(stream), clock)
    drawn = stream.getvalue().split("\r\x1b[K")
    assert "[############............] 2/4  0:00" in drawn
    assert "[##################......] 3/4  0:30, 0:30 left" in drawn
    assert drawn[-1] == "[4/4] fourth\n"


def test_nothing_to_do_is_no_division_by_zero():
    Progress(Screen(terminal=True)).start(total=0, done=0)


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
