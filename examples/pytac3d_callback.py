"""Angle in the callback of PyTac3D, the SDK of the Tac3D sensor (`pip install pytac3d`)."""

import time
from typing import Any

import numpy as np

from estimation import Tracker, layout_markers

trackers: dict[str, Tracker] = {}


def receive(frame: dict[str, Any], param: object) -> None:
    """Print the angle of a frame; the first loaded frame contains the sensor's unloaded shape."""
    positions, moved = frame["3D_Positions"], frame["3D_Displacements"]
    name = frame["SN"]
    if name not in trackers:
        if not moved.any():
            return
        trackers[name] = Tracker(layout_markers(positions - moved))
    answer = trackers[name].update_positions(positions, frame["sendTimestamp"])
    print(f"{name} {answer.state}: {np.degrees(answer.angle):.2f}°", flush=True)


if __name__ == "__main__":
    from PyTac3D import Sensor

    sensor = Sensor(recvCallback=receive, port=9988)
    time.sleep(float("inf"))
