"""What a person sees while a command runs."""

import io
import types

import pytest

from mbpam_ros.nodes import progress
from mbpam_ros.nodes.progress import LiveLine, table


class Screen(io.StringIO):
    def __init__(self, terminal):
        super().__init__()
        self._terminal = terminal

    def isatty(self):
        return self._terminal


@pytest.fixture
def clock(monkeypatch):
    now = types.SimpleNamespace(s=1000.0)
    monkeypatch.setattr(progress, "time", types.SimpleNamespace(monotonic=lambda: now.s))
    return now


@pytest.fixture
def screen(monkeypatch, request):
    shown = Screen(request.param)
    monkeypatch.setattr(progress, "sys", types.SimpleNamespace(stdout=shown))
    monkeypatch.setenv("COLUMNS", "20")
    return shown


@pytest.mark.parametrize("screen", [True], indirect=True)
def test_on_a_terminal_the_line_is_redrawn_in_place_at_most_ten_times_a_second(screen, clock):
    line = LiveLine()
    for step in range(100):
        clock.s = 1000.0 + 0.01 * step
        line.show(f"step {step}")
    shown = screen.getvalue()
    assert "\n" not in shown
    assert 9 <= shown.count("\r") <= 11
    assert shown.startswith("\r\x1b[Kstep 0")


@pytest.mark.parametrize("screen", [True], indirect=True)
def test_on_a_terminal_a_long_line_is_cut_to_the_width(screen, clock):
    LiveLine().show("x" * 100)
    assert screen.getvalue().count("x") == 19


@pytest.mark.parametrize("screen", [False], indirect=True)
def test_in_a_file_the_line_is_printed_every_three_seconds(screen, clock):
    line = LiveLine()
    for step in range(20):
        clock.s = 1000.0 + 0.5 * step
        line.show(f"at {step}")
    assert screen.getvalue() == "at 0\nat 6\nat 12\nat 18\n"


@pytest.mark.parametrize("screen", [False, True], indirect=True)
def test_what_is_said_stays_as_a_line_of_its_own(screen, clock):
    line = LiveLine()
    line.show("working")
    line.say("done")
    line.say("really")
    assert screen.getvalue().endswith("done\n\r\x1b[Kreally\n" if screen.isatty() else "done\nreally\n")


def test_a_table_is_as_wide_as_its_widest_cells():
    assert table(("object", "mm"), [("bulb", "60"), ("aluminium tube", "250")]).splitlines() == [
        "object          mm ",
        "--------------  ---",
        "bulb            60 ",
        "aluminium tube  250",
    ]


def test_a_table_without_rows_is_its_head():
    assert table(("object", "mm"), []).splitlines() == ["object  mm", "------  --"]


def test_a_row_with_a_cell_too_few_is_an_error():
    with pytest.raises(ValueError):
        table(("object", "mm"), [("bulb",)])
