import pytest

from mbpam_ros.actuator.tables import read_columns, read_table
from mbpam_ros.configuration import ConfigError


@pytest.fixture
def table(tmp_path, monkeypatch):
    monkeypatch.setenv("MBPAM_CONFIG_DIR", str(tmp_path))
    (tmp_path / "gripper.yaml").touch()
    (tmp_path / "data").mkdir()

    def write(text):
        (tmp_path / "data" / "t.csv").write_text(text, encoding="utf-8")
        return "t.csv"

    return write


def test_columns_come_in_the_order_asked_for(table):
    assert read_table(table("a,b\n1,2\n3,4\n"), "b", "a").tolist() == [[2.0, 4.0], [1.0, 3.0]]


def test_one_row_is_a_table_too(table):
    assert read_table(table("a,b\n1,2\n"), "b").tolist() == [[2.0]]


def test_a_missing_column_is_named(table):
    with pytest.raises(ConfigError, match="missing column c"):
        read_table(table("a,b\n1,2\n"), "a", "c")


@pytest.mark.parametrize("bad", ["1,two", "1,nan", "1,inf", "1,"])
def test_what_is_no_finite_number_is_refused(table, bad):
    with pytest.raises(ConfigError, match="finite numbers"):
        read_table(table(f"a,b\n1,2\n{bad}\n"), "a", "b")


def test_a_row_of_the_wrong_length_is_refused(table):
    with pytest.raises(ConfigError, match="t.csv"):
        read_table(table("a,b\n1,2\n1,2,3\n"), "a")


def test_an_empty_table_is_refused(table):
    with pytest.raises(ConfigError, match="t.csv"):
        read_table(table("a,b\n"), "a")


def test_a_missing_file_is_refused(table):
    with pytest.raises(ConfigError, match="no such file"):
        read_table("absent.csv", "a")


def test_a_table_of_the_users_is_read_from_its_path_and_a_bad_one_is_one_clear_line(tmp_path):
    path = tmp_path / "own.csv"
    path.write_text("a,b\n1,2\n3,4\n", encoding="utf-8")
    assert read_columns(path, "a").tolist() == [[1.0, 3.0]]
    with pytest.raises(ConfigError, match="nowhere.csv: no such file"):
        read_columns(tmp_path / "nowhere.csv", "a")
    path.write_text("a,b\n1,2\n3\n4,5,6\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="not a table") as caught:
        read_columns(path, "a")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("text", "message"), [("", "empty"), ("a,b\n", "expected finite numbers in a")])
def test_a_table_without_rows_is_refused(text, message, tmp_path, recwarn):
    path = tmp_path / "own.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_columns(path, "a")
    assert not recwarn.list
