"""The share of the object's turn that the gel takes, over k."""

import matplotlib.pyplot as plt
import numpy as np

ratio = np.logspace(-2, 1, 100)
figure, axis = plt.subplots(figsize=(5.5, 3.2), layout="constrained")
axis.semilogx(ratio, 1.0 / (1.0 + ratio))
for k in (0.1, 1.0):
    axis.plot(k, 1.0 / (1.0 + k), "o", color="#c0392b")
    axis.annotate(f"k = {k:g}", (k, 1.0 / (1.0 + k)), (6, 4), textcoords="offset points")
axis.set(
    xlabel="k = gel's shear modulus / object's", ylabel="gel's / object's rotation", ylim=(0, 1.1)
)
