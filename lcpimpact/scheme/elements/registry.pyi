# The registry of elements: an element is a line here, in the order of `lcpimpact list elements`, and so has its name in
# scheme files and in the package itself.
# isort: skip_file

from lcpimpact.scheme.elements.mass import Mass as Mass
from lcpimpact.scheme.elements.spring import Spring as Spring
from lcpimpact.scheme.elements.negative_spring import NegativeSpring as NegativeSpring
from lcpimpact.scheme.elements.dashpot import Dashpot as Dashpot
from lcpimpact.scheme.elements.nonlinear_dashpot import NonlinearDashpot as NonlinearDashpot
from lcpimpact.scheme.elements.kelvin_voigt import KelvinVoigt as KelvinVoigt
from lcpimpact.scheme.elements.maxwell import Maxwell as Maxwell
from lcpimpact.scheme.elements.zener import Zener as Zener
from lcpimpact.scheme.elements.generalized_maxwell import GeneralizedMaxwell as GeneralizedMaxwell
from lcpimpact.scheme.elements.spring_pot import SpringPot as SpringPot
from lcpimpact.scheme.elements.jenkins import Jenkins as Jenkins
from lcpimpact.scheme.elements.hertz_spring import HertzSpring as HertzSpring
from lcpimpact.scheme.elements.hunt_crossley import HuntCrossley as HuntCrossley
from lcpimpact.scheme.elements.kelvin_voigt_stop import KelvinVoigtStop as KelvinVoigtStop
from lcpimpact.scheme.elements.elasto_gap import ElastoGap as ElastoGap
from lcpimpact.scheme.elements.hard_stop import HardStop as HardStop
from lcpimpact.scheme.elements.impact_function import ImpactFunction as ImpactFunction
from lcpimpact.scheme.elements.tsuji import Tsuji as Tsuji
from lcpimpact.scheme.elements.kuwabara_kono import KuwabaraKono as KuwabaraKono
from lcpimpact.scheme.elements.slider import Slider as Slider
from lcpimpact.scheme.elements.bumper import Bumper as Bumper
from lcpimpact.scheme.elements.friction import Friction as Friction
from lcpimpact.scheme.elements.rigid_link import RigidLink as RigidLink
from lcpimpact.scheme.elements.rope import Rope as Rope
from lcpimpact.scheme.elements.bar import Bar as Bar
from lcpimpact.scheme.elements.chain import Chain as Chain
from lcpimpact.scheme.elements.tree import Tree as Tree
from lcpimpact.scheme.elements.lattice import Lattice as Lattice
from lcpimpact.scheme.elements.substructure import Substructure as Substructure
from lcpimpact.scheme.elements.load import Load as Load
from lcpimpact.scheme.elements.loads import Loads as Loads
from lcpimpact.scheme.elements.force import Force as Force
from lcpimpact.scheme.elements.sampled_force import SampledForce as SampledForce
from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion as PrescribedMotion
from lcpimpact.scheme.elements.body import Body as Body
from lcpimpact.scheme.elements.body import Wall as Wall
from lcpimpact.scheme.elements.touch import Touch as Touch
from lcpimpact.scheme.elements.touch import Pin as Pin
from lcpimpact.scheme.elements.touch import Guide as Guide
