"""Errors of linear theory over the angle: of angles in closed form, of a moment by elements."""

import jax
import matplotlib.pyplot as plt
import numpy as np

from contactmodel import Contact, Grid, Layer, Pose, Rigid, Sphere, solve_path
from papers.finite_strain.reference import read_reference
from papers.finite_strain.settings import CASES, SHEAR_MODULUS, THICKNESS
from papers.limits import curl_shortfall, line_shortfall

jax.config.update("jax_enable_x64", True)
case = CASES[1]  # a sphere of 20 mm, pressed by 0.16 of the thickness
reference = read_reference()[case]
degrees, true = reference.angle_deg[1:6], reference.moment_nmm[1:6]  # 5 to 25°
depth = case.depth_mm * np.minimum(np.arange(1, 10) / 4.0, 1.0)  # pressed in four steps
turned = np.radians(np.append(np.zeros(4), degrees))
side = 2.3 * reference.contact_mm + 0.8


def error(corotated, corrected):
    """Error of the model's moment [%]."""
    pad = {"radius": case.pad_mm, "neo_hookean": True} if corrected else {}
    gel = Layer(SHEAR_MODULUS, case.poisson_ratio, THICKNESS, **pad)
    contact = Contact(gel, Rigid(), Sphere(case.edge_mm), Grid((24, 24), (side, side)), 0.5)
    path = solve_path(contact, Pose(depth, twist=turned, corotated=corotated), rtol=1e-5)
    return 100.0 * (np.asarray(path.moment)[4:] / true - 1.0)


figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
theta = np.radians(np.linspace(0.0, 25.0, 60))
left.plot(np.degrees(theta), np.degrees(line_shortfall(theta)), label="line turned by θ × r")
left.plot(np.degrees(theta), np.degrees(curl_shortfall(theta)), label="half the curl of (R − I) r")
right.plot(degrees, error(False, False), "o-", label="default poses")
right.plot(degrees, error(True, False), "o-", label="corotated poses")
right.plot(degrees, error(True, True), "o-", label="and corrected")
for axis in (left, right):
    axis.axhline(0.0, color="black", lw=0.6)
    axis.set(xlabel="object's angle [°]", xlim=(0, 26))
left.set(ylabel="error of the angle [°]")
right.set(ylabel="error of the moment [%]", ylim=(-8.5, 4.5))
left.legend()
right.legend(loc="upper right")
