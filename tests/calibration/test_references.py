"""Files of reference angles: what is read from them, and what is refused."""

import numpy as np
import pytest

from calibration.softness.references import read_reference


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,angle\n0,1\n1,2\n", "must be called angle_deg or angle_rad"),
        ("t,angle_deg\n0,1\n1,2\n", "time_s and angle_deg"),
        ("time_s,angle_deg\n0,1\n", "1 reading with"),
        ("time_s,angle_deg\n0,1\n0,2\n", "line 3: time_s is 0 after 0; it must increase"),
        ("time_s,angle_deg\n0,1\n,2\n", "line 3: time_s is empty"),
        ("time_s,angle_deg\n0,1\n1,\n2,nan\n", "1 angle is a number in 3 rows"),
        ("time_s,angle_deg,error_deg\n0,1,1\n1,2,-1\n", "line 3: the error is negative"),
        ("time_s;angle_deg\n0;1\n", "separates its columns by semicolons"),
        ("time_s,angle_deg\n0,1\n1,x\n", "line 3: angle_deg is 'x'"),
        ("time_s,angle_deg\n0,5,2\n1,5,4\n", "line 2, has 3 cells, but the file has 2 columns"),
    ],
)
def test_bad_reference_files(tmp_path, text, message):
    path = tmp_path / "reference.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_reference(path)


def test_angles_that_pass_a_whole_turn_go_on(tmp_path):
    turned = np.array([0.0, -8.0, -16.0, np.nan, -4.0, 3.0, 11.0])
    path = tmp_path / "yaw.csv"
    for start, lowest in ((0.0, 0.0), (350.0, 0.0), (178.0, -180.0)):
        shown = (turned + start - lowest) % 360.0 + lowest
        rows = "".join(f"{time},{angle}\n" for time, angle in enumerate(shown))
        path.write_text(f"time_s,angle_deg\n{rows}")
        angle = np.degrees(read_reference(path).angle)
        np.testing.assert_allclose(angle - angle[0], turned, atol=1e-9)  # rounding
    path.write_text("time_s,angle_deg\n0,0\n1,250\n2,10\n")  # no whole turn: left as it is
    np.testing.assert_allclose(np.degrees(read_reference(path).angle), [0.0, 250.0, 10.0])
