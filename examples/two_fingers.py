"""Joint angle of two fingers that hold one object, live; here both fingers are simulated."""

import numpy as np

from estimation import Estimate, Noise, Tracker, layout_markers, simulate_pivot


def join(first: Estimate, second: Estimate) -> tuple[float, float]:
    """Mean weighted by the intervals, and half its own [rad]; the fingers face each other."""
    angles = np.array([first.angle, -second.angle])
    halves = np.array([first.high - first.low, second.high - second.low]) / 2.0
    weights = np.where(np.isfinite(angles) & (halves > 0.0), halves**-2.0, 0.0)
    total = weights.sum() or np.nan
    return float(weights @ np.nan_to_num(angles) / total), float(total**-0.5)


def main() -> None:
    """Print the joint angle of every tenth frame."""
    recording, mirror = simulate_pivot(frames=(20, 5, 60))[0], np.array([-1.0, 1.0, 1.0])
    layouts = [layout_markers(side * recording.layout.reference) for side in (1.0, mirror)]
    trackers = [Tracker(layout, noise=Noise.from_std(3e-3)) for layout in layouts]
    for row, frame in enumerate(recording):
        sides = (frame.positions, mirror * frame.positions)
        answers = [t.update_positions(p, frame.time) for t, p in zip(trackers, sides)]
        if row % 10 == 0:
            print("{:7.2f}° ± {:.2f}°".format(*np.degrees(join(*answers))))


if __name__ == "__main__":
    main()
