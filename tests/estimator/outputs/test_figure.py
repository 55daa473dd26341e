"""The figure: its content and units, and that it is complete or absent."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimator.outputs.figure import figure, write_figure
from estimator.outputs.plan import COLOURS
from estimator.records.result import Curve, EvidenceReport, Interval, SceneEstimate
from metric_base.errors import InputError
from tests.support.drawn import SCALE, drawn_estimate
from tests.synthetic.small_scene import write_small_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("figure") / "whole"
    write_small_scene(place)
    return place / "colmap"


@pytest.fixture(scope="module")
def estimate(folder: Path) -> SceneEstimate:
    return drawn_estimate(folder)


def panels(drawn: Figure) -> tuple[Axes, Axes, Axes, Axes]:
    """Posterior, objects, plan and elevation."""
    head, body, above, side = drawn.axes
    return head, body, above, side


def test_the_posterior_with_interval_and_modes(estimate: SceneEstimate) -> None:
    head, _, _, _ = panels(figure(estimate))
    assert "0.5 m per scene unit" in head.get_title(loc="left")
    assert "90% between 0.4 and 0.6" in head.get_title(loc="left")
    lines = [float(line.get_xdata()[0]) for line in head.lines if len(line.get_xdata()) == 2]
    assert sorted(lines) == [SCALE, 0.9], "both modes are marked"
    (shade,) = head.collections
    corners = shade.get_paths()[0].get_extents()
    assert (corners.x0, corners.x1) == pytest.approx((0.4, 0.6), abs=0.005)


def test_the_interval_ends_at_the_same_place_in_both_panels(estimate: SceneEstimate) -> None:
    coarse = replace(estimate.result, curve=thinned(estimate.result.curve), object_curves={})
    (shade,) = panels(figure(replace(estimate, result=coarse)))[0].collections
    (band,) = panels(figure(estimate))[1].patches
    above = shade.get_paths()[0].get_extents()
    assert (above.x0, above.x1) == pytest.approx((0.4, 0.6), rel=1e-9)
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx((0.4, 0.6), rel=1e-9)


def thinned(curve: Curve | None) -> Curve:
    """Every 20th point, so that none is at the interval's ends."""
    assert curve is not None
    return Curve(curve.log_scale[::20], curve.density[::20], 0.0, 0.0)


def test_a_result_without_a_scene_is_drawn_alone(estimate: SceneEstimate) -> None:
    head, body = figure(estimate.result).axes
    assert "0.5 m per scene unit" in head.get_title(loc="left")
    assert len(body.get_yticklabels()) == 2


def test_every_object_has_a_row_of_its_own_in_the_colour_of_its_verdict(estimate: SceneEstimate) -> None:
    _, body, _, _ = panels(figure(estimate))
    labels = {label.get_text(): label.get_color() for label in body.get_yticklabels()}
    assert labels == {"chair 1": COLOURS["used"], "table 2": COLOURS["outlier"]}
    curves = [line for line in body.lines if len(line.get_xdata()) > 2]
    for curve, scale in zip(curves, (0.48, 0.9), strict=True):
        peak = curve.get_xdata()[np.nanargmin(curve.get_ydata())]
        assert peak == pytest.approx(scale, rel=0.02)
    assert "blue 1 used, orange 1 outliers; 0 skipped" in body.get_xlabel()


def test_the_plan_is_in_metres(estimate: SceneEstimate) -> None:
    _, _, above, side = panels(figure(estimate))
    sizes = sorted(tuple(sorted(patch.get_extents().bounds[2:])) for patch in outlines(above))
    # the boxes are along the axes: 0.6 x 0.4 and half of it, in units of half a metre
    assert sizes[-1] == pytest.approx((0.4 * SCALE, 0.6 * SCALE)), "furniture lies along the paper"
    heights = sorted(patch.get_extents().bounds[3] for patch in outlines(side))
    assert heights == pytest.approx([0.4 * SCALE, 0.8 * SCALE])
    areas = sorted(polygon_area(patch.vertices) for patch in outlines(above))
    assert areas == pytest.approx([0.3 * 0.2 * SCALE**2, 0.6 * 0.4 * SCALE**2])


def outlines(axes: Axes) -> list:
    return [patch.get_path() for patch in axes.patches if not patch.get_fill()]


def polygon_area(vertices: np.ndarray) -> float:
    x, y = vertices.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_written_in_the_format_of_its_name(suffix: str, estimate: SceneEstimate, tmp_path: Path) -> None:
    file = tmp_path / f"scale{suffix}"
    write_figure(estimate, file)
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
    assert file.read_bytes()[:4] in (b"\x89PNG", b"%PDF", b"<?xm")
    if suffix == ".png":
        assert cv2.imread(str(file)).std() > 10


