import io

import pytest

from mbpam_ros.study import progress_bar
from mbpam_ros.study.progress_bar import ProgressBar


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress_bar.time, "monotonic", lambda: now[0])
    return now


def run(bar, clock):
    bar.start(total=4, done=2)
    clock[0] += 30.0
    bar.job_ended("third")
    bar.refresh()
    clock[0] += 30.0
    bar.job_ended("fourth")


def test_in_a_file_each_job_is_a_plain_line(clock):
    stream = io.StringIO()
    run(ProgressBar(stream), clock)
    assert stream.getvalue() == "[3/4] third\n[4/4] fourth\n"


def test_on_a_terminal_a_bar_stands_below_the_lines_and_is_gone_at_the_end(clock):
    stream = Terminal()
    run(ProgressBar(stream), clock)
    drawn = stream.getvalue().split("\r\x1b[K")
    assert "[############............] 2/4  0:00" in drawn
    assert "[##################......] 3/4  0:30, 0:30 left" in drawn
    assert drawn[-1] == "[4/4] fourth\n"


def test_nothing_to_do_is_no_division_by_zero():
    ProgressBar(Terminal()).start(total=0, done=0)
