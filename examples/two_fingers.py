"""Joint angle of two fingers that hold one object, live; here both fingers are simulated."""

import numpy as np

from estimation import Estimate, Noise, Tracker, layout_markers, simulate_pivot


def join(first: Estimate, second: Estimate) -> tuple[float, float]:
    """Mean weighted by the intervals, and a half-width that covers both facing fingers [rad]."""
    angles = np.array([first.angle, -second.angle])
    halves = np.array([first.high - first.low, second.high - second.low]) / 2.0
    weights = np.where(np.isfinite(angles) & (halves > 0.0), halves**-2.0, 0.0)
    joint = weights @ np.nan_to_num(angles) / (total := weights.sum() or np.nan)
    apart = np.abs(angles - joint, where=weights > 0.0, out=np.zeros(2)).max()
    return float(joint), float(np.hypot(total**-0.5, apart))


def main() -> None:
    """Print the joint angle of every tenth frame."""
    recording, sides = simulate_pivot(frames=(20, 5, 60))[0], (1.0, np.array([-1.0, 1.0, 1.0]))
    layouts = [layout_markers(side * recording.layout.reference) for side in sides]
    trackers = [Tracker(layout, noise=Noise.from_std(3e-3)) for layout in layouts]
    for row, now in enumerate(recording):
        turns = [t.update_positions(s * now.positions, now.time) for t, s in zip(trackers, sides)]
        if row % 10 == 0:
            print("{:7.2f}° ± {:.2f}°".format(*np.degrees(join(*turns))))


if __name__ == "__main__":
    main()
