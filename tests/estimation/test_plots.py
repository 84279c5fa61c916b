"""Maps of pictures lie as pictures do, and the chosen method fills its plot."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from estimation.estimators.grasp import compare_fingers
from estimation.estimators.result import Track
from estimation.frames.noise import Noise
from estimation.output.comparison_plots import plot_grasp, plot_overview
from estimation.output.plots import plot_angles, plot_maps
from estimation.pictures.reading import PictureSource
from estimation.tracking.tracker import estimate_angles
from tests.cases import lift


@pytest.fixture(scope="module")
def answered():
    recording = lift(np.radians(np.linspace(0.0, 10.0, 4)))
    return recording, estimate_angles(recording, noise=Noise.from_std(1e-3))


def test_maps_of_pictures_lie_as_the_pictures_do(answered):
    recording, result = answered
    taken = replace(recording, convention=PictureSource.convention)
    for one, down in ((recording, False), (taken, True)):
        figure = plot_maps(one, result, [1, 3])
        shown = [axis.get_ylim() for axis in figure.axes[:6]]
        assert all(bool(bottom > top) is down for bottom, top in shown)
        plt.close(figure)


def test_the_axis_of_the_angle_holds_the_chosen_method_and_no_more(answered):
    _, result = answered
    wild = replace(result, angle=result.angle + np.radians(300.0))
    figure = plot_angles({"tracked": result, "paper": wild}, "tracked")
    low, high = figure.axes[0].get_ylim()
    assert low < np.degrees(np.nanmin(result.low))
    assert np.degrees(np.nanmax(result.high)) < high < 20.0
    plt.close(figure)


def test_the_legend_names_what_is_drawn(answered):
    _, result = answered
    none = replace(result, method="rigid", angle=np.full(len(result.time), np.nan))
    imprint = np.radians(np.linspace(0.0, 10.0, len(result.time)))
    figure = plot_angles({"tracked": result, "rigid": none}, "tracked", {"imprint": imprint})
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert {"imprint", "tracked", "tracked, 95 % interval"} <= set(names)
    assert "rigid" not in names
    lines = {line.get_label(): line.get_zorder() for line in figure.axes[0].get_lines()}
    assert lines["imprint"] > lines["tracked"]  # else it is hidden under the angle
    plt.close(figure)


def test_the_legends_of_maps_and_overview_name_what_is_drawn(answered):
    recording, result = answered
    (legend,) = plot_maps(recording, result, [1, 3]).legends
    assert legend.get_texts()[-1].get_text() == "no contact (top and bottom: no value)"
    outline = np.zeros(len(result.time))
    axis = plot_overview({"left": result}, {"left": ("outline", outline)}).axes[0]
    names = [text.get_text() for text in axis.get_legend().get_texts()]
    bar = "bar on the zero line: macro slip"
    assert names == ["left: angle", "left: outline", "95 % interval", bar]
    plt.close("all")


def test_maps_show_no_sticking_markers_where_the_answer_was_withdrawn(answered):
    recording, result = answered

    row = int(np.argmax(result.stick_markers))

    def sticking(result):
        figure = plot_maps(recording, result, [row])
        return len(figure.axes[1].collections[0].get_offsets())

    assert sticking(result) == result.stick[row].sum() > 0
    assert sticking(replace(result, stick_markers=0 * result.stick_markers)) == 0
    plt.close("all")


def test_the_axis_of_the_angle_holds_the_truth(answered):
    _, result = answered
    truth = np.radians(np.linspace(0.0, -40.0, len(result.time)))
    figure = plot_angles({"tracked": result}, "tracked", {"truth": truth})
    assert figure.axes[0].get_ylim()[0] < -40.0
    plt.close(figure)


def test_a_long_stream_is_drawn_by_its_extremes(answered):
    _, result = answered
    track = Track(method="tracked", **{name: getattr(result, name) for name in Track.columns()})
    long = track.take(np.tile(np.arange(len(track.time)), 3000))
    long = replace(long, time=np.arange(len(long.time), dtype=float))
    top = plot_angles({"tracked": long}, "tracked").axes[0]
    drawn = top.lines[0].get_ydata()
    assert len(drawn) < len(long.time)
    assert np.nanmax(drawn) == pytest.approx(np.degrees(np.nanmax(result.angle)))
    spans = [collection for collection in top.collections if len(collection.get_paths()) > 1]
    assert 0 < len(spans) <= 5  # one artist for each state
    outline = np.zeros(len(long.time))
    overview = plot_overview({"left": long}, {"left": ("outline", outline)}).axes[0]
    first = long.take(slice(90))
    second = replace(first, angle=-first.angle, low=-first.high, high=-first.low)
    pair = compare_fingers(first, second)
    frames = {k: np.tile(v, 300) for k, v in pair._asdict().items() if isinstance(v, np.ndarray)}
    grasp = plot_grasp(pair._replace(**frames | {"time": long.time}), ["left", "right"]).axes[0]
    for axis in (overview, grasp):
        assert len(axis.lines[0].get_ydata()) < len(long.time)
    plt.close("all")
