"""How much stiffer a layer on a rigid base is than a thick gel, by the wavelength of the load."""

import matplotlib.pyplot as plt
import numpy as np

from contactmodel import layer_gain

wavelength = np.logspace(-0.5, 1.5, 200)  # over the thickness [-]
x = 2.0 * np.pi / wavelength
figure, axis = plt.subplots(figsize=(5.5, 3.2), layout="constrained")
axis.semilogx(wavelength, 1.0 + layer_gain(x, np.zeros_like(x)).transverse)
axis.axhline(1.0, color="black", lw=0.8, ls="--")
axis.set(xlabel="wavelength of the load / thickness of the gel", ylabel="stiffness / thick gel's")
