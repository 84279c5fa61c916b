"""Files from outside are read, or refused with their name and the cause."""

import numpy as np
import pytest

from contactmodel.common import inputs
from contactmodel.common.stored import read_array, read_arrays


@pytest.mark.parametrize(
    ("read", "value", "message"),
    [
        (inputs.as_number, True, "must be a number, got True"),
        (inputs.as_number, [1.0], "must be a number"),
        (inputs.as_number, 10**400, "too large a number: an integer"),
        (inputs.as_whole, 2.5, "a whole number"),
        (inputs.as_whole, float("inf"), "a whole number"),
        (inputs.as_numbers, 3, "must be a list"),
        (inputs.as_numbers, [1, "a"], "each of key must be a number"),
        (inputs.as_matrix, [[1], [2, 3]], "rows of one length"),
        (inputs.as_matrix, [], "rows of one length"),
        (inputs.as_flag, 1, "true or false"),
        (inputs.as_text, ["a"], "must be a text"),
        (inputs.as_texts, "left", "must be a list"),
        (inputs.as_table, [1], "must be a table"),
    ],
)
def test_values_of_another_kind_are_refused(read, value, message):
    with pytest.raises(ValueError, match=message) as caught:
        read(value, "key")
    assert "key" in str(caught.value)


def test_whole_numbers_may_have_a_point():
    assert inputs.as_whole(640.0, "width") == 640


@pytest.mark.parametrize("data", [b"a = \xff", b"a = ", b"a = " + b"[" * 5000])
def test_toml_that_is_none_is_named(tmp_path, data):
    (tmp_path / "some.toml").write_bytes(data)
    with pytest.raises(ValueError, match=r"some\.toml is not a"):
        inputs.read_toml(tmp_path / "some.toml")


def test_tables_are_read_with_their_lines(tmp_path):
    path = tmp_path / "some.csv"
    path.write_text("\ufefftime , angle\n1, 2\n\n3\n", encoding="utf-8")
    assert inputs.read_rows(path, ("time",)) == [
        (f"{path}, line 2", {"time": "1", "angle": "2"}),
        (f"{path}, line 4", {"time": "3", "angle": ""}),
    ]
    for text, message in (("a\n1\n", "lacks the columns time"), ('time\n"1', "line 2, is not CSV")):
        path.write_text(text)
        with pytest.raises(ValueError, match=rf"some\.csv.*{message}"):
            inputs.read_rows(path, ("time",))


def test_arrays_are_read_whole_or_not_at_all(tmp_path):
    path, stored = tmp_path / "one.npy", np.arange(12.0).reshape(3, 4)
    np.save(path, stored)
    np.testing.assert_array_equal(read_array(path), stored)
    data = path.read_bytes()
    for spoiled in (data[:-1], data.replace(b"(3, 4)", b"(3,9**"), data.replace(b"}", b" "), b""):
        path.write_bytes(spoiled)
        with pytest.raises(ValueError, match=r"one\.npy is not a complete array"):
            read_array(path)
    np.savez(tmp_path / "all.npz", one=stored, two=np.array("text"))
    assert set(read_arrays(tmp_path / "all.npz")) == {"one", "two"}
    np.savez(tmp_path / "all.npz", one=np.array([object()]))
    with pytest.raises(ValueError, match=r"all\.npz is damaged.*Object arrays"):
        read_arrays(tmp_path / "all.npz")
