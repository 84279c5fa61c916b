"""Angles of the print since earlier keyframes."""

import cv2
import numpy as np
import pytest

from estimation.pictures.imprint.follower import ImprintFollower
from estimation.pictures.imprint.registration import Keyframe, Match
from estimation.pictures.imprint.settings import ImprintSettings
from estimation.pictures.imprint.texture import Texture

TEXTURE = Texture(np.zeros((8, 8), dtype=np.float32), np.full((8, 8), 255, dtype=np.uint8))


def match(turned_deg, error_deg):
    """A frame registered with the first keyframe, or with one that is known as well."""
    nothing, error = np.zeros((2, 2)), float(np.radians(error_deg))
    warp = cv2.getRotationMatrix2D((0.0, 0.0), -turned_deg, 1.0)
    return Match(
        Keyframe(TEXTURE, np.eye(3), 0.0, nothing), warp, 0.8, error, nothing, 0.0, nothing
    )


@pytest.mark.parametrize(("apart_deg", "replaces"), [(0.5, True), (-1.0, True), (2.3, False)])
def test_an_earlier_keyframe_that_disagrees_beyond_the_errors_replaces_no_angle(
    monkeypatch, apart_deg, replaces
):
    """A registration with a keyframe in the midst of a slip was 2.2° off at a smaller error."""
    now, earlier = match(3.0, 1.0), match(3.0 - apart_deg, 0.5)
    follower = ImprintFollower(ImprintSettings(closing=1))
    monkeypatch.setattr(follower, "_register_earlier", lambda *_: iter([earlier]))
    closed = follower._close(TEXTURE, now)
    assert closed.turned == pytest.approx((earlier if replaces else now).turned)
    assert closed.error == pytest.approx(np.radians(0.5 if replaces else 1.0))