def test_nothing_is_left_of_a_figure_that_fails(estimate: SceneEstimate, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in \.png"):
        write_figure(estimate, tmp_path / "scale.jpq")
    with pytest.raises(InputError, match="a place that can be written"):
        write_figure(estimate, tmp_path / "nowhere" / "scale.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="there is no limit of the size of files")
def test_a_pdf_on_a_full_disk_is_one_line(estimate: SceneEstimate, tmp_path: Path) -> None:
    """Half of the file fits; the PDF writer fails a second time when it is closed."""
    import resource

    write_figure(estimate, tmp_path / "whole.pdf")
    size = (tmp_path / "whole.pdf").stat().st_size
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size // 2, limits[1]))
    try:
        with pytest.raises(InputError, match="--figure: expected a place that can be written"):
            write_figure(estimate, tmp_path / "x.pdf")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [path.name for path in tmp_path.iterdir()] == ["whole.pdf"]


def test_a_method_that_measures_no_object_is_drawn_without_boxes(estimate: SceneEstimate) -> None:
    bare = replace(estimate, measurements=None, result=replace(estimate.result, up=None, object_curves={}))
    head, body, above, side = panels(figure(bare))
    assert head.axison
    assert not body.axison
    assert not above.axison
    assert not side.axison


def test_what_is_not_resolved_is_drawn_and_marked(estimate: SceneEstimate) -> None:
    wide = replace(estimate, result=replace(estimate.result, status="uncertain"))
    assert "UNCERTAIN" in panels(figure(wide))[0].get_title(loc="left")
    nothing = replace(estimate, result=replace(estimate.result, status="unresolved", scale=None, interval=None))
    head, body, above, _ = panels(figure(nothing))
    assert "UNRESOLVED" in head.get_title(loc="left")
    assert not head.collections, "no interval is shaded"
    assert body.axison
    assert above.axison, "the plan is that of the highest mode"


def test_other_evidence_has_rows_before_the_objects(estimate: SceneEstimate) -> None:
    rows = (
        EvidenceReport("known_length", "1", 0.5, 0.01, 1.0, "used", None),
        EvidenceReport("gps", "exif", None, None, 0.0, "skipped", "2 views have a position"),
        EvidenceReport("marker", "7", 3.0, 0.01, 0.0, "outlier", "the scale by all other evidence is 0.5"),
    )
    drawn = figure(replace(estimate, result=replace(estimate.result, evidence=rows)))
    body = panels(drawn)[1]
    names = [tick.get_text() for tick in body.get_yticklabels()]
    assert names[:2] == ["known length 1", "marker 7"], "what could not speak has none"
    assert len(names) == 2 + len(panels(figure(estimate))[1].get_yticklabels())
    peak = next(line for line in body.lines if np.isfinite(line.get_ydata()).any())
    assert peak.get_xdata()[np.nanargmin(peak.get_ydata())] == pytest.approx(0.5, rel=0.02)
    assert any("3" in text.get_text() and "▸" in text.get_text() for text in body.texts), "beyond the axis"


def test_captions_and_titles_are_inside_the_paper(estimate: SceneEstimate) -> None:
    evidence = (EvidenceReport("metric_depth", "maps", 0.5, 0.15, 1.0, "used", None),)
    drawn = figure(replace(estimate, result=replace(estimate.result, evidence=evidence)))
    drawn.draw_without_rendering()
    left, right = drawn.bbox.width * 0.0, drawn.bbox.width
    boxes = [axes.xaxis.label.get_window_extent() for axes in drawn.axes if axes.get_xlabel()]
    assert all(left <= box.x0 and box.x1 <= right for box in boxes)
    captions = sorted(boxes, key=lambda box: box.x0)
    assert all(one.x1 < two.x0 for one, two in pairwise(captions)), "none runs into the other"


def test_control_characters_of_a_category_are_written_out(estimate: SceneEstimate) -> None:
    reports = tuple(replace(report, category="a\x1b[2J\u202eb") for report in estimate.result.objects)
    drawn = figure(replace(estimate, result=replace(estimate.result, objects=reports)))
    texts = [text.get_text() for text in drawn.findobj(lambda artist: hasattr(artist, "get_text"))]
    assert any("\\x1b" in text for text in texts)
    assert not any("\x1b" in text or "\u202e" in text for text in texts)


@pytest.mark.parametrize(("low", "high"), [(0.29, 0.31), (0.12375, 0.448), (0.2, 0.55), (0.01, 10.0)])
def test_an_axis_has_two_to_ten_ticks(low: float, high: float, estimate: SceneEstimate) -> None:
    objects = tuple(replace(report, scale=0.3) for report in estimate.result.objects)
    result = replace(estimate.result, objects=objects, interval=Interval(0.9, low, high))
    _, body = figure(result).axes
    first, last = body.get_xlim()
    assert 2 <= sum(first <= tick <= last for tick in body.xaxis.get_majorticklocs()) <= 10


@pytest.mark.parametrize(("ratio", "is_drawn"), [(0.0011, True), (0.0009, False)])
def test_likelihoods_below_a_thousandth_of_the_peak_are_not_drawn(
    ratio: float, is_drawn: bool, estimate: SceneEstimate
) -> None:
    """_MIN_DRAWN_LIKELIHOOD, of an object whose likelihood is flat but for its peak and one zero."""
    curve = np.full(400, ratio)
    curve[200], curve[0] = 1.0, 0.0
    curves = {estimate.result.objects[0].id: curve}
    _, body = figure(replace(estimate.result, object_curves=curves)).axes
    (line,) = (line for line in body.lines if len(line.get_xdata()) == 400)
    assert np.isfinite(line.get_ydata()[300]) == is_drawn


def test_a_result_without_a_curve_or_a_scale_has_no_axes(estimate: SceneEstimate) -> None:
    head, body = figure(replace(estimate.result, curve=None)).axes
    assert not head.axison
    assert not body.axison
    nothing = replace(estimate.result, scale=None, modes=(), interval=None)
    assert not figure(nothing).axes[0].axison


def test_a_plan_has_no_outline_without_objects_or_points(estimate: SceneEstimate) -> None:
    no_rows = {"keypoints": np.empty((0, 2)), "point_index": np.empty(0, dtype=np.int64)}
    views = tuple(replace(view, **no_rows) for view in estimate.scene.views)
    empty = replace(estimate.scene, points=np.empty((0, 3)), views=views)
    assert estimate.measurements is not None
    for changes in ({"scene": empty}, {"measurements": replace(estimate.measurements, objects=())}):
        _, _, above, side = panels(figure(replace(estimate, **changes)))
        assert above.axison
        assert side.axison
        assert (len(outlines(above)) == 0) == ("measurements" in changes)
