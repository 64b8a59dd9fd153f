import csv
import io

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mbpam_ros.actuator.tables import TableError, read_columns
from mbpam_ros.configuration import ConfigError

ASKED = ("a_mm", "theta_max_deg", "n")
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
ROWS = st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=6)
TEXT = st.text(st.characters(blacklist_categories=("Cs",), blacklist_characters="\0"), max_size=8)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("tables") / "own.csv"


@st.composite
def written(draw):
    """Draw rows of numbers, and a file that holds them in one of the ways people have tables."""
    rows = draw(ROWS)
    separator, mark = draw(st.sampled_from([(",", "."), (";", "."), ("\t", "."), (";", ","), ("\t", ","), (",", ",")]))
    plain = [0.5] * len(ASKED)  # shows what the mark means, whatever the others are
    order = draw(st.permutations([*range(len(ASKED)), "note"]))
    shown = [[ASKED[place] if place != "note" else "note" for place in order]]
    if draw(st.booleans()):
        shown.append([("mm", "deg", "-")[place] if place != "note" else draw(TEXT) for place in order])
    for row in [plain, *rows]:
        cells = [repr(row[place]).replace(".", mark) if place != "note" else draw(TEXT) for place in order]
        shown += [cells, *draw(st.lists(st.sampled_from([[""] * len(order), []]), max_size=1))]
    quoting = draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL, csv.QUOTE_NONNUMERIC]))
    file = io.StringIO()
    for cells in shown:
        if draw(st.integers(0, 4)) == 0:
            file.write('# "of, the; press\t1,5\r\n')
        # A text that begins with # would make its row a comment.
        if cells and cells[0].lstrip().startswith("#"):
            cells = ["x", *cells[1:]]
        csv.writer(file, delimiter=separator, quoting=quoting).writerow(cells)
    text = file.getvalue().replace("\r\n", draw(st.sampled_from(["\n", "\r\n", "\r"])))
    return [plain, *rows], text.encode(draw(st.sampled_from(["utf-8", "utf-8-sig"])))


@settings(max_examples=400)
@given(written())
def test_a_table_reads_back_to_the_same_numbers_however_it_is_written(path, table):
    rows, content = table
    path.write_bytes(content)
    read = read_columns(path, *ASKED)
    assert read.shape == (len(ASKED), len(rows))
    assert read.T.tobytes() == np.array(rows).tobytes()


@settings(max_examples=200)
@given(written(), st.data())
def test_a_table_with_one_byte_changed_is_read_or_refused(path, table, data):
    content = bytearray(table[1])
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    require_finite_or_refused(path, bytes(content), ASKED)


@settings(max_examples=300)
@given(st.binary(max_size=200))
@example(b"\xef\xbb\xbf")
@example(b"a\r\xff")
@example(b"\xff\xfea")
def test_any_bytes_are_read_or_refused(path, content):
    require_finite_or_refused(path, b"a,b\n" + content, ("a",))
    require_finite_or_refused(path, content, ("a",))


@settings(max_examples=600)
@given(
    st.text(st.sampled_from('ab1 2.,;\t\n\r"#-+eE_\u2212\u00a0\u0663m'), max_size=30),
    st.sampled_from([("a",), ("a", "b")]),
)
def test_any_text_of_what_tables_are_made_of_is_read_or_refused(path, text, asked):
    require_finite_or_refused(path, text.encode("utf-8"), asked)
    require_finite_or_refused(path, f"a;b\n{text}".encode(), asked)


@settings(max_examples=300)
@given(TEXT | st.text(st.sampled_from("0123456789.,-+eE_ \u2212\u0663\u00a0"), max_size=6))
@example("\u22125")
def test_a_cell_is_the_number_that_python_reads_there_or_refused(path, text):
    file = io.StringIO()
    csv.writer(file).writerows([["a", "b"], [text, "0.5"]])
    path.write_bytes(file.getvalue().encode("utf-8"))
    try:
        read = read_columns(path, "a", "b")
    except TableError:
        return
    assert read.tolist() == [[float(text.replace("\u2212", "-"))], [0.5]]


def require_finite_or_refused(path, content, asked):
    path.write_bytes(content)
    try:
        read = read_columns(path, *asked)
    except ConfigError as error:
        assert str(error).startswith(f"{path}: ") and str(error).isprintable()
        return
    assert read.shape[0] == len(asked) and read.shape[1] > 0 and np.all(np.isfinite(read))
