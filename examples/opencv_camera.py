"""Angle and alert from a camera's pictures, in your loop: `python examples/opencv_camera.py 0`."""

import sys
import time

import cv2
import numpy as np

from estimation import ImageTracker


def main(device: str) -> None:
    """Print angle and alert of each picture until the camera is disconnected."""
    tracker = ImageTracker()
    camera = cv2.VideoCapture(int(device) if device.isdigit() else device)
    if not camera.isOpened():
        raise SystemExit(f"{device} cannot be opened: give the number of a camera, or a video")
    while True:
        there, image = camera.read()
        if not there:
            return
        answer = tracker.update(image, time.monotonic())
        low, angle, high = np.degrees([answer.low, answer.angle, answer.high])
        print(f"{answer.state}: {angle:.2f}° ({low:.2f} to {high:.2f}) {answer.reason}", flush=True)
        if tracker.alert.level in ("act", "slips"):
            print("grip harder", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
