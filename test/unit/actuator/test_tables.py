import numpy as np
import pytest

from mbpam_ros.actuator.tables import TableError, read_columns, read_labelled_columns, read_table
from mbpam_ros.configuration import ConfigError

ROWS = [[1.5, 2.25], [0.125, -3.0]]
"""What each table below that can be read holds in its columns a_mm and f_n."""


@pytest.fixture
def own(tmp_path):
    """Write a table and return its path."""

    def write(content):
        path = tmp_path / "own.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        return path

    return write


def refusal(path, *columns):
    with pytest.raises(TableError) as caught:
        read_columns(path, *columns)
    said = str(caught.value)
    assert said.startswith(f"{path}: ") and said.isprintable() and len(said) < len(str(path)) + 320
    return said.removeprefix(f"{path}: ")


def test_a_table_of_the_package_is_found_by_its_name(tmp_path, monkeypatch):
    monkeypatch.setenv("MBPAM_CONFIG_DIR", str(tmp_path))
    (tmp_path / "gripper.yaml").touch()
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "t.csv").write_text("a,b\n1,2\n3,4\n", encoding="utf-8")
    assert read_table("t.csv", "b", "a").tolist() == [[2.0, 4.0], [1.0, 3.0]]
    with pytest.raises(ConfigError, match="absent.csv: no such file"):
        read_table("absent.csv", "a")


def test_columns_come_in_the_order_asked_for_one_row_is_a_table_too(own):
    path = own("a,b\n1,2\n")
    assert read_columns(path, "b", "a").tolist() == [[2.0], [1.0]]
    assert read_columns(path, "b").shape == (1, 1)


@pytest.mark.parametrize(
    "text",
    [
        "a_mm,f_n\n1.5,0.125\n2.25,-3\n",
        "\ufeffa_mm,f_n\n1.5,0.125\n2.25,-3\n",
        "a_mm,f_n\r\n1.5,0.125\r\n2.25,-3\r\n",
        "a_mm,f_n\r1.5,0.125\r2.25,-3\r",
        "a_mm,f_n\n1.5,0.125\n2.25,-3",
        "a_mm;f_n\n1.5;0.125\n2.25;-3\n",
        "a_mm\tf_n\n1.5\t0.125\n2.25\t-3\n",
        "a_mm;f_n\n1,5;0,125\n2,25;-3\n",
        "a_mm\tf_n\n1,5\t0,125\n2,25\t-3,0\n",
        '"a_mm","f_n"\n"1.5","0.125"\n"2.25","-3"\n',
        'a_mm,f_n\n"1,5","0,125"\n"2,25",-3\n',
        'a_mm, "f_n"\n1.5, "0.125"\n2.25, "-3"\n',
        "A_mm , F_N\n 1.5 ,\u00a00.125\n2.25,-3\n",
        "f_n,a_mm\n.125,1.5e0\n-3.,+225E-2\n",
        "a_mm,f_n\n1.5,0.125\n2.25,\u22123\n",
        "a_mm,f_n\n\n1.5,0.125\n,\n  \n2.25,-3\n,,,,\n\n",
        '# of the press, 3 May\na_mm,f_n\n1.5,0.125\n# said "half\n2.25,-3\n',
        '"# of the press, 3 May",\na_mm,f_n\n1.5,0.125\n2.25,-3\n',
        "# a_mm,f_n\n1.5,0.125\n2.25,-3\n",
        "a_mm,f_n\nmm,N\n1.5,0.125\n2.25,-3\n",
        "a_mm,note,f_n\n[mm],-,(N)\n\n1.5,mm,0.125\n2.25,,-3\n",
        "note,a_mm,f_n,,\nx,1.5,0.125,nan,7\n,2.25,-3,,\n",
        'a_mm,note,f_n\n1.5,"two\nlines, ""quoted""\n# no comment",0.125\n2.25,\u2603,-3\n',
        "a_mm,note,f_n,note\n1.5,1,0.125,2\n2.25,1_000,-3,0x1\n",
        "a_mm,f_n,\n1.5,0.125,\n2.25,-3,\n",
        "a_mm;f_n\n1.5;0.125;;\n2.25;-3;;\n",
        "a_mm\tf_n\n1.5\t0.125\t\n2.25\t-3\t\n",
        "sep=;\nType;pull;\nSpeed (mm/min);450;\n;;\na_mm;f_n;\n1.5;0.125;\n2.25;-3;\n",
        "a_mm,f_n,note\n1.5,0.125,x\n2.25,-3," + "y" * 100_000 + "\n",
        "a_mm,f_n" + ",note" * 50_000 + "\n1.5,0.125" + ",x" * 50_000 + "\n2.25,-3" + "," * 50_000 + "\n",
    ],
    ids=lambda text: ascii(text[:40]),
)
def test_a_table_is_read_as_people_have_it(text, own):
    assert read_columns(own(text), "a_mm", "f_n").tolist() == ROWS


