from contactmodel.analytic.any_pressure import TorsionCurve as TorsionCurve
from contactmodel.analytic.any_pressure import rounded_punch_pressure as rounded_punch_pressure
from contactmodel.analytic.any_pressure import shift_curve as shift_curve
from contactmodel.analytic.any_pressure import torsion_curve as torsion_curve
from contactmodel.analytic.closed_forms import Density as Density
from contactmodel.analytic.closed_forms import Hertz as Hertz
from contactmodel.analytic.closed_forms import flat_disc_moment as flat_disc_moment
from contactmodel.analytic.closed_forms import flat_disc_twist as flat_disc_twist
from contactmodel.analytic.closed_forms import hertz_density as hertz_density
from contactmodel.analytic.closed_forms import hertz_from_approach as hertz_from_approach
from contactmodel.analytic.closed_forms import hertz_indentation as hertz_indentation
from contactmodel.analytic.closed_forms import hertz_pressure as hertz_pressure
from contactmodel.analytic.closed_forms import (
    hertz_radial_displacement as hertz_radial_displacement,
)
from contactmodel.analytic.closed_forms import jaeger_density as jaeger_density
from contactmodel.analytic.closed_forms import lubkin_moment as lubkin_moment
from contactmodel.analytic.closed_forms import lubkin_stick_ratio as lubkin_stick_ratio
from contactmodel.analytic.closed_forms import lubkin_twist as lubkin_twist
from contactmodel.analytic.closed_forms import mindlin_shift as mindlin_shift
from contactmodel.analytic.closed_forms import pair_shear_modulus as pair_shear_modulus
from contactmodel.analytic.closed_forms import punch_displacement as punch_displacement
from contactmodel.analytic.closed_forms import reissner_sagoci_moment as reissner_sagoci_moment
from contactmodel.analytic.closed_forms import reissner_sagoci_traction as reissner_sagoci_traction
from contactmodel.analytic.closed_forms import torsion_displacement as torsion_displacement
from contactmodel.analytic.closed_forms import torsion_moment as torsion_moment
from contactmodel.analytic.closed_forms import torsion_traction as torsion_traction
from contactmodel.analytic.closed_forms import torsion_twist as torsion_twist
from contactmodel.analytic.layer_disc import LayerDisc as LayerDisc
from contactmodel.analytic.layer_disc import layer_torsion_curve as layer_torsion_curve
from contactmodel.analytic.layer_disc import turn_layer_disc as turn_layer_disc
from contactmodel.analytic.layer_punch import LayerPunch as LayerPunch
from contactmodel.analytic.layer_punch import press_layer_punch as press_layer_punch
from contactmodel.analytic.reversals import masing as masing
from contactmodel.analytic.reversals import open_turns as open_turns
