"""The public names; `bayesdeg/__init__.py` imports each on first use."""

from .api import calibrate as calibrate
from .api import compare as compare
from .api import control as control
from .api import criticise as criticise
from .api import emulator as emulator
from .api import lifetime as lifetime
from .api import predict as predict
from .api import report as report
from .api import update as update
from .assembly.reading import read_study as read_study
from .causes.cause import Cause as Cause
from .causes.cause import Stage as Stage
from .data.settings import Dimensions as Dimensions
from .data.study import Study as Study
from .errors import BayesdegError as BayesdegError
from .errors import GeometryError as GeometryError
from .errors import StudyError as StudyError
from .inference.own_map import Readings as Readings
from .prediction.conditions import ServiceConditions as ServiceConditions
from .priors import HalfNormal as HalfNormal
from .priors import LogNormal as LogNormal
from .priors import Normal as Normal
from .priors import Parameter as Parameter
from .priors import StudentT as StudentT
from .priors import TruncatedNormal as TruncatedNormal
from .priors import Uniform as Uniform
from .results import Calibration as Calibration
from .results import Model as Model
from .results import Report as Report
from .results import Verdict as Verdict

__version__: str
