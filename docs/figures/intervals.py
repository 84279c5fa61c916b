"""The error of the default estimator in one virtual pivot beside its interval."""

import matplotlib.pyplot as plt
import numpy as np

from estimation import estimate_angles, simulate_pivot

recording, truth = simulate_pivot(seed=0)
result = estimate_angles(recording)
holding = truth.sticking_now.sum(axis=1)
figure, (above, below) = plt.subplots(2, figsize=(7, 4.4), sharex=True, layout="constrained")
time, error = recording.time, np.degrees(result.angle - truth.angle)
low, high = np.degrees([result.low - truth.angle, result.high - truth.angle])
above.fill_between(time, low, high, alpha=0.3, label="95 % interval")
above.plot(time, error, label="estimate less truth")
above.axhline(0.0, color="black", lw=0.6)
above.set(ylabel="error [°]", ylim=(-0.5, 0.5))
above.legend(loc="lower left")
below.plot(time, holding)
below.set(xlabel="time [s]", ylabel="markers that stick")
