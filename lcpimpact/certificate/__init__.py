"""The certificate of a run: the laws that it should obey, judged from what it holds, and its account of energy."""

from lcpimpact.certificate.certification import Certificate as Certificate
from lcpimpact.certificate.certification import certify as certify
from lcpimpact.certificate.impact_gain import ImpactGain as ImpactGain
from lcpimpact.certificate.impact_gain import gain_eigenvalue as gain_eigenvalue
