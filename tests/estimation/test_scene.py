import numpy as np

from estimation.output.scene import Field, choose_rows, json_numbers, page_colours, show_markers


def test_markers_have_a_sign_each_and_those_not_seen_are_left_out():
    spots = np.array([[[1.0, 2.04], [3.0, 4.0], [5.0, 6.0], [np.nan, 0.0]]] * 2)
    valid = np.array([True, True, True, True])
    stick, contact = np.array([True, False, False, True]), np.array([True, True, False, True])
    shown = show_markers(spots, valid, stick, contact)
    assert shown == {"spots": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0] * 2, "kinds": "ox." * 2}
    assert show_markers(spots, ~valid, stick, contact) == {"spots": [], "kinds": ""}
    assert set("ox.") == set(page_colours()["markers"])
    assert json_numbers([0.12345, np.nan, np.inf], 2) == [0.12, None, None]


def test_a_field_lies_as_the_source_sees_it():
    reference = np.array([[0.0, 0.0, 1.0], [10.0, 0.0, 1.0], [0.0, 5.0, 1.0]])
    up, down = (Field.around(reference, down) for down in (False, True))
    assert up.size[0] == 640 > up.size[1]
    for field in (up, down):
        spots = field.place(reference)
        assert (spots > 0.0).all()
        assert (spots < field.size).all()
        assert spots[1, 0] > spots[0, 0]
    assert up.place(reference)[2, 1] < up.place(reference)[0, 1]
    assert down.place(reference)[2, 1] > down.place(reference)[0, 1]


def test_a_figure_of_a_long_stream_keeps_its_extremes():
    long = np.sin(np.arange(50_000) / 700.0)
    long[12_345], long[33_333], long[40_000:] = 5.0, -5.0, np.nan
    other = np.zeros(len(long))
    other[777] = 1.0
    rows = choose_rows(long, other)
    assert {0, 777, 12_345, 33_333, len(long) - 1} <= set(rows.tolist())
    assert len(rows) < 9_000
    assert np.isnan(long[rows][rows >= 40_000]).all()  # a gap stays one
    np.testing.assert_array_equal(choose_rows(other[:8000]), np.arange(8000))