def test_the_table_of_a_testing_machine_stands_beneath_its_description(own):
    path = own(
        "PARAMETER;INFO;URL;;\nSpecimen Width (mm);6;;;\nLab;Univ., Annecy;https://example.org/a;;\n;;;;\n"
        "Time (s);True Strain;True Stress (MPa);Engineering Strain;Engineering Stress (MPa)\n"
        "0.2;0.0436;0.0181;0.0446;0.01736\n0.3;0.0657;0.0327;0.0679;0.02964\n"
    )
    read = read_columns(path, "Engineering stress (MPa)", "Time (s)")
    assert read.tolist() == [[0.01736, 0.02964], [0.2, 0.3]]
    assert "missing column Engineering stress (mPa)" in refusal(path, "Engineering stress (mPa)", "Time (s)")


def test_numpys_own_table_is_read(tmp_path):
    path = tmp_path / "own.csv"
    np.savetxt(path, np.transpose(ROWS), delimiter=";", header="a_mm;f_n")
    assert read_columns(path, "a_mm", "f_n").tolist() == ROWS


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a;b\n1,234;2,345\n", "line 2, column a: '1,234' may have decimals or thousands"),
        ("a\tb\n950\t1.234\n", "line 2, column b: '1.234' may have decimals or thousands"),
        ('a,b\n"1,234",950\n', "line 2, column a: '1,234' may have decimals or thousands"),
        ("a;b\n1.234,5;2\n", "line 2, column a: '1.234,5' is not a plain number"),
        ('a,b\n"1,234.5",2\n', "line 2, column a: '1,234.5' is not a plain number"),
        ('a,b\n"1,234,567",2\n', "line 2, column a: '1,234,567' is not a plain number"),
        ("a;b\n1;0,5\n1.5;2\n", "line 3, column a: '1.5', but '0,5' in line 2, column b; write decimals with a point"),
        ('a,b\n1,0.5\n1,"2,5"\n', "line 3, column b: '2,5', but '0.5' in line 2, column b"),
        ("a,b\n1,5,2,5\n", "line 2: 4 cells, but line 1 has 2"),
        ("a,b\n2,5,\n", "line 2: 3 cells, but line 1 has 2; give each row as many, separated by comma"),
        ("a,b,\n2,5\n", "line 2: 2 cells, but line 1 has 3"),
        ("a\n2,5\n", "line 2: 2 cells, but line 1 has 1"),
    ],
)
def test_a_decimal_comma_and_thousands_are_never_guessed(text, message, own):
    columns = text.split("\n")[0].replace(";", ",").replace("\t", ",").split(",")
    assert message in refusal(own(text), *columns)


def test_a_point_among_commas_marks_decimals(own):
    assert read_columns(own("a,b\n1.500,2.250\n"), "a", "b").tolist() == [[1.5], [2.25]]


def test_one_number_that_has_no_thousands_tells_what_the_comma_means_in_the_others(own):
    assert read_columns(own("a;b\n1,234;0,5\n"), "a", "b").tolist() == [[1.234], [0.5]]


@pytest.mark.parametrize(
    "cell",
    "two nan -inf 1_000 0x1f 1d3 1.2.3 --1 1'234 5mm 5% =A1 #REF! 1e . TRUE".split()
    + ["1\u00a0234", "1 234", "\u0661\u0662", "\uff11", "\u20131", "1\ufeff"],
)
def test_what_is_no_plain_number_is_refused_with_its_place(cell, own):
    said = refusal(own(f"a_mm,b_mm\n1,2\n\n3,{cell}\n"), "a_mm", "b_mm")
    assert said == (
        f"line 4, column b_mm: {cell!r} is not a plain number; expected one like 1234.5, without unit or thousands "
        "separator"
    )


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,", "line 3, column b: empty; expected"),
        ("1,1e999", "line 3, column b: '1e999' is too large; expected a finite number"),
        ("1," + "9" * 5000, "9...' is too large"),
        ("1," + "x" * 5000, "xxx...' is not a plain number"),
        ("1", "line 3: 1 cells, but line 1 has 2; give each row as many, separated by comma"),
        ("1,2,3", "line 3: 3 cells, but line 1 has 2"),
        ("1,2 # why", "line 3, column b: '2 # why' is not a plain number"),
        ("a,b", "line 3, column a: 'a' is not a plain number"),
        ('1,"2', "line 3: its quotes do not pair up"),
        ('1,"2"3', "line 3: its quotes do not pair up"),
        ("1," + "3" * 200_000, "line 3: its quotes do not pair up, or a cell has over"),
    ],
    ids=lambda text: text[:20],
)
def test_a_bad_row_is_named(row, message, own):
    assert message in refusal(own(f"a,b\n1,2\n{row}\n4,5\n"), "a", "b")


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("a,c", "missing column b; line 1 has 'a', 'c'; name it so there"),
        ("x,y", "missing column a, b; line 1 has 'x', 'y'"),
        ("5,7", "line 1: numbers, where column names are expected; put a line with a, b above"),
        ("1\n2\na,b", "line 1: numbers above the column names in line 3"),
        ("a,b,A", "line 1: column a stands 2 times (cells 1 and 3); remove or rename all but one"),
        ('"a,b', "line 1: its quotes do not pair up"),
        ("x," * 5000 + "y", "'x', ..."),
    ],
    ids=lambda text: text[:20],
)
def test_a_bad_line_of_names_is_named(header, message, own):
    assert message in refusal(own(f"{header}\n1,2,3\n"), "a", "b")


