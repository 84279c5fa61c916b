"""Files from outside are read, or refused with their name and the cause."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float

from contactmodel.common import inputs, settings
from contactmodel.common.stored import read_array, read_arrays


@dataclass(frozen=True)
class Inner:
    height: float = field(metadata=settings.unit("mm", above=0.0, most=3.0))


@dataclass(frozen=True)
class Everything:
    """A field of each kind that files have."""

    name: str
    count: int = 3
    flag: bool = False
    angle: float | None = field(default=None, metadata=settings.unit("deg"))
    shifts: tuple[float, float] = field(default=(0.0, 0.0), metadata=settings.unit("um"))
    names: tuple[str, ...] = ()
    rows: Float[np.ndarray, "n m"] | None = None
    inner: Inner | None = None
    each: tuple[Inner, ...] = ()
    other: Mapping[str, Any] = field(default_factory=dict)


GIVEN = {
    "name": "all",
    "count": 4,
    "flag": True,
    "angle_deg": 180.0,
    "shifts_um": [1.0, 2.0],
    "names": ["a", "b"],
    "rows": [[1.0, 2.0], [3.0, 4.0]],
    "inner": {"height_mm": 2.0},
    "each": [{"height_mm": 2.0}, {"height_mm": 3.0}],
    "other": {"any": ["thing", 1]},
}


def test_tables_are_read_into_dataclasses_and_written_back(tmp_path):
    read = settings.from_table(GIVEN, Everything)
    assert (read.angle, read.shifts) == (np.pi, (1e-3, 2e-3))  # rad, mm
    assert read.each == (Inner(2.0), Inner(3.0))
    np.testing.assert_array_equal(read.rows, [[1.0, 2.0], [3.0, 4.0]])
    path = tmp_path / "some.toml"
    path.write_text(settings.toml_text(read, 1), encoding="utf-8")
    again = settings.read_toml(path, 1)
    assert again.pop("shifts_um") == pytest.approx([1.0, 2.0], rel=1e-15)  # two roundings
    assert again == {key: value for key, value in GIVEN.items() if key != "shifts_um"}
    bare = {"name": "bare", "count": 3, "flag": False, "shifts_um": [0.0, 0.0]}
    assert settings.to_table(Everything("bare")) == bare


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"angle_deg": True}, "angle_deg must be a number, got True"),
        ({"angle_deg": [1.0]}, "angle_deg must be a number"),
        ({"angle_deg": 10**400}, "angle_deg is too large a number: an integer"),
        ({"angle_deg": np.inf}, "angle_deg is inf; it must be a number"),
        ({"count": 2.5}, "count must be a whole number below 2^53, got 2.5"),
        ({"count": np.inf}, "count must be a whole number"),
        ({"shifts_um": 3}, "shifts_um must be 2 numbers, got 3"),
        ({"shifts_um": [1.0]}, "shifts_um must be 2 numbers, got [1.0]"),
        ({"shifts_um": [1, "a"]}, "shifts_um #2 must be a number, got 'a'"),
        ({"shifts_um": [1, np.nan]}, "shifts_um is [1.0, nan]; it must be numbers"),
        ({"rows": [[1], [2, 3]]}, "rows must have rows of one length"),
        ({"rows": []}, "rows must have rows of one length"),
        ({"rows": [[1], ["a"]]}, "rows #2 #1 must be a number"),
        ({"flag": 1}, "flag must be true or false, got 1"),
        ({"name": ["a"]}, "name must be a text, got ['a']"),
        ({"names": "left"}, "names must be a list of texts"),
        ({"inner": [1]}, "inner must be a table, got [1]"),
        ({"inner": {"height": 1.0}}, "inner: unknown key 'height'; known are height_mm"),
        ({"inner": {}}, "inner: the key 'height_mm' is missing"),
        ({"inner": {"height_mm": 4.0}}, "height_mm is 4.0; it must be a number above 0 to 3"),
        ({"each": [{"height_mm": 1.0}, {"height_mm": 0}]}, "each #2: height_mm is 0.0; it must"),
        ({"other": 3}, "other must be a table, got 3"),
        ({"colour": 3}, "unknown key 'colour'; known are name, count"),
    ],
)
def test_values_of_another_kind_are_refused(changed, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        settings.from_table(GIVEN | changed, Everything)


def test_whole_numbers_may_have_a_point():
    assert settings.from_table({"name": "", "count": 640.0}, Everything).count == 640


@pytest.mark.parametrize("data", [b"a = \xff", b"a = ", b"a = " + b"[" * 5000])
def test_toml_that_is_none_is_named(tmp_path, data):
    (tmp_path / "some.toml").write_bytes(data)
    with pytest.raises(ValueError, match=r"some\.toml is not a"):
        settings.read_toml(tmp_path / "some.toml")


def test_tables_are_read_with_their_lines(tmp_path):
    path = tmp_path / "some.csv"
    path.write_text("\ufefftime , angle\n1, 2\n\n3\n", encoding="utf-8")
    assert inputs.read_rows(path, ("time",)) == [
        (f"{path}, line 2", {"time": "1", "angle": "2"}),
        (f"{path}, line 4", {"time": "3", "angle": ""}),
    ]
    path.write_text("# time,angle\n1,2\n")  # by numpy.savetxt
    assert inputs.read_rows(path, ("time",)) == [(f"{path}, line 2", {"time": "1", "angle": "2"})]
    for text, message in (("a\n1\n", "lacks the columns time"), ('time\n"1', "line 2, is not CSV")):
        path.write_text(text)
        with pytest.raises(ValueError, match=rf"some\.csv.*{message}"):
            inputs.read_rows(path, ("time",))


@pytest.mark.parametrize(
    "text",
    [
        "# run 7\n# units: s, deg\ntime,angle,note\n1,2,\n",
        "# run 7\ntime,angle,note\n1,2,\n",
        "# run 7\n# time,angle,note\n1,2,\n",
        "\n#time,angle,note\n1,2,\n",
    ],
)
def test_comments_at_the_top_of_a_table_are_passed_over(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    ((where, row),) = inputs.read_rows(path, ("time", "angle"))
    assert row == {"time": "1", "angle": "2", "note": ""}
    assert where.endswith(f"line {len(text.splitlines())}")


def test_a_comma_in_numbers_under_names_behind_a_mark_is_named(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("# time,angle\n0,5,2,1\n")
    with pytest.raises(ValueError, match="has 4 cells, but the file has 2 columns"):
        inputs.read_rows(path)


def test_rows_with_more_cells_than_columns_are_refused(tmp_path):
    path = tmp_path / "some.csv"
    path.write_text("time,angle\n1,2,,\n3,4,\n")  # empty cells at the end mean nothing
    assert [row for _, row in inputs.read_rows(path)] == [
        {"time": "1", "angle": "2"},
        {"time": "3", "angle": "4"},
    ]
    path.write_text("time,angle\n1,2\n3,4,5\n")
    message = "some.csv, line 3, has 3 cells, but the file has 2 columns (time,angle)"
    with pytest.raises(ValueError, match=re.escape(message)):
        inputs.read_rows(path)


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
