"""Angle from your own marker positions: here a pad of 400 markers, rotated by up to 5°."""

import numpy as np

from estimation import Noise, Tracker, layout_markers


def main() -> None:
    """Print the true and the estimated angle of each frame."""
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    rest = np.stack([x.ravel(), y.ravel()], axis=1) - 9.5  # mm, unloaded
    inside = np.exp(-((np.hypot(*rest.T) / 6.0) ** 8))  # 1 inside the contact, 0 outside
    tracker = Tracker(layout_markers(rest), noise=Noise.from_std(1e-3))  # of a marker [mm]
    rng = np.random.default_rng(0)
    for frame, degrees in enumerate(np.linspace(0.0, 5.0, 11)):
        turn = np.exp(1j * np.radians(degrees) * inside) * (rest @ [1.0, 1.0j])
        positions = np.stack([turn.real, turn.imag], axis=1) + rng.normal(0.0, 1e-3, rest.shape)
        answer = tracker.update_positions(positions, frame / 30.0)
        # nan until a marker has moved by 0.1 mm, which counts as contact
        print(f"{degrees:.1f}° true, {np.degrees(answer.angle):.2f}° estimated, {answer.state}")


if __name__ == "__main__":
    main()