def test_a_name_that_two_separators_yield_is_refused(own):
    said = refusal(own("a,x;a\n1,2;3\n"), "a")
    assert "more than one separator: comma (line 1), semicolon (line 1); use one throughout" in said


def test_other_columns_may_be_repeated(own):
    assert read_columns(own("a,x,x\n1,2,3\n"), "a").tolist() == [[1.0]]


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ("m,N,-", "line 2, column a_mm: 'm' is neither a number nor the unit of that name (mm); convert the column"),
        ("mm,kN,-", "line 2, column f_n: 'kN' is neither a number nor the unit of that name (n)"),
        ("mm,N,%", "line 2, column strain: '%' is neither a number nor the unit of that name (none)"),
        ("x,y,z", "line 2, column a_mm: 'x' is neither"),
        ("mm,N,1", "line 2, column a_mm: 'mm' is not a plain number"),
        (",,", "line 3, column a_mm: 'mm' is not a plain number"),
    ],
)
def test_a_row_of_units_may_not_contradict_the_names(units, message, own):
    text = f"a_mm,f_n,strain\n{units}\n1,2,3\n" if units != ",," else "a_mm,f_n,strain\n1,2,3\nmm,N,-\n"
    assert message in refusal(own(text), "a_mm", "f_n", "strain")


def test_a_first_row_without_any_value_is_no_row_of_units(own):
    assert "line 2, column a_mm: empty" in refusal(own("a_mm,note_mm\n,mm\n1,2\n"), "a_mm")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty; expected a line of column names"),
        (b"\n# nothing\n,,\n", "empty"),
        (b"a,b\n", "line 1: no rows beneath the column names, but for comments (#)"),
        (b"a,b\n#1,2\n", "line 1: no rows beneath the column names, but for comments (#)"),
        (b"a,b\n-,-\n", "line 2, column a: '-' is not a plain number"),
        ("a,b\n1,2\n".encode("utf-16"), "UTF-16 text, not CSV: save it as CSV UTF-8"),
        ("a,b\n1,2\n".encode("utf-16-le"), "line 1: a NUL byte, as UTF-16 text and binary files have: save it as CSV"),
        (b"a,b\n1,2\n\0\n", "line 3: a NUL byte"),
        ("a,b,\u00b0\n1,2,3\n".encode("latin-1"), "line 1: byte 0xb0 is not UTF-8, but of an older encoding: save it"),
        ("\ufeffa,b\r1,2\r\u00b0".encode() + b"\xb0", "line 3: byte 0xb0"),
        (b"PK\x03\x04\x14\0", "a workbook (.xlsx, .ods) or another zip file, not CSV: save it as CSV UTF-8"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1", "an old Excel workbook (.xls), not CSV"),
    ],
    ids=lambda value: ascii(value[:20]),
)
def test_what_is_no_table_is_refused_by_name(content, message, own):
    assert message in refusal(own(content), "a", "b")


def test_what_cannot_be_opened_is_refused(tmp_path):
    assert refusal(tmp_path / "nowhere.csv", "a") == "no such file"
    assert refusal(tmp_path, "a") == "cannot be read: Is a directory"
    with pytest.raises(TableError, match="cannot be read: embedded null byte"):
        read_columns(tmp_path / "a\0b.csv", "a")


def test_labels_are_text_and_stay_beside_their_numbers(own):
    path = own("model,r2,response,rmse\n,-,,mm/mm\nPRS,0.99,angle,0.5\n,,,\n7,1,angle,2\n")
    labels, values = read_labelled_columns(path, ("model", "response"), "rmse", "r2")
    assert labels == [("PRS", "angle"), ("7", "angle")]
    assert values.tolist() == [[0.5, 2.0], [0.99, 1.0]]
    with pytest.raises(TableError, match="line 3, column model: empty; expected a name"):
        read_labelled_columns(own("model,r2\nPRS,1\n,2\n"), ("model",), "r2")


def test_a_long_table_is_read_in_one_go(own):
    numbers = np.random.default_rng(0).normal(size=(4, 10_000))
    lines = [",".join(map(repr, row)) for row in numbers.T.tolist()]
    assert np.array_equal(read_columns(own("\n".join(["a,b,c,d", *lines])), *"abcd"), numbers)
